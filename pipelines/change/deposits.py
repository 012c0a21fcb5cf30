"""What was put down or taken away: connected patches of significant change, with their volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .covariance import ErrorCovariance, error_covariance
from .ranks import robust_sigma
from .smoothing import local_mean
from .values import Change, Measurement
from .volume import sum_sigma

__all__ = ["Deposit", "find_deposits"]

LOCAL_CELLS = 7
SURE, LIKELY = 5.0, 2.5
"""Multiples of the smoothed difference's spread at which a patch is begun, and down to which it reaches."""
SHELL_MM = 0.1
REACH_MM = 1.0
BACKGROUND_MM = 0.3
EIGHT = np.ones((3, 3), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Deposit:
    """One patch of change.

    Parameters
    ----------
    volume : Measurement
        mm3; negative where material was taken away.
    area_mm2 : float
        Footprint, out to where dz meets its surroundings.
    x_mm, y_mm : float
        Centre of the change, weighted by dz, site frame.
    height_mm : float
        Greatest change above the surroundings (smoothed over 7 x 7 cells), with its sign.
    background_mm : float
        Level of dz around the patch, which was taken off.
    covered : float
        Share of the footprint that was measured in both scans; the rest is filled with the patch's mean.
    """

    volume: Measurement
    area_mm2: float
    x_mm: float
    y_mm: float
    height_mm: float
    background_mm: float
    covered: float


def find_deposits(
    change: Change,
    region: npt.NDArray[np.bool_] | None = None,
    stable: npt.NDArray[np.bool_] | None = None,
    *,
    least_area_mm2: float = 0.1,
) -> tuple[Deposit, ...]:
    """Find patches that were raised or lowered, largest volume first.

    dz is averaged over 7 x 7 cells; where it exceeds 5 times its own spread a patch begins, and takes in what is
    connected down to 2.5 times. A patch with a smooth rim goes on below any level of detection, and its volume would be
    too small: so it is widened in rings of 0.1 mm until the mean of a ring meets the level of the surroundings
    (the median of dz 0.3 mm further out), at most by 1 mm and never into another patch.

    Parameters
    ----------
    change : Change
    region : ndarray of bool, shape (rows, columns), optional
        Where to look: a plate without its cracks. A plate that shifted sideways shows patches at every pebble, which
        this function does not tell from deposits.
    stable : ndarray of bool, shape (rows, columns), optional
        Ground that did not move, for the covariance of the error; the quiet part of the region if left out.
    least_area_mm2 : float
        Smaller patches are dropped.

    Returns
    -------
    tuple of Deposit
    """
    grid = change.grid
    pitch, cell = grid.pitch_mm, grid.cell_mm2
    where = np.ones(grid.shape, dtype=np.bool_) if region is None else region
    known = np.isfinite(change.dz) & where
    if not known.any():
        return ()
    smooth = np.where(where, local_mean(change.dz, LOCAL_CELLS, use=where), np.float32(np.nan))
    spread, middle = robust_sigma(smooth), float(np.nanmedian(smooth))
    if not spread > 0:
        spread = 1e-6
    quiet = known & (np.abs(smooth - middle) < 3 * spread)
    covariance = error_covariance(change.dz, quiet if stable is None else stable & known)
    labels = np.zeros(grid.shape, dtype=np.int32)
    for sign in (1, -1):
        high = sign * (smooth - middle)
        marked, _ = ndimage.label(
            ndimage.binary_propagation(high > SURE * spread, structure=EIGHT, mask=high > LIKELY * spread),
            structure=EIGHT,
        )
        labels = np.where(marked > 0, marked + labels.max(), labels)
    found = []
    margin = int(np.ceil((REACH_MM + BACKGROUND_MM + SHELL_MM) / pitch)) + 1
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None or (labels[box] == number).sum() * cell < least_area_mm2:
            continue
        part = tuple(slice(max(0, s.start - margin), s.stop + margin) for s in box)
        deposit = _measure(
            change.dz[part],
            change.lod[part],
            smooth[part],
            where[part],
            labels[part],
            number,
            covariance,
            pitch,
            spread,
        )
        if deposit is not None:
            row, column = part[0].start, part[1].start
            found.append((deposit, row, column))
    placed = [
        Deposit(
            d.volume,
            d.area_mm2,
            grid.x0_mm + (column * pitch) + d.x_mm,
            grid.y0_mm + (row * pitch) + d.y_mm,
            d.height_mm,
            d.background_mm,
            d.covered,
        )
        for d, row, column in found
    ]
    return tuple(sorted(placed, key=lambda d: -abs(d.volume.value)))


def _measure(
    dz: npt.NDArray[np.float32],
    lod: npt.NDArray[np.float32],
    smooth: npt.NDArray[np.float32],
    where: npt.NDArray[np.bool_],
    labels: npt.NDArray[np.int32],
    number: int,
    covariance: ErrorCovariance | None,
    pitch: float,
    spread: float,
) -> Deposit | None:
    """One patch in its own window; places are relative to the window's first cell."""
    core = labels == number
    known = np.isfinite(dz) & where
    outside = known & ~core
    middle = float(np.median(dz[outside])) if outside.any() else 0.0
    free = where & ((labels == 0) | core)
    out = ndimage.distance_transform_edt(~core) * pitch
    sign = 1.0 if np.nanmean(smooth[core]) > middle else -1.0

    def level(low: float, high: float) -> tuple[float, int]:
        ring = known & free & (out > low) & (out <= high)
        count = int(ring.sum())
        return (float(np.median(dz[ring])) if count >= 20 else middle), count

    reach = 0.0
    background = middle
    # neighbours share errors, so a ring's mean is known to the smoothed spread over the root of its patches
    while reach < REACH_MM:
        background, _ = level(reach + SHELL_MM, reach + SHELL_MM + BACKGROUND_MM)
        ring = known & free & (out > reach) & (out <= reach + SHELL_MM)
        if ring.sum() < 20:
            break
        patches = max(1.0, float(ring.sum()) / LOCAL_CELLS**2)
        if sign * (float(dz[ring].mean()) - background) < spread / np.sqrt(patches):
            break
        reach += SHELL_MM
    footprint = free & (out <= reach)
    use = footprint & known
    if not use.any():
        return None
    cell = pitch**2
    excess = dz[use].astype(np.float64) - background
    covered = float(use.sum() / footprint.sum())
    volume = float(excess.sum()) * cell / covered
    area = float(footprint.sum()) * cell
    ring = known & free & (out > reach + SHELL_MM) & (out <= reach + SHELL_MM + BACKGROUND_MM)
    random = sum_sigma(use, lod, covariance, pitch) / covered
    # the level of the surroundings is known as well as a sum over the ring divided by its area
    shared = sum_sigma(ring, lod, covariance, pitch) / max(float(ring.sum()) * cell, cell) * area
    rows, columns = np.nonzero(use)
    total = float(excess.sum())
    if total == 0:
        return None
    peak = float(np.nanmax(sign * (smooth[core] - background))) * sign
    return Deposit(
        Measurement(volume, float(np.hypot(random, shared))),
        area,
        float((columns * excess).sum() / total) * pitch,
        float((rows * excess).sum() / total) * pitch,
        peak,
        background,
        covered,
    )
