"""Boards of known size, and the corners that a calibration counts on: chessboards and ChArUco boards."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Board", "CharucoBoard"]


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
        return _lattice_mm(self.inner_corners, self.square_mm)

    def as_mapping(self) -> dict[str, Any]:
        """What ``calibration.json`` says of it."""
        return {"inner_corners": list(self.inner_corners), "square_mm": self.square_mm}


@dataclass(frozen=True, slots=True)
class CharucoBoard:
    """A chessboard with a numbered marker in each white square, so that a part of it is enough.

    Parameters
    ----------
    squares : (int, int)
        Columns and rows of squares, in the order in which the board was made: its markers are numbered by it.
    square_mm, marker_mm : float
        Sides of a square and of a marker, as printed.
    dictionary : str
        Of OpenCV's markers, such as ``DICT_5X5_100``; ``5X5_100`` will do.

    Raises
    ------
    ValueError
        If a side has fewer than 3 squares, a length is not positive, or the marker is no smaller than its square.
    """

    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    dictionary: str

    def __post_init__(self) -> None:
        if min(self.squares) < 3:
            raise ValueError(f"a ChArUco board of {self.size_text} squares is too small: at least 3x3 are needed")
        if not (math.isfinite(self.square_mm) and self.square_mm > 0):
            raise ValueError(f"the side of a square must be a positive number of mm, not {self.square_mm}")
        if not 0 < self.marker_mm < self.square_mm:
            raise ValueError(
                f"the side of a marker must be smaller than its square of {self.square_mm} mm, not {self.marker_mm}"
            )

    @property
    def inner_corners(self) -> tuple[int, int]:
        """Corners where four squares meet: columns, rows."""
        return self.squares[0] - 1, self.squares[1] - 1

    @property
    def size_text(self) -> str:
        """Such as ``7x5``, squares."""
        return f"{self.squares[0]}x{self.squares[1]}"

    @property
    def points_mm(self) -> npt.NDArray[np.float64]:
        """Inner corners in the board's own plane, shape (corner, 2) as (x, y), row by row: OpenCV's numbering."""
        return _lattice_mm(self.inner_corners, self.square_mm)

    def as_mapping(self) -> dict[str, Any]:
        """What ``calibration.json`` says of it."""
        return {
            "kind": "charuco",
            "inner_corners": list(self.inner_corners),
            "square_mm": self.square_mm,
            "marker_mm": self.marker_mm,
            "dictionary": self.dictionary,
        }


def _lattice_mm(inner_corners: tuple[int, int], square_mm: float) -> npt.NDArray[np.float64]:
    columns, rows = inner_corners
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([x.ravel(), y.ravel()], axis=1) * float(square_mm)
