"""Volume gained, lost and net between two scans, with the uncertainty that correlated errors leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .difference import Z_95
from .smoothing import MAD_TO_SIGMA, local_mean, robust_sigma
from .values import Change, Measurement

__all__ = ["Volumes", "error_covariance", "sum_sigma", "volume_sigma", "volumes", "wall_sigma"]

LOCAL_CELLS = 5
"""Side of the window whose mean decides between gained and lost: fewer cells are counted for their noise alone."""
LEAST_STABLE_CELLS = 400
SHARED_CELLS = 9
"""Neighbouring cells that share an error where it could not be measured: a stripe is 2 to 3 cells wide."""
WALL_SLOPE = 0.5
"""Steeper changes from cell to cell are walls: there the place of the wall matters, not the noise of the heights."""
WALL_CELLS = float(1 / np.sqrt(12))
"""Standard uncertainty of a wall's place, in cells: uniform within one. All walls err to the same side, because a cell
that sees both levels takes the upper one."""
MOST_LAG_MM_SHARE = 0.25
"""Longest lag of the covariance, as a share of the grid's shorter side: beyond it too few pairs are left."""


@dataclass(frozen=True, slots=True)
class Volumes:
    """Volumes between two scans, mm3; `covered` is the share of the region's cells measured in both, 0 to 1."""

    gained: Measurement
    lost: Measurement
    net: Measurement
    covered: float


def error_covariance(dz: npt.NDArray[np.float32], stable: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64] | None:
    """Covariance of dz's error by lag, from ground that did not move.

    Parameters
    ----------
    dz : ndarray of float32, shape (rows, columns)
        mm; NaN where not measured.
    stable : ndarray of bool, shape (rows, columns)

    Returns
    -------
    ndarray of float64, shape (lags,) or None
        mm2 at lags of 0, 1, 2, ... cells, averaged over directions and cut at its first value below zero; None
        where fewer than 400 stable cells were measured. Both autocorrelations, of the values and of their mask,
        by FFT. Gross outliers (beyond 6 robust sigmas) are left out.
    """
    from scipy import fft

    use = stable & np.isfinite(dz)
    if use.sum() < LEAST_STABLE_CELLS:
        return None
    values = np.where(use, dz, np.float32(0)).astype(np.float64)
    middle, spread = float(np.median(dz[use])), robust_sigma(dz[use])
    use &= np.abs(values - middle) <= 6 * max(spread, 1e-9)
    values = np.where(use, values - values[use].mean(), 0.0)
    reach = max(2, int(MOST_LAG_MM_SHARE * min(dz.shape)))
    shape = [fft.next_fast_len(n + reach, real=True) for n in dz.shape]
    products = fft.irfft2(np.abs(fft.rfft2(values, shape)) ** 2, shape)
    pairs = fft.irfft2(np.abs(fft.rfft2(use.astype(np.float64), shape)) ** 2, shape)
    lag, inside = _lags(shape, reach)
    weight = np.bincount(lag[inside], weights=pairs[inside], minlength=reach + 1)
    total = np.bincount(lag[inside], weights=products[inside], minlength=reach + 1)
    enough = weight > 0.02 * weight[0]
    covariance = np.where(enough, total / np.maximum(weight, 1), 0.0)
    below = np.flatnonzero(covariance <= 0)
    return covariance[: int(below[0])] if below.size else covariance


def volume_sigma(mask: npt.NDArray[np.bool_], covariance: npt.NDArray[np.float64], pitch_mm: float) -> float:
    """Standard uncertainty of a volume summed over a mask, mm3, from the covariance of the error.

    ``Var(V) = L^4 sum_h R_mask(h) C(h)``, R_mask the mask's autocorrelation (number of pairs of its cells at lag
    h) by FFT, C as `error_covariance` gives it.
    """
    from scipy import fft

    if not mask.any() or covariance.size == 0:
        return 0.0
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    cut = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    reach = covariance.size - 1
    shape = [fft.next_fast_len(n + reach + 1, real=True) for n in cut.shape]
    pairs = fft.irfft2(np.abs(fft.rfft2(cut.astype(np.float64), shape)) ** 2, shape)
    lag, inside = _lags(shape, reach)
    count = np.bincount(lag[inside], weights=pairs[inside], minlength=reach + 1)
    return float(pitch_mm**2 * np.sqrt(max(0.0, float(count[: reach + 1] @ covariance))))


