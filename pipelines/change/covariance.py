"""Covariance of a map's error by lag, and what it makes of weighted sums over cells: both exact, by FFT."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from ..slabs import side_by_side
from .blocks import error_sums
from .difference import Z_95
from .gaussian_mixture import gaussian_mixture, plane_shapes
from .ranks import MAD_TO_SIGMA, median, some_rows

__all__ = ["ErrorCovariance", "covariance_by_lag", "covariance_of_sums", "error_covariance", "longest_lag"]

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LEAST_CELLS = 400
GROSS = 6.0
"""Values farther off than so many robust sigmas are left out: they are change or mistakes, not the error asked for."""
MOST_LAG_SHARE = 0.25
"""Longest lag of the covariance, as a share of the grid's shorter side: beyond it too few pairs are left."""
ROUNDS = 6


def longest_lag(shape: tuple[int, int]) -> int:
    """Longest lag, cells, to which a covariance is estimated on maps of this shape."""
    return max(2, int(MOST_LAG_SHARE * min(shape)))


@dataclass(frozen=True, slots=True, eq=False)
class ErrorCovariance:
    """How the error of a map hangs together.

    Parameters
    ----------
    by_lag : ndarray of float64, shape (lags,)
        Covariance, mm2, of cells in blocks that lie 0, 1, 2, ... blocks apart.
    block : int
        Side of a block, cells; with 1 the lags are cells.
    variance : float
        Of one cell, mm2.
    """

    by_lag: Floats
    block: int
    variance: float


def error_covariance(dz: npt.NDArray[np.float32], stable: Mask, block: int = 1) -> ErrorCovariance | None:
    """Covariance of dz's error by lag, from ground that did not move.

    Parameters
    ----------
    dz : ndarray of float32, shape (rows, columns)
        mm; NaN where not measured.
    stable : ndarray of bool, shape (rows, columns)
    block : int
        Every pair of cells counts whatever the blocks: they tell lags apart by so many cells, and the variance of a
        sum over whole blocks is the same.

    Returns
    -------
    ErrorCovariance or None
        Averaged over directions and cut at its first value below zero; None where fewer than 400 stable cells were
        measured. Gross outliers (beyond 6 robust sigmas) are left out. Errors whose correlation falls to 1/e beyond
        an eighth of the map's shorter side have a mixture of Gaussians instead, widened for how few independent
        values were seen.
    """
    if np.count_nonzero(stable & np.isfinite(dz)) < LEAST_CELLS:
        return None
    some, still = some_rows(dz, stable)  # a bound at six sigmas need not be exact
    middle = median(some, still)
    spread = MAD_TO_SIGMA * median(some, still, middle)
    values, counts, variance = error_sums(dz, stable, block, middle, GROSS * max(spread, 1e-9))
    reach = longest_lag((dz.shape[0], dz.shape[1])) // block
    pairs, products = _pooled([(values, counts)], reach)
    by_lag = _positive(_with_plane(_mean_products(pairs, products), pairs, counts, reach))
    far = reach // 2
    if 1 < far < by_lag.size and by_lag[far] > by_lag[1] / np.e:
        return ErrorCovariance(_far(values, counts, 2 * reach, block), block, variance)
    return ErrorCovariance(by_lag, block, variance if block > 1 or not by_lag.size else float(by_lag[0]))


def _far(values: Floats, counts: Floats, reach: int, block: int) -> Floats:
    """Covariance of errors that reach so far that a plane through the ground takes much of them, widened.

    The ground then holds a handful of independent values. A normal interval of such an estimate is too short by
    Student's factor: the covariance is larger by its square.
    """
    from scipy import stats

    by_lag, freedom = gaussian_mixture(*_pooled([(values, counts)], reach), counts, block)
    widened: Floats = by_lag * (float(stats.t.ppf(0.975, freedom)) / Z_95) ** 2
    return widened


def _positive(covariance: Floats) -> Floats:
    """A covariance up to its first value below zero: beyond it is chance."""
    below = np.flatnonzero(covariance <= 0)
    return covariance[: int(below[0])] if below.size else covariance


def _with_plane(found: Floats, pairs: Floats, counts: Floats, reach: int) -> Floats:
    """Give back to a covariance what fitting a plane to the same ground took from it.

    Residuals ``r = e - P e`` of a plane have the covariance ``C - P C P`` where errors reach less far than the ground
    does. P C P is a sum over the plane's three orthonormal shapes, of the variance of each times its autocorrelation,
    and follows from C: a few rounds find both.
    """
    # a small correction: single precision is enough, in half the time
    plain = [shape.astype(np.float32) for shape in plane_shapes(counts)]
    shapes = side_by_side(*(partial(_products, shape, reach) for shape in plain))
    pairs = np.maximum(pairs, 1.0)
    covariance = found
    for _ in range(ROUNDS):
        known = _positive(covariance)
        lost = sum(max(0.0, float(each[: known.size] @ known)) * each for each in shapes)
        covariance = np.where(found != 0, found + lost / pairs, 0.0)
    return covariance


