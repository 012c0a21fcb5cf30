"""Volume gained, lost and net between two scans, with the uncertainty that correlated errors leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs
from .blocks import block_side, block_sums
from .covariance import ErrorCovariance, covariance_of_sums, error_covariance, longest_lag
from .difference import Z_95
from .noise_model import NoiseModel
from .ranks import MAD_TO_SIGMA, median, some_rows
from .smoothing import local_mean
from .values import Change, Measurement

__all__ = ["Volumes", "error_covariance", "sum_sigma", "volume_sigma", "volumes", "wall_sigma"]

LOCAL_CELLS = 5
"""Side of the window whose mean decides between gained and lost: fewer cells are counted for their noise alone."""
SHARED_CELLS = 9
"""Neighbouring cells that share an error where it could not be measured: a stripe is 2 to 3 cells wide."""
WALL_SLOPE = 0.5
"""Steeper changes from cell to cell are walls: there the place of the wall matters, not the noise of the heights."""
WALL_CELLS = float(1 / np.sqrt(12))
"""Standard uncertainty of a wall's place, in cells: uniform within one. All walls err to the same side, because a cell
that sees both levels takes the upper one."""


@dataclass(frozen=True, slots=True)
class Volumes:
    """Volumes between two scans, mm3; `covered` is the share of the region's cells measured in both, 0 to 1.

    `systematic_mm3` is the part of the net volume's uncertainty that registration brings, which all cells share; the
    two are correlated, so that the rest is not simply what is left of the squares.
    """

    gained: Measurement
    lost: Measurement
    net: Measurement
    covered: float
    systematic_mm3: float = float("nan")


def volume_sigma(mask: npt.NDArray[np.bool_], covariance: npt.NDArray[np.float64], pitch_mm: float) -> float:
    """Standard uncertainty of a volume summed over a mask, mm3, from the covariance of the error.

    ``Var(V) = L^4 sum_h R_mask(h) C(h)``, R_mask the mask's autocorrelation (number of pairs of its cells at lag
    h) by FFT, C as `error_covariance` gives it.
    """
    variance = float(covariance_of_sums([mask.astype(np.float64)], covariance)[0, 0])
    return float(pitch_mm**2 * np.sqrt(max(0.0, variance)))


def sum_sigma(
    use: npt.NDArray[np.bool_],
    lod: npt.NDArray[np.float32],
    covariance: ErrorCovariance | None,
    pitch_mm: float,
) -> float:
    """Standard uncertainty of a volume, mm3: from still ground, and never less than the scans' own sigmas allow.

    Ground that did not move at all repeats its errors (the stripes fall where they fell before) and looks better than
    what changed. So the least is the cells' own sigmas with SHARED_CELLS neighbours sharing each error.
    """
    variance = float(((lod[use].astype(np.float64) / Z_95) ** 2).sum()) * SHARED_CELLS
    least = float(np.sqrt(variance)) * pitch_mm**2
    return least if covariance is None else max(least, volume_sigma(use, covariance.by_lag, pitch_mm))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _jumps(dz, use, least, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    """Sum over the cells of a slab of how far dz jumps from the cell above and the cell before, walls alone."""
    total = 0.0
    for i in range(first, last):
        above = max(i - 1, 0)  # the first row does not jump from itself
        for j in range(1, dz.shape[1]):
            down, aside = abs(dz[i, j] - dz[above, j]), abs(dz[i, j] - dz[i, j - 1])
            down = down if use[i, j] & use[above, j] & (down > least) else np.float32(0)
            aside = aside if use[i, j] & use[i, j - 1] & (aside > least) else np.float32(0)
            total += np.sqrt(down * down + aside * aside)
        down = abs(dz[i, 0] - dz[above, 0])
        if use[i, 0] and use[above, 0] and down > least:
            total += down
    return total


def wall_sigma(dz: npt.NDArray[np.float32], use: npt.NDArray[np.bool_], pitch_mm: float) -> float:
    """Standard uncertainty of a volume, mm3, from where the raster places the walls of what changed.

    A wall of height J and length l that lies d off adds d l J. Summed over neighbouring cells, l J is the sum of the
    jumps of dz times the pitch; jumps that slope less than 0.5 are no walls.
    """
    least = WALL_SLOPE * pitch_mm
    return (
        WALL_CELLS * pitch_mm**2 * sum(in_slabs(len(dz), lambda *rows: float(_jumps(dz, use, least, *rows)), least=256))
    )


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _sums(dz, smooth, use, first, last):  # type: ignore[no-untyped-def]  # as above
    """Sums over the used cells of a slab: of dz, of its local mean, and of what of that is above 0."""
    net = mean = gained = 0.0
    for i in range(first, last):
        for j in range(dz.shape[1]):
            z = dz[i, j] if use[i, j] else 0.0
            # beside what is missing there may be no local mean
            local = smooth[i, j] if use[i, j] & (abs(smooth[i, j]) < np.inf) else z
            net += z
            mean += local
            gained += local if local > 0 else 0.0
    return net, mean, gained


@njit(cache=True, nogil=True)
def _within(dz, smooth, use, bound, first, last):  # type: ignore[no-untyped-def]  # as above
    """How many used cells of a slab have a local mean within a bound."""
    count = 0
    for i in range(first, last):
        for j in range(dz.shape[1]):
            if use[i, j]:
                count += abs(smooth[i, j] if np.isfinite(smooth[i, j]) else dz[i, j]) < bound
    return count


def volumes(
    change: Change,
    region: npt.NDArray[np.bool_],
    stable: npt.NDArray[np.bool_],
    noise: NoiseModel | None = None,
) -> Volumes:
    """Sum dz over a region.

    Parameters
    ----------
    change : Change
    region : ndarray of bool, shape (rows, columns)
        Cells that count.
    stable : ndarray of bool, shape (rows, columns)
        Ground that did not move, from which the error's covariance is taken.
    noise : NoiseModel, optional
        What the covariance is taken from instead; `change.lod` must rest on it.

    Returns
    -------
    Volumes
        Over the cells measured in both scans and no others: a crack floor that the camera or the projector does
        not see adds nothing; `covered` says how much was seen. Net is the plain sum, without a threshold
        (Anderson 2019). A cell counts as gained or lost by the sign of the mean over 5 x 5 cells, again without a
        threshold, and gained - lost = net. Noise alone gives a little of both where nothing changed: that amount is in
        the uncertainty of gained and lost, not taken off.
    """
    grid = change.grid
    measured = np.isfinite(change.dz)
    use = region & measured
    total = int(region.sum())
    nan = Measurement(float("nan"), float("nan"))
    if not use.any():
        return Volumes(nan, nan, nan, 0.0)
    cell = grid.cell_mm2
    dz, number = change.dz, int(use.sum())
    smooth = local_mean(dz, LOCAL_CELLS, use=use)
    net, mean, gained = (
        float(each) * cell
        for each in np.sum(in_slabs(grid.rows, lambda *rows: _sums(dz, smooth, use, *rows), least=256), axis=0)
    )
    # smoothing moves a little across the region's edge: the scale between the two sums is taken out of both parts
    gained += max(0.0, net - mean)
    lost = gained - net

    block = block_side(longest_lag(grid.shape)) if noise is None else 1  # a noise model's lags are cells
    covariance = error_covariance(dz, stable, block)
    random, systematic = _net_sigma(change, use, stable & measured, covariance, noise)
    if covariance is None:
        still = median(change.lod, use) / Z_95 / 2
    else:
        everywhere = smooth if number == np.count_nonzero(measured) else local_mean(dz, LOCAL_CELLS)
        still = MAD_TO_SIGMA * median(*some_rows(everywhere, stable), about=0.0)
    sigma = float(np.hypot(random, wall_sigma(dz, use, grid.pitch_mm)))
    quiet = sum(in_slabs(grid.rows, lambda *rows: int(_within(dz, smooth, use, 2 * still, *rows)), least=256))
    # E max(e, 0) = 0.4 sigma for a normal error: what noise adds to both sums where nothing changed
    rectified = 0.4 * still * quiet * cell
    part = float(np.hypot(sigma, rectified))
    parts = Measurement(gained, part), Measurement(lost, part), Measurement(net, sigma)
    return Volumes(*parts, number / total, systematic)


def _net_sigma(
    change: Change,
    use: npt.NDArray[np.bool_],
    ground: npt.NDArray[np.bool_],
    covariance: ErrorCovariance | None,
    noise: NoiseModel | None,
) -> tuple[float, float]:
    """Standard uncertainty of the net volume, mm3, walls apart, and of registration's part in it.

    A registered difference is the heights' less a plane through the ground, so that the net volume is a weighted sum
    of the errors of region and ground, and its variance is exact, whichever of the two share their errors.
    """
    motion, cell = change.motion, change.grid.cell_mm2
    shared = motion.sigma_z_mm if np.isfinite(motion.sigma_z_mm) else 0.0
    area = float(np.count_nonzero(use)) * cell
    if noise is None and covariance is None:
        squares = float(np.square(change.lod[use], dtype=np.float64).sum()) / Z_95**2
        return _apart(float(np.sqrt(SHARED_CELLS * squares)) * cell, shared * area)
    unseen, block = 0.0, 1
    scale: npt.NDArray[np.float64] = np.ones((1, 1))
    if noise is not None:
        by_lag = noise.correlation
        scale = np.where(np.isfinite(change.lod), change.lod, 0).astype(np.float64) / Z_95
    else:
        assert covariance is not None
        by_lag, block = covariance.by_lag, covariance.block
        # Ground that did not move repeats its errors (the stripes fall where they fell before) and looks better than
        # what changed: what the sigmas say and the ground does not show counts too, shared by SHARED_CELLS neighbours
        shown = covariance.variance if by_lag.size else 0.0
        unseen = max(0.0, _said(change.lod, use, shared) - shown) * SHARED_CELLS * float(np.count_nonzero(use))
    weights: npt.NDArray[np.float64] = block_sums(use, block)
    # ground within the region was found, not given: it may hold a little of the change, which no residual tells
    if motion.covariance is None or not ground.any() or (use & ground).any():
        random = float(covariance_of_sums([weights * scale], by_lag)[0, 0]) + unseen
        return _apart(float(np.sqrt(max(0.0, random))) * cell, shared * area)
    levelling = _levelling_weights(weights, block_sums(ground, block))
    both = covariance_of_sums([weights * scale, levelling * scale], by_lag)
    # a sum's own variance is never below 0 but for rounding
    total = float(both[0, 0] - 2 * both[0, 1] + both[1, 1]) + unseen
    return float(np.sqrt(max(0.0, total))) * cell, float(np.sqrt(max(0.0, both[1, 1]))) * cell


def _said(lod: npt.NDArray[np.float32], use: npt.NDArray[np.bool_], shared: float) -> float:
    """Mean variance that the scans' sigmas state for a cell's difference, without registration's part."""
    slabs = in_slabs(len(lod), lambda *rows: float(_stated(lod, use, 1 / Z_95, shared, *rows)), least=256)
    return sum(slabs) / max(1, int(np.count_nonzero(use)))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _stated(lod, use, scale, shared, first, last):  # type: ignore[no-untyped-def]  # as above
    total = 0.0
    for i in range(first, last):
        for j in range(lod.shape[1]):
            said = max(lod[i, j] * scale - shared, 0.0) if use[i, j] & (abs(lod[i, j]) < np.inf) else 0.0
            total += said * said
    return total


def _apart(random: float, systematic: float) -> tuple[float, float]:
    """Both together where they have nothing to do with each other, and the second."""
    return float(np.hypot(random, systematic)), systematic


def _levelling_weights(use: npt.NDArray[np.float64], ground: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How much errors of the ground add to the plane's sum over the region, by least squares; by blocks."""
    row, column = (np.arange(n, dtype=np.float64) - n / 2 for n in use.shape)

    def moments(counts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        over_rows, over_columns = counts.sum(axis=1), counts.sum(axis=0)
        return np.array([over_rows.sum(), row @ over_rows, column @ over_columns])

    n, r, c = moments(ground)
    rr = float(row**2 @ ground.sum(axis=1))
    cc = float(column**2 @ ground.sum(axis=0))
    rc = float(row @ (ground @ column))
    normal = np.array([[n, r, c], [r, rr, rc], [c, rc, cc]])
    level = np.linalg.lstsq(normal, moments(use), rcond=None)[0]
    plane = level[0] + level[1] * row[:, None] + level[2] * column[None, :]
    weights: npt.NDArray[np.float64] = ground * plane
    return weights
