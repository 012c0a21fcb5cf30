"""The drift of a scan whose neighbour in time is registered: sought from there, and proven to be the only one."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from ..slabs import side_by_side
from .bands import band_passed
from .drift import (
    SAMPLED,
    SIMILAR,
    Drift,
    Pattern,
    bands_of_baseline,
    pattern_of,
    refined,
    residual_spread,
    residuals_at,
    step_for,
)
from .motion import Motion
from .ranks import robust_sigma

__all__ = ["followed_drift"]

Mask = npt.NDArray[np.bool_]

STRIPS, STRIP_ROWS = 8, 50
"""Drift is sought on so many strips of rows, which are a quarter of a map of 1440 rows."""
DECOYS = (7.0, 2.0), (-6.0, 9.0), (11.0, -8.0), (-3.0, -12.0)
"""Shifts beside the one found, cells, that tell how many cells a wrong shift explains by chance."""
EXPLAINED = 3.0
"""Spreads within which a shift explains a cell."""
LEAST_CELLS = 2000


def followed_drift(scan: Scan, baseline: Scan, use: Mask, near: Motion) -> Drift | None:
    """Find the lateral shift to the fixed baseline, begun at the motion of a scan shortly before.

    Gauss-Newton as in `lateral_drift`, on strips of rows, from the shift of `near`. It holds only where it can be shown
    that a search among all shifts could not have found another nearly as good: a shift elsewhere explains by chance as
    many of the explained cells as shifts some cells beside do, and at the very most all of the rest.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    use : ndarray of bool, shape (rows, columns)
        Cells of the baseline that may be used.
    near : Motion
        Of a scan shortly before, to the same baseline.

    Returns
    -------
    Drift or None
        None where nothing is proven: search then.
    """
    start = _shift_of(near, baseline)
    channels = _strips(scan, baseline, use, start)
    if not channels:
        return None
    every = max(1, sum(int(np.count_nonzero(np.isfinite(one.ref))) for one in channels) // len(channels) // SAMPLED)
    # the strips are sought in the baseline: it lies the other way
    found = refined(channels, every, (-start[0], -start[1]))
    if found is None or min(residuals.size for residuals in found.residuals) < LEAST_CELLS:
        return None
    bounds = [EXPLAINED * residual_spread(each) for each in found.residuals]
    explained = _explained(found.residuals, bounds)
    missing = len(channels) - explained
    for aside, along in DECOYS:
        decoy = [residuals_at(one, every, found.u + aside, found.v + along) for one in channels]
        if min(residuals.size for residuals in decoy) < LEAST_CELLS:
            return None
        if explained < SIMILAR * (_explained(decoy, bounds) + missing):
            return None
    pitch = baseline.grid.pitch_mm
    return Drift(-found.u * pitch, -found.v * pitch, found.sigma * pitch, found.conditioning)


def _explained(
    residuals: tuple[npt.NDArray[np.float64], ...] | list[npt.NDArray[np.float64]], bounds: list[float]
) -> float:
    return sum(float((np.abs(each) <= bound).mean()) for each, bound in zip(residuals, bounds, strict=True))


def _shift_of(near: Motion, baseline: Scan) -> tuple[float, float]:
    """Where a motion finds the middle of the baseline in the scan, cells along x and y from where it is."""
    grid = baseline.grid
    known = baseline.height[:: max(1, grid.rows // 64), :: max(1, grid.columns // 64)]
    level = float(np.nanmean(known)) if np.isfinite(known).any() else 0.0
    middle = np.array([grid.x_mm.mean(), grid.y_mm.mean(), level, 1.0])
    x, y, _, _ = (np.linalg.inv(near.matrix) @ middle - middle) / grid.pitch_mm
    return float(x), float(y)


def _strips(scan: Scan, baseline: Scan, use: Mask, start: tuple[float, float]) -> list[Pattern]:
    """Height and texture of the scan on strips of rows, to be sought in the baseline; not one without contrast."""
    rows, columns = baseline.grid.shape
    count = min(STRIPS, max(1, rows // STRIP_ROWS))
    size = rows // count if rows < 2 * count * STRIP_ROWS else STRIP_ROWS
    tops = [int((k + 0.5) * rows / count - size / 2) for k in range(count)]
    bands = side_by_side(*(partial(band_passed, scan, top, top + size) for top in tops))
    step = step_for(rows * columns)
    aside, along = round(start[0]), round(start[1])
    held = [_moved(use, top, size, aside, along) for top in tops]
    found = []
    for channel, whole in enumerate(bands_of_baseline(baseline)):
        spread = robust_sigma(np.stack([band[channel] for band in bands]))
        if not spread > 0 or not np.isfinite(whole[:: rows // 8 + 1]).any():
            continue
        scaled = [band[channel] * np.float32(1 / spread) for band in bands]
        parts = [pattern_of(band, whole, may, step, top) for band, may, top in zip(scaled, held, tops, strict=True)]
        found.append(
            Pattern(
                np.concatenate([one.ref for one in parts]),
                np.concatenate([one.gx for one in parts]),
                np.concatenate([one.gy for one in parts]),
                whole,
                np.concatenate([one.rows for one in parts]),
                step,
            )
        )
    return found


def _moved(use: Mask, top: int, size: int, aside: int, along: int) -> Mask:
    """Which cells of some rows of the scan show cells of the baseline that may be used."""
    rows, columns = use.shape
    held = np.zeros((size, columns), dtype=np.bool_)
    low, high = max(0, top - along), min(rows, top + size - along)
    left, right = max(0, -aside), min(columns, columns - aside)
    if low < high and left < right:
        held[low + along - top : high + along - top, left + aside : right + aside] = use[low:high, left:right]
    return held
