"""How deep cracks are and how much is missing in them: each crack cell below the rim that is nearest to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from .crack_lines import CrackLines
from .distance import nearest_outside
from .smoothing import local_mean
from .squares import grown
from .values import Measurement

__all__ = ["CrackDepths", "crack_depths"]

RIM_CELLS = 5
"""Side of the square over which the rim's height is averaged."""
SHARED_ERROR_CELLS = 9.0
"""Neighbouring cells that share each error of a height (as for volumes)."""


@dataclass(frozen=True, slots=True, eq=False)
class CrackDepths:
    """Depth of the cracks of one scan.

    Parameters
    ----------
    depth_mm : ndarray of float32, shape (rows, columns)
        Height of the nearest rim less the cell's own; NaN outside cracks and where the floor was not seen.
    mean : Measurement
        Mean depth along the centre lines where the floor was seen there, mm.
    volume : Measurement
        Sum of the depths times the cell's area, mm3: what is missing below the rims, at least.
    seen : float
        Share of the crack cells whose floor was seen, 0 to 1; NaN without cracks.
    """

    depth_mm: npt.NDArray[np.float32]
    mean: Measurement
    volume: Measurement
    seen: float


def crack_depths(scan: Scan, mask: npt.NDArray[np.bool_], lines: CrackLines) -> CrackDepths:
    """Measure how far the floors of cracks lie below their rims.

    The rim's height is the mean of the plates' cells in a square of 5 cells about the cell outside the mask that is
    nearest: in the middle of a crack it changes from one plate's to the other's. A floor that camera or projector does
    not see adds nothing, so depth and volume are what there is at least; `seen` says how much of the cracks they rest
    on.

    The uncertainty of the volume is that of the heights, of which 9 neighbours share each error, and of the raster:
    the rim is known to half a cell (uniform), and along it the depth is that of the outermost cells.

    Parameters
    ----------
    scan : Scan
    mask : ndarray of bool, shape (rows, columns)
        As `crack_mask` gives it.
    lines : CrackLines
        Of that mask.

    Returns
    -------
    CrackDepths
    """
    nothing = Measurement(float("nan"), float("nan"))
    depth = np.full(mask.shape, np.nan, dtype=np.float32)
    plates = np.isfinite(scan.height) & ~grown(mask)
    level = local_mean(scan.height, RIM_CELLS, use=plates)
    rims = plates & np.isfinite(level)
    if not mask.any() or not rims.any():
        return CrackDepths(depth, nothing, nothing, float("nan") if not mask.any() else 0.0)
    row, column = nearest_outside(~rims)
    floor = mask & np.isfinite(scan.height)
    depth[floor] = level[row[floor], column[floor]] - scan.height[floor]
    cells = int(floor.sum())
    if cells == 0:
        return CrackDepths(depth, nothing, nothing, 0.0)
    grid = scan.grid
    sigma = float(np.sqrt(np.mean(np.square(scan.sigma[floor], dtype=np.float64))))
    outermost = floor & grown(~mask)
    raster = float(np.maximum(depth[outermost], 0).sum(dtype=np.float64)) * grid.cell_mm2 / np.sqrt(12)
    volume = Measurement(
        float(depth[floor].sum(dtype=np.float64)) * grid.cell_mm2,
        float(np.hypot(sigma * grid.cell_mm2 * np.sqrt(cells * SHARED_ERROR_CELLS), raster)),
    )
    return CrackDepths(depth, _along(depth, lines, sigma), volume, cells / int(mask.sum()))


def _along(depth: npt.NDArray[np.float32], lines: CrackLines, sigma: float) -> Measurement:
    """Mean depth along the centre lines, clear of junctions and ends, and its standard uncertainty."""
    row = np.clip(np.rint(lines.row[lines.inner]).astype(np.intp), 0, depth.shape[0] - 1)
    column = np.clip(np.rint(lines.column[lines.inner]).astype(np.intp), 0, depth.shape[1] - 1)
    values, weights = depth[row, column], lines.step[lines.inner]
    known = np.isfinite(values)
    if not known.any():
        return Measurement(float("nan"), float("nan"))
    mean = float(np.average(values[known], weights=weights[known]))
    # the rim's mean is as good as a few cells are; the line may lie half a cell beside the deepest
    independent = max(1.0, float(weights[known].sum()) / SHARED_ERROR_CELLS)
    return Measurement(mean, float(np.hypot(sigma, _beside(depth, row[known], column[known])) / np.sqrt(independent)))


def _beside(depth: npt.NDArray[np.float32], row: npt.NDArray[np.intp], column: npt.NDArray[np.intp]) -> float:
    """How much the depth differs from cell to cell along and across the lines, rms, mm."""
    below = np.minimum(row + 1, depth.shape[0] - 1)
    aside = np.minimum(column + 1, depth.shape[1] - 1)
    steps = np.concatenate([depth[below, column] - depth[row, column], depth[row, aside] - depth[row, column]])
    steps = steps[np.isfinite(steps)]
    return float(np.sqrt(np.mean(np.square(steps, dtype=np.float64)))) if len(steps) else 0.0
