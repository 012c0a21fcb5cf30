"""Grid: where the cells of a height map are, in mm, in the site frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Grid"]


@dataclass(frozen=True, slots=True)
class Grid:
    """A regular raster in the site frame: row 0 at the smallest y, column 0 at the smallest x.

    Parameters
    ----------
    rows, columns : int
        Number of cells along y and along x.
    pitch_mm : float
        Side of a square cell.
    x0_mm, y0_mm : float
        Centre of the cell in row 0, column 0.
    """

    rows: int
    columns: int
    pitch_mm: float
    x0_mm: float = 0.0
    y0_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(f"a grid needs at least one cell, not {self.rows} x {self.columns}")
        if not (np.isfinite(self.pitch_mm) and self.pitch_mm > 0):
            raise ValueError(f"grid pitch must be a positive number of mm, not {self.pitch_mm}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    @property
    def cell_mm2(self) -> float:
        """Area of one cell."""
        return self.pitch_mm**2

    @property
    def x_mm(self) -> npt.NDArray[np.float64]:
        """Cell centres along x, shape (columns,)."""
        return self.x0_mm + self.pitch_mm * np.arange(self.columns, dtype=np.float64)

    @property
    def y_mm(self) -> npt.NDArray[np.float64]:
        """Cell centres along y, shape (rows,)."""
        return self.y0_mm + self.pitch_mm * np.arange(self.rows, dtype=np.float64)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Outer edges (x_min, x_max, y_min, y_max)."""
        half = self.pitch_mm / 2
        return (
            self.x0_mm - half,
            self.x0_mm + (self.columns - 0.5) * self.pitch_mm,
            self.y0_mm - half,
            self.y0_mm + (self.rows - 0.5) * self.pitch_mm,
        )
