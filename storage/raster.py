"""Raster: a height map as a foreign file holds it, before it is a Scan: any cell size, any unit, perhaps no time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import LEVEL_NONE, Grid, Instant, Scan

__all__ = ["MM", "Raster", "mm_per", "scan_of"]

MM = {"mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "m": 1000.0, "meter": 1000.0, "metre": 1000.0, "metres": 1000.0}
MM |= {"um": 1e-3, "micrometer": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6, "cm": 10.0, "å": 1e-7, "pm": 1e-9}
SQUARE = 1e-3
"""Cells whose sides differ by less than this share are square: instruments round their sizes."""


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """A height map from elsewhere.

    Parameters
    ----------
    height : ndarray of float64, shape (rows, columns)
        mm, row 0 at the smallest y; NaN means not measured.
    pitch_mm : (float, float)
        Sides of a cell along x and y.
    corner_mm : (float, float)
        Centre x, y of the cell in row 0, column 0.
    time : Instant or None
        None where the file says none.
    local : datetime or None
        The file's time, where it names no zone.
    calibration_id : str
    layers : mapping of str to ndarray, shape (rows, columns)
        ``sigma`` in mm, ``texture`` and ``level`` where the file has them.
    note : str
        What people must be told of how the file was read; empty where there is nothing.
    """

    height: npt.NDArray[np.float64]
    pitch_mm: tuple[float, float]
    corner_mm: tuple[float, float] = (0.0, 0.0)
    time: Instant | None = None
    local: datetime | None = None
    calibration_id: str = ""
    layers: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    note: str = ""

    @property
    def grid(self) -> Grid:
        """The grid of the file itself; of cells that are not square, one whose pitch is their smaller side."""
        rows, columns = self.height.shape
        wide, high = self.pitch_mm
        if abs(wide - high) <= SQUARE * wide:
            return Grid(rows, columns, wide, *self.corner_mm)
        pitch = min(wide, high)
        rows, columns = (round((count - 1) * side / pitch) + 1 for count, side in ((rows, high), (columns, wide)))
        return Grid(rows, columns, pitch, *self.corner_mm)


def scan_of(raster: Raster, path: Path, time: Instant, grid: Grid | None = None) -> Scan:
    """Lay a raster onto a grid: as it is where the cells agree, interpolated between four cells where they do not.

    A cell beside one that was not measured is not measured then.

    Parameters
    ----------
    raster : Raster
    path : Path
        Named in messages.
    time : Instant
    grid : Grid, optional
        The file's own, unless given.

    Raises
    ------
    InputError
        If the raster is no height map, or no cell of the grid lies in it.
    """
    if raster.height.ndim != 2:
        raise InputError(f"{path}: height must be (row, column), not of shape {raster.height.shape}")
    grid = grid or raster.grid
    if not _agrees(raster, grid):
        raster = _resampled(raster, grid)
        if not np.isfinite(raster.height).any():
            low_x, high_x, low_y, high_y = grid.extent_mm
            raise InputError(
                f"{path}: lies beside the store's cells, which reach from {low_x:g} to {high_x:g} mm in x and from "
                f"{low_y:g} to {high_y:g} mm in y"
            )
    cells = np.ascontiguousarray(raster.height, dtype=np.float32)
    measured = np.isfinite(cells)
    cells[~measured] = np.nan
    sigma = raster.layers.get("sigma", np.full(grid.shape, np.nan))
    texture = raster.layers.get("texture", np.zeros(grid.shape))
    level = raster.layers.get("level", np.where(measured, 0, LEVEL_NONE))
    return Scan(
        grid,
        time,
        cells,
        np.ascontiguousarray(sigma, dtype=np.float32),
        np.ascontiguousarray(texture, dtype=np.uint8),
        np.ascontiguousarray(level, dtype=np.uint8),
        raster.calibration_id,
    )


def mm_per(path: Path, unit: str) -> float:
    """Give how many mm a unit of length is.

    Raises
    ------
    InputError
        If it is not known.
    """
    if unit.strip().lower() not in MM:
        raise InputError(f"{path}: length unit {unit!r} is not known: use one of mm, m, cm, um, nm")
    return MM[unit.strip().lower()]


def _agrees(raster: Raster, grid: Grid) -> bool:
    own, far = raster.grid, max(grid.shape)
    near = 1e-3 * grid.pitch_mm
    return (
        raster.height.shape == grid.shape
        and abs(own.pitch_mm - grid.pitch_mm) * far <= near
        and abs(own.x0_mm - grid.x0_mm) <= near
        and abs(own.y0_mm - grid.y0_mm) <= near
    )


def _resampled(raster: Raster, grid: Grid) -> Raster:
    from scipy.ndimage import map_coordinates

    row = (grid.y_mm - raster.corner_mm[1]) / raster.pitch_mm[1]
    column = (grid.x_mm - raster.corner_mm[0]) / raster.pitch_mm[0]
    at = np.stack(np.meshgrid(row, column, indexing="ij"))

    def onto(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        found: npt.NDArray[np.float64] = map_coordinates(values.astype(np.float64), at, order=1, cval=np.nan)
        return found

    layers = {"sigma": onto(raster.layers["sigma"])} if "sigma" in raster.layers else {}
    if "texture" in raster.layers:
        layers["texture"] = np.nan_to_num(np.rint(onto(raster.layers["texture"])))
    corner = grid.x0_mm, grid.y0_mm
    return replace(raster, height=onto(raster.height), pitch_mm=(grid.pitch_mm,) * 2, corner_mm=corner, layers=layers)
