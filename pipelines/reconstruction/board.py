"""Board: a chessboard of known size, and the corners that a calibration counts on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Board"]


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard.

    Parameters
    ----------
    inner_corners : (int, int)
        Corners where four squares meet, along one side and along the other; the order does not matter.
    square_mm : float
        Side of a square.

    Raises
    ------
    ValueError
        If a side has fewer than 3 inner corners, or the square is not a positive length.
    """

    inner_corners: tuple[int, int]
    square_mm: float

    def __post_init__(self) -> None:
        if min(self.inner_corners) < 3:
            columns, rows = self.inner_corners
            raise ValueError(
                f"a board of {columns}x{rows} inner corners is too small: at least 3x3 are needed "
                "(a board of 6x7 squares has 5x6 inner corners)"
            )
        if not (math.isfinite(self.square_mm) and self.square_mm > 0):
            raise ValueError(f"the side of a square must be a positive number of mm, not {self.square_mm}")

    @staticmethod
    def of_squares(squares: tuple[int, int], square_mm: float) -> Board:
        """Make a board from its count of squares: 6x7 squares have 5x6 inner corners."""
        return Board((squares[0] - 1, squares[1] - 1), square_mm)

    @property
    def size_text(self) -> str:
        """Such as ``15x8``."""
        return f"{self.inner_corners[0]}x{self.inner_corners[1]}"

    @property
    def points_mm(self) -> npt.NDArray[np.float64]:
        """Inner corners in the board's own plane, shape (corner, 2) as (x, y), row by row."""
        columns, rows = self.inner_corners
        y, x = np.mgrid[0:rows, 0:columns]
        return np.stack([x.ravel(), y.ravel()], axis=1) * float(self.square_mm)
