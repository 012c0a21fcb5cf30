"""A height map moved rigidly and put on another grid: its cells are points, gridded as the points of a capture are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..scan import Scan
from ..slabs import in_slabs
from .lay_kernels import lay, to_site
from .surface import Laid, Sharing, fill_cells

__all__ = ["covering_grid", "regrid"]

Floats = npt.NDArray[np.float64]

APART = 1e6  # cells of one height map share their errors: several in one new cell are worth no more than one


def regrid(scan: Scan, matrix: Floats, grid: Grid) -> Scan:
    """Move a height map and put it on a grid.

    Each measured cell is a point that is moved to the centre of its new cell along the slope of its surface. Where two
    surfaces fall into one cell, one wins: nothing is averaged across a wall, and nothing is smeared down it as
    interpolation between cells would. Single cells that stay empty between two of the same surface are filled.

    Parameters
    ----------
    scan : Scan
    matrix : ndarray of float64, shape (4, 4)
        Rigid motion: x_new = matrix @ x_scan, homogeneous, mm.
    grid : Grid
        Of about the same pitch or a coarser one; a finer one stays empty in between.

    Returns
    -------
    Scan
        On `grid`; sigma is carried, not averaged down.
    """
    size = scan.height.shape
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    spread = np.where(np.isfinite(scan.sigma), scan.sigma, np.float32(1))  # without sigmas all cells count alike
    planes = np.stack([x, y, scan.height, spread]).astype(np.float32)
    laid = Laid.room(size)
    place = (grid.x0_mm, grid.y0_mm, grid.pitch_mm)
    half = scan.grid.pitch_mm / grid.pitch_mm / 2
    to_site(planes, np.isfinite(scan.height), np.ascontiguousarray(matrix[:3], dtype=np.float64), 0, size[0])
    in_slabs(
        size[0],
        lambda a, b: lay(planes, a, b, place, grid.shape, (half, half), *(array[a:b] for array in laid.arrays)),
    )
    height, sigma, *light = fill_cells(laid, scan.texture, scan.level, grid, (half, half), Sharing(APART))
    if not np.isfinite(scan.sigma).any():
        sigma[:] = np.nan
    return Scan(grid, scan.time, height, sigma, light[0], light[1], scan.calibration_id)


def covering_grid(
    scans: Sequence[Scan], matrices: Sequence[Floats], pitch_mm: float, centre_mm: tuple[float, float] | None = None
) -> Grid:
    """Give the grid that covers the measured cells of moved height maps.

    Parameters
    ----------
    scans : sequence of Scan
    matrices : sequence of ndarray of float64, shape (4, 4)
        How each is moved.
    pitch_mm : float
    centre_mm : (float, float), optional
        Where the centre of a cell is to lie; half a pitch from the origin if left out. Cells that are moved by just
        half a cell fall into one or the other by rounding: give a moved cell's centre where there is one to give.

    Raises
    ------
    ValueError
        If nothing was measured in any.
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for scan, matrix in zip(scans, matrices, strict=True):
        rows, columns = np.nonzero(np.isfinite(scan.height))
        if rows.size == 0:
            continue
        points = np.stack([scan.grid.x_mm[columns], scan.grid.y_mm[rows], scan.height[rows, columns]])
        moved = matrix[:2, :3] @ points + matrix[:2, 3:]
        low, high = np.minimum(low, moved.min(axis=1)), np.maximum(high, moved.max(axis=1))
    if not np.isfinite(low).all():
        raise ValueError("no cell was measured in any of them")
    centre = np.array((pitch_mm / 2, pitch_mm / 2) if centre_mm is None else centre_mm)
    first, last = (np.floor((each - centre) / pitch_mm + 0.5).astype(int) for each in (low, high))
    return Grid(
        rows=int(last[1] - first[1]) + 1,
        columns=int(last[0] - first[0]) + 1,
        pitch_mm=pitch_mm,
        x0_mm=float(centre[0] + first[0] * pitch_mm),
        y0_mm=float(centre[1] + first[1] * pitch_mm),
    )
