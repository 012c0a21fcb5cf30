"""How large each crack of a scan is: length, width, depth, area and volume, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..scan import Scan
from .crack_depths import SHARED_ERROR_CELLS, CrackDepths
from .crack_lines import length_sigma
from .crack_widths import CrackOpenings, opening_sigma
from .values import Measurement

__all__ = ["CrackSize", "crack_cells", "crack_sizes"]

Ints = npt.NDArray[np.intp]
RUN = 5
"""The widest place is that of the median of so many neighbouring widths: one profile alone may be wrong."""
NOT_MEASURED = Measurement(float("nan"), float("nan"))


@dataclass(frozen=True, slots=True)
class CrackSize:
    """One crack of one scan.

    Parameters
    ----------
    length : Measurement
        Of its centre line, mm.
    width : Measurement
        Mean distance between its edges, weighted by length, clear of junctions and ends, mm.
    width_p95_mm, width_max_mm : float
        95 % of its length is narrower; the widest place (median of 5 neighbouring widths).
    widest_mm : (float, float)
        x and y of that place, site frame.
    depth : Measurement
        Mean depth along the centre line below the nearest rim, where the floor was seen, mm: at least.
    area : Measurement
        mm2.
    area_fraction : float
        Share of the region's area.
    volume : Measurement
        mm3, where the floor was seen: at least.
    seen : float
        Share of its cells whose floor was seen, on which depth and volume rest.
    """

    length: Measurement
    width: Measurement
    width_p95_mm: float
    width_max_mm: float
    widest_mm: tuple[float, float]
    depth: Measurement
    area: Measurement
    area_fraction: float
    volume: Measurement
    seen: float


def crack_cells(mask: npt.NDArray[np.bool_], openings: CrackOpenings, identity: Ints) -> npt.NDArray[np.int32]:
    """Give each crack cell to the crack whose centre line is nearest; 0 outside cracks."""
    from scipy.spatial import cKDTree

    cells = np.zeros(mask.shape, dtype=np.int32)
    lines = openings.lines
    if lines.row.size and mask.any():
        at = np.argwhere(mask)
        _, nearest = cKDTree(np.stack([lines.row, lines.column], axis=1)).query(at)
        cells[mask] = identity[nearest]
    return cells


def crack_sizes(
    scan: Scan,
    cells: npt.NDArray[np.int32],
    openings: CrackOpenings,
    depths: CrackDepths,
    identity: Ints,
    region_cells: int,
) -> dict[int, CrackSize]:
    """Measure each crack.

    Parameters
    ----------
    scan : Scan
    cells : ndarray of int32, shape (rows, columns)
        As `crack_cells` gives it.
    openings : CrackOpenings
    depths : CrackDepths
    identity : ndarray of intp, shape (n,)
        Crack of each point of ``openings.lines``.
    region_cells : int
        Cells of the region, for the area fraction.

    Returns
    -------
    dict of int to CrackSize
        By identity; NaN where something was not seen.
    """
    grid, lines = scan.grid, openings.lines
    count = int(max(identity.max(initial=0), cells.max(initial=0))) + 1
    inside = cells > 0
    name = cells[inside]
    depth = depths.depth_mm[inside]
    known = np.isfinite(depth)
    rim = ~ndimage.binary_erosion(inside, structure=np.ones((3, 3)), border_value=1)[inside]

    def total(values: npt.NDArray[np.floating], where: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
        return np.bincount(name[where], weights=values[where], minlength=count).astype(np.float64)

    number = np.bincount(name, minlength=count)
    seen = np.bincount(name[known], minlength=count)
    missing = total(depth, known)
    raster = total(np.maximum(depth, 0), known & rim) / np.sqrt(12)
    noise = np.sqrt(total(np.square(scan.sigma[inside], dtype=np.float64), known) * SHARED_ERROR_CELLS)
    row = np.clip(np.rint(lines.row).astype(np.intp), 0, grid.rows - 1)
    column = np.clip(np.rint(lines.column).astype(np.intp), 0, grid.columns - 1)
    along = np.where(lines.inner, depths.depth_mm[row, column], np.nan)
    profiles = identity[lines.inner]
    found = {}
    for one in map(int, np.unique(identity[identity > 0])):
        mine = identity == one
        length = float(lines.step[mine].sum()) * grid.pitch_mm
        half = float(lines.half_width[mine].mean()) * grid.pitch_mm
        width, p95, widest, place = _widths(openings, profiles == one, grid.pitch_mm)
        edge = opening_sigma(openings, grid.pitch_mm, profiles == one)
        cell = grid.cell_mm2
        found[one] = CrackSize(
            length=Measurement(length, length_sigma(length, 2, half, grid.pitch_mm)),
            width=width,
            width_p95_mm=p95,
            width_max_mm=widest,
            widest_mm=place,
            depth=_depth(along[mine], lines.step[mine], depths.mean.sigma, lines.inner.sum()),
            area=Measurement(float(number[one]) * cell, max(length * edge, cell)),
            area_fraction=float(number[one]) / max(region_cells, 1),
            volume=Measurement(float(missing[one]) * cell, float(np.hypot(noise[one], raster[one])) * cell)
            if seen[one]
            else NOT_MEASURED,
            seen=float(seen[one] / number[one]) if number[one] else float("nan"),
        )
    return found


def _depth(
    along: npt.NDArray[np.floating], step: npt.NDArray[np.float64], sigma_of_all: float, points_of_all: int
) -> Measurement:
    """Mean depth along one crack; its uncertainty is that of all cracks' mean, of fewer points."""
    known = np.isfinite(along)
    if not known.any():
        return NOT_MEASURED
    fewer = np.sqrt(max(1.0, points_of_all / float(known.sum())))
    return Measurement(float(np.average(along[known], weights=step[known])), float(sigma_of_all * fewer))


def _widths(
    openings: CrackOpenings, mine: npt.NDArray[np.bool_], pitch_mm: float
) -> tuple[Measurement, float, float, tuple[float, float]]:
    """Mean, 95 % and greatest width, and where that is."""
    use = mine & np.isfinite(openings.opening_mm)
    nan = float("nan")
    if not use.any():
        return NOT_MEASURED, nan, nan, (nan, nan)
    width, step = openings.opening_mm[use], openings.step_mm[use]
    mean = Measurement(float(np.average(width, weights=step)), opening_sigma(openings, pitch_mm, use))
    order = np.argsort(width, kind="stable")
    p95 = float(width[order][np.searchsorted(np.cumsum(step[order]), 0.95 * step.sum())])
    smooth = ndimage.median_filter(width, min(RUN, width.size), mode="nearest")
    at = int(np.argmax(smooth))
    return mean, p95, float(smooth[at]), (float(openings.x_mm[use][at]), float(openings.y_mm[use][at]))