def covariance_by_lag(fields: Iterable[tuple[Floats, Mask]], reach: int) -> Floats:
    """Mean product of values by the distance between their cells, pooled over several maps.

    Parameters
    ----------
    fields : iterable of (values, use)
        Arrays of one shape (rows, columns); values are 0 where not used, and their mean is 0.
    reach : int
        Longest lag, cells.

    Returns
    -------
    ndarray of float64, shape (reach + 1,)
        At lags of 0, 1, 2, ... cells, averaged over directions; 0 where a lag has fewer than a fiftieth of the pairs
        that lag 0 has. Autocorrelations of the values and of their mask, both by FFT: every pair counts.
    """
    return _mean_products(*_pooled(fields, reach))


def _pooled(fields: Iterable[tuple[Floats, Mask | Floats]], reach: int) -> tuple[Floats, Floats]:
    """Pairs of cells by lag, and the sums of their values' products."""
    weight, total = np.zeros(reach + 1), np.zeros(reach + 1)
    for values, use in fields:
        of_values, of_use = side_by_side(
            partial(_products, values, reach), partial(_products, use.astype(np.float64), reach)
        )
        total += of_values
        weight += of_use
    return weight, total


def _mean_products(pairs: Floats, products: Floats) -> Floats:
    enough = pairs > 0.02 * pairs[0]
    return np.where(enough, products / np.maximum(pairs, 1), 0.0)


def _products(values: Floats | npt.NDArray[np.float32], reach: int) -> Floats:
    """Sum of the products of all pairs of values by the distance of their cells, to `reach`.

    The autocorrelation is even: rows of lags from 0 to `reach` are transformed back, all but the first for two.
    """
    from scipy import fft

    rows, columns = (fft.next_fast_len(n + reach, real=True) for n in values.shape)
    spectrum = fft.fft(fft.rfft(values, columns, axis=1), rows, axis=0, overwrite_x=True)
    power = spectrum.real**2 + spectrum.imag**2
    # real and even along both axes together, not along one: the rows' transform back is complex
    half = fft.ifft(power, axis=0, overwrite_x=True)[: reach + 1]
    products = fft.irfft(half, columns, axis=1)
    products[1:] *= 2
    lag = _distances(reach)
    sums = np.zeros(2 * reach + 1)
    ahead = products[:, : reach + 1]
    behind = products[:, : columns - reach - 1 : -1]
    for part, of in ((ahead, lag), (behind, lag[:, 1:])):
        sums += np.bincount(of.ravel(), weights=part.ravel(), minlength=sums.size)[: sums.size]
    return sums[: reach + 1]


@lru_cache(maxsize=4)
def _distances(reach: int) -> npt.NDArray[np.intp]:
    """Whole-cell distance of the lags from 0 to `reach` along rows and columns."""
    side = np.arange(reach + 1)
    return np.rint(np.hypot(side[:, None], side[None, :])).astype(np.intp)


def covariance_of_sums(parts: Sequence[Floats], covariance: Floats) -> Floats:
    """Covariances of weighted sums of one error over all cells.

    ``cov(sum_i a_i e_i, sum_j b_j e_j) = sum_h R_ab(h) C(h)``, R_ab the weights' correlation (how much weight lies at
    lag h of each other), summed in the frequency domain.

    Parameters
    ----------
    parts : sequence of ndarray of float64, shape (rows, columns) each
        Weights.
    covariance : ndarray of float64, shape (lags,)
        Of the error at lags of 0, 1, 2, ... cells, 0 beyond.

    Returns
    -------
    ndarray of float64, shape (parts, parts)
    """
    from scipy import fft

    if covariance.size == 0:
        return np.zeros((len(parts), len(parts)))
    some = np.any([part != 0 for part in parts], axis=0)
    rows, columns = np.flatnonzero(some.any(axis=1)), np.flatnonzero(some.any(axis=0))
    if rows.size == 0:
        return np.zeros((len(parts), len(parts)))
    cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    reach = covariance.size - 1
    shape = [fft.next_fast_len(n + reach + 1, real=True) for n in parts[0][cut].shape]
    power = _power(shape, covariance)
    # a real map's spectrum is kept by half: all columns but the first (and the last of an even width) stand for two
    power[:, 1 : (shape[1] + 1) // 2] *= 2
    spectra = side_by_side(*(partial(fft.rfft2, part[cut], shape) for part in parts))
    found = [[float((np.conj(a) * b).real.ravel() @ power.ravel()) for b in spectra] for a in spectra]
    both: Floats = np.array(found) / (shape[0] * shape[1])
    return both


def _power(shape: list[int], covariance: Floats) -> Floats:
    """Spectrum of a covariance by distance on a plane of FFT lags, half of it as of a real map."""
    from scipy import fft

    lag = _distances(covariance.size - 1)
    plane = np.zeros((shape[0], lag.shape[1]))
    plane[: lag.shape[0]] = np.where(lag < covariance.size, covariance[np.minimum(lag, covariance.size - 1)], 0.0)
    if lag.shape[0] > 1:
        plane[1 - lag.shape[0] :] = plane[lag.shape[0] - 1 : 0 : -1]
    # even along both axes: along columns of a few lags first, then along rows, whose lags before 0 are as those after
    down = fft.fft(plane, axis=0).real
    along = np.zeros(shape)
    along[:, : lag.shape[1]] = down
    if lag.shape[1] > 1:
        along[:, 1 - lag.shape[1] :] = down[:, lag.shape[1] - 1 : 0 : -1]
    power: Floats = fft.rfft(along, axis=1).real
    return power
