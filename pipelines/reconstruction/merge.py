"""Views of one surface merged on one grid: what agrees is averaged, two surfaces never are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..grid import Grid
from ..scan import LEVEL_NONE, Scan
from .merge_kernels import merge_block

__all__ = ["LEVEL_CONTESTED", "Merged", "View", "edge_weight", "merge"]

LEVEL_CONTESTED = 254
"""`Scan.level` of a merged cell whose views see two surfaces, as many each: the one that was taken may be the wrong."""
BLOCK = 256


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A height map, placed, and how well that is known.

    Parameters
    ----------
    scan : Scan
        On a grid whose cells are cells of the merged grid.
    sigma_z_mm, sigma_xy_mm : float
        Standard uncertainties of its place, which all its cells share; the lateral one counts where the surface slopes.
    bow_mm : float
        The part of the scan's sigma that all scans of one calibration have in common (`bow_mm`).
    weight : ndarray of float32, shape (rows, columns), optional
        Share with which a cell counts beside its inverse variance, 0 to 1: see `edge_weight`.
    """

    scan: Scan
    sigma_z_mm: float = 0.0
    sigma_xy_mm: float = 0.0
    bow_mm: float = 0.0
    weight: npt.NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """The merged height map; `views` (rows, columns) uint8 counts the views that agreed on each cell."""

    scan: Scan
    views: npt.NDArray[np.uint8]

    @property
    def contested(self) -> npt.NDArray[np.bool_]:
        """Cells whose views see two surfaces, as many each."""
        return np.equal(self.scan.level, LEVEL_CONTESTED)


def edge_weight(scan: Scan, cells: int) -> npt.NDArray[np.float32]:
    """Weights that fall to 0 at the border of what a scan covers, over that many cells.

    Where two tiles overlap, one fades into the other then, and a small difference between them leaves no step. Holes
    within the field have no border in this sense.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
    """
    covered = ndimage.binary_fill_holes(np.isfinite(scan.height))
    depth = ndimage.distance_transform_edt(np.pad(covered, 1))[1:-1, 1:-1]
    weight: npt.NDArray[np.float32] = np.minimum(depth / (cells + 1), 1).astype(np.float32)
    return weight


def merge(views: Sequence[View], grid: Grid) -> Merged:
    """Merge views of one surface.

    Two views of a cell agree where they differ by no more than 4 combined sigmas and half of what the surface falls
    to its next cells. The largest set that agrees with one view counts: its mean with inverse-variance weights.
    Where two sets are as large, the one whose sigma is less than half of the other's counts, else the upper one,
    and `level` says `LEVEL_CONTESTED`.

    The sigma of a cell is that of the weighted mean. What the views have each for themselves (their own noise, their
    place) gets less by averaging; what they share because of one calibration does not.

    Parameters
    ----------
    views : sequence of View
    grid : Grid
        Of the result.

    Returns
    -------
    Merged
        Its scan bears the earliest time, and the calibration's id where all views have the same one.

    Raises
    ------
    ValueError
        If there is no view, or a view's cells are not cells of the grid.
    """
    if not views:
        raise ValueError("nothing to merge")
    places = [_place(view.scan.grid, grid) for view in views]
    ids = [view.scan.calibration_id for view in views]
    kind = np.array([ids.index(name) for name in ids])
    pose = np.array([(view.sigma_z_mm, view.sigma_xy_mm) for view in views], dtype=np.float64)
    bow = np.array([view.bow_mm for view in views], dtype=np.float64)
    out: tuple[npt.NDArray[Any], ...] = (
        np.full(grid.shape, np.nan, np.float32),
        np.full(grid.shape, np.nan, np.float32),
        np.zeros(grid.shape, np.uint8),
        np.full(grid.shape, LEVEL_NONE, np.uint8),
        np.zeros(grid.shape, np.uint8),
    )
    for top in range(0, grid.rows, BLOCK):
        for left in range(0, grid.columns, BLOCK):
            box = (top, min(top + BLOCK, grid.rows), left, min(left + BLOCK, grid.columns))
            here = [k for k, place in enumerate(places) if _meets(views[k].scan.grid, place, box)]
            if not here:
                continue
            cut = [_cut(views[k], places[k], box) for k in here]
            stacks = [np.stack(each) for each in zip(*cut, strict=True)]
            # one cell around the block shows how the surface falls at its border
            made = tuple(np.empty(stacks[0].shape[1:], array.dtype) for array in out)
            merge_block(*stacks, pose[here], bow[here], kind[here], grid.pitch_mm, np.uint8(LEVEL_CONTESTED), made)
            for whole, part in zip(out, made, strict=True):
                whole[box[0] : box[1], box[2] : box[3]] = part[1:-1, 1:-1]
    height, sigma, texture, level, count = out
    first = min(view.scan.time for view in views)
    scan = Scan(grid, first, height, sigma, texture, level, ids[0] if len(set(ids)) == 1 else "")
    return Merged(scan, count)


def _place(part: Grid, whole: Grid) -> tuple[int, int]:
    """Row and column of the whole grid where the part's first cell lies."""
    row, column = (part.y0_mm - whole.y0_mm) / whole.pitch_mm, (part.x0_mm - whole.x0_mm) / whole.pitch_mm
    off = max(abs(row - round(row)), abs(column - round(column)))
    if abs(part.pitch_mm - whole.pitch_mm) > 1e-9 or off > 1e-3:
        raise ValueError(f"the cells of {part} are no cells of {whole}: regrid the view first")
    return round(row), round(column)


def _meets(part: Grid, place: tuple[int, int], box: tuple[int, int, int, int]) -> bool:
    top, bottom, left, right = box
    row, column = place
    return row < bottom and row + part.rows > top and column < right and column + part.columns > left


def _cut(view: View, place: tuple[int, int], box: tuple[int, int, int, int]) -> tuple[npt.NDArray[Any], ...]:
    """The view's arrays over a box of the whole grid and one cell around it, nothing measured beyond the view."""
    top, bottom, left, right = box
    scan = view.scan
    shape = (bottom - top + 2, right - left + 2)
    weight = np.ones(scan.grid.shape, np.float32) if view.weight is None else view.weight
    sources: tuple[tuple[npt.NDArray[Any], float], ...] = (
        (scan.height, np.nan), (scan.sigma, np.nan), (scan.texture, 0), (scan.level, LEVEL_NONE), (weight, 0),
    )  # fmt: skip
    row, column = top - 1 - place[0], left - 1 - place[1]  # where the box begins in the view
    r0, r1 = max(row, 0), min(row + shape[0], scan.grid.rows)
    c0, c1 = max(column, 0), min(column + shape[1], scan.grid.columns)
    parts = []
    for source, empty in sources:
        inner = source[r0:r1, c0:c1] if r1 > r0 and c1 > c0 else source[:0, :0]
        before = (max(r0 - row, 0), max(c0 - column, 0)) if inner.size else (0, 0)
        after = (shape[0] - before[0] - inner.shape[0], shape[1] - before[1] - inner.shape[1])
        parts.append(np.pad(inner, list(zip(before, after, strict=True)), constant_values=empty))
    return tuple(parts)