def sum_sigma(
    use: npt.NDArray[np.bool_],
    lod: npt.NDArray[np.float32],
    covariance: npt.NDArray[np.float64] | None,
    pitch_mm: float,
) -> float:
    """Standard uncertainty of a volume, mm3: from still ground, and never less than the scans' own sigmas allow.

    Ground that did not move at all repeats its errors (the stripes fall where they fell before) and looks better than
    what changed. So the least is the cells' own sigmas with SHARED_CELLS neighbours sharing each error.
    """
    variance = float(((lod[use].astype(np.float64) / Z_95) ** 2).sum()) * SHARED_CELLS
    least = float(np.sqrt(variance)) * pitch_mm**2
    return least if covariance is None else max(least, volume_sigma(use, covariance, pitch_mm))


def wall_sigma(dz: npt.NDArray[np.float32], use: npt.NDArray[np.bool_], pitch_mm: float) -> float:
    """Standard uncertainty of a volume, mm3, from where the raster places the walls of what changed.

    A wall of height J and length l that lies d off adds d l J. Summed over neighbouring cells, l J is the sum of the
    jumps of dz times the pitch; jumps that slope less than 0.5 are no walls.
    """
    jumps = np.zeros(dz.shape)
    for axis in range(2):
        step = np.abs(np.diff(dz, axis=axis))
        both = np.take(use, range(1, use.shape[axis]), axis) & np.take(use, range(use.shape[axis] - 1), axis)
        steep = np.where(both & (step > WALL_SLOPE * pitch_mm), step, 0.0)
        inner = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        jumps[inner] += steep.astype(np.float64) ** 2
    return float(WALL_CELLS * pitch_mm**2 * np.sqrt(jumps).sum())


def _lags(shape: list[int], reach: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Distance of each lag of a real FFT's plane, whole cells; and which are within reach."""
    row = np.minimum(np.arange(shape[0]), shape[0] - np.arange(shape[0]))
    column = np.minimum(np.arange(shape[1]), shape[1] - np.arange(shape[1]))
    lag = np.rint(np.hypot(row[:, None], column[None, :])).astype(np.intp)
    return lag, lag <= reach


def volumes(change: Change, region: npt.NDArray[np.bool_], stable: npt.NDArray[np.bool_]) -> Volumes:
    """Sum dz over a region.

    Parameters
    ----------
    change : Change
    region : ndarray of bool, shape (rows, columns)
        Cells that count.
    stable : ndarray of bool, shape (rows, columns)
        Ground that did not move, from which the error's covariance is taken.

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
    use = region & np.isfinite(change.dz)
    total = int(region.sum())
    nan = Measurement(float("nan"), float("nan"))
    if not use.any():
        return Volumes(nan, nan, nan, 0.0)
    cell = grid.cell_mm2
    net = float(change.dz[use].sum(dtype=np.float64)) * cell
    smooth = local_mean(change.dz, LOCAL_CELLS, use=use)
    smooth = np.where(use & ~np.isfinite(smooth), change.dz, smooth)
    gained = float(np.maximum(smooth[use], 0).sum(dtype=np.float64)) * cell
    # smoothing moves a little across the region's edge: the scale between the two sums is taken out of both parts
    drift = net - float(smooth[use].sum(dtype=np.float64)) * cell
    gained += max(0.0, drift)
    lost = gained - net

    covariance = error_covariance(change.dz, stable)
    spread = sum_sigma(use, change.lod, covariance, grid.pitch_mm)
    if covariance is None:
        noise = float(np.median(change.lod[use])) / Z_95 / 2
    else:
        noise = float(MAD_TO_SIGMA * np.nanmedian(np.abs(local_mean(change.dz, LOCAL_CELLS)[stable])))
    shared = change.motion.sigma_z_mm if np.isfinite(change.motion.sigma_z_mm) else 0.0
    area = int(use.sum()) * cell
    sigma = float(np.hypot(np.hypot(spread, wall_sigma(change.dz, use, grid.pitch_mm)), shared * area))
    quiet = float((np.abs(smooth[use]) < 2 * noise).mean())
    # E max(e, 0) = 0.4 sigma for a normal error: what noise adds to both sums where nothing changed
    rectified = float(0.4 * noise * area * quiet)
    part = float(np.hypot(sigma, rectified))
    return Volumes(Measurement(gained, part), Measurement(lost, part), Measurement(net, sigma), use.sum() / total)
