"""Volume gained, lost and net between two scans, with the uncertainty that correlated errors leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .covariance import covariance_of_sums, error_covariance
from .difference import Z_95
from .noise_model import NoiseModel
from .smoothing import MAD_TO_SIGMA, local_mean
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
    random, systematic = _net_sigma(change, use, stable & np.isfinite(change.dz), covariance, noise)
    if covariance is None:
        still = float(np.median(change.lod[use])) / Z_95 / 2
    else:
        still = float(MAD_TO_SIGMA * np.nanmedian(np.abs(local_mean(change.dz, LOCAL_CELLS)[stable])))
    area = int(use.sum()) * cell
    sigma = float(np.hypot(random, wall_sigma(change.dz, use, grid.pitch_mm)))
    quiet = float((np.abs(smooth[use]) < 2 * still).mean())
    # E max(e, 0) = 0.4 sigma for a normal error: what noise adds to both sums where nothing changed
    rectified = float(0.4 * still * area * quiet)
    part = float(np.hypot(sigma, rectified))
    measured = Measurement(gained, part), Measurement(lost, part), Measurement(net, sigma)
    return Volumes(*measured, use.sum() / total, systematic)


def _net_sigma(
    change: Change,
    use: npt.NDArray[np.bool_],
    ground: npt.NDArray[np.bool_],
    covariance: npt.NDArray[np.float64] | None,
    noise: NoiseModel | None,
) -> tuple[float, float]:
    """Standard uncertainty of the net volume, mm3, walls apart, and of registration's part in it.

    A registered difference is the heights' less a plane through the ground, so that the net volume is a weighted sum
    of the errors of region and ground, and its variance is exact, whichever of the two share their errors.
    """
    motion, cell = change.motion, change.grid.cell_mm2
    sd = np.where(np.isfinite(change.lod), change.lod, 0).astype(np.float64) / Z_95
    shared = motion.sigma_z_mm if np.isfinite(motion.sigma_z_mm) else 0.0
    weights = use.astype(np.float64)
    unseen = 0.0
    if noise is not None:
        covariance = noise.correlation
    elif covariance is None:
        return _apart(float(np.sqrt(SHARED_CELLS * (sd[use] ** 2).sum())) * cell, shared * float(use.sum()) * cell)
    else:
        said = np.maximum(sd - shared, 0) ** 2
        # Ground that did not move repeats its errors (the stripes fall where they fell before) and looks better than
        # what changed: what the sigmas say and the ground does not show counts too, shared by SHARED_CELLS neighbours
        shown = float(covariance[0]) if covariance.size else 0.0
        unseen = max(0.0, float(said[use].mean()) - shown) * SHARED_CELLS * float(use.sum())
    scale = sd if noise is not None else 1.0
    # ground within the region was found, not given: it may hold a little of the change, which no residual tells
    if motion.covariance is None or not ground.any() or (use & ground).any():
        random = float(covariance_of_sums([weights * scale], covariance)[0, 0]) + unseen
        return _apart(float(np.sqrt(max(0.0, random))) * cell, shared * float(use.sum()) * cell)
    levelling = _levelling_weights(use, ground)
    both = covariance_of_sums([weights * scale, levelling * scale], covariance)
    # a sum's own variance is never below 0 but for rounding
    total = float(both[0, 0] - 2 * both[0, 1] + both[1, 1]) + unseen
    return float(np.sqrt(max(0.0, total))) * cell, float(np.sqrt(max(0.0, both[1, 1]))) * cell


def _apart(random: float, systematic: float) -> tuple[float, float]:
    """Both together where they have nothing to do with each other, and the second."""
    return float(np.hypot(random, systematic)), systematic


def _levelling_weights(use: npt.NDArray[np.bool_], ground: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """How much an error of each cell of the ground adds to the plane's sum over the region, by least squares."""
    row, column = (np.arange(n, dtype=np.float64) - n / 2 for n in use.shape)

    def moments(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
        over_rows, over_columns = mask.sum(axis=1, dtype=np.float64), mask.sum(axis=0, dtype=np.float64)
        return np.array([over_rows.sum(), row @ over_rows, column @ over_columns])

    n, r, c = moments(ground)
    rr = float(row**2 @ ground.sum(axis=1))
    cc = float(column**2 @ ground.sum(axis=0))
    rc = float(row @ (ground.astype(np.float64) @ column))
    normal = np.array([[n, r, c], [r, rr, rc], [c, rc, cc]])
    level = np.linalg.lstsq(normal, moments(use), rcond=None)[0]
    plane = level[0] + level[1] * row[:, None] + level[2] * column[None, :]
    return np.where(ground, plane, 0.0)
