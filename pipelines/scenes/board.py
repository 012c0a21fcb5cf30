"""Board and Plane: flat scenes, to calibrate on and to measure a rig with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Array, SceneTruth

__all__ = ["Chessboard", "Plane"]

PRINT_EDGE_MM = 0.008


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard in the plane z = 0, centred, on a white ground.

    Parameters
    ----------
    inner_corners : (int, int)
        Along x and along y: one less than the squares. Where one is even and the other odd the board has one reading.
    square_mm : float
    """

    inner_corners: tuple[int, int] = (14, 9)
    square_mm: float = 0.85

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """The board, its outer squares included."""
        half_x, half_y = ((corners + 1) * self.square_mm / 2 for corners in self.inner_corners)
        return -half_x, half_x, -half_y, half_y

    def at(self, x_mm: Array, y_mm: Array) -> Still:
        """Fix the places, any shape. A printed edge is 8 um soft (standard deviation of tanh's slope)."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        _, half_x, _, half_y = self.region_mm
        squares_x, squares_y = (corners + 1 for corners in self.inner_corners)
        light = _alternate(x + half_x, self.square_mm, squares_x) * _alternate(y + half_y, self.square_mm, squares_y)
        dark = np.where((np.abs(x) <= half_x) & (np.abs(y) <= half_y), 0.5 - 0.5 * light, 0.0)
        return Still(np.zeros(x.shape), 0.80 - 0.68 * dark)

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """Nothing ever changes."""
        return _still_truth(self.region_mm)


@dataclass(frozen=True, slots=True)
class Plane:
    """An even plane z = `z_mm` + x `slope_x` + y `slope_y`."""

    z_mm: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0
    reflects: float = 0.6

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """A square of 10 mm."""
        return -5.0, 5.0, -5.0, 5.0

    def at(self, x_mm: Array, y_mm: Array) -> Still:
        """Fix the places, any shape."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        return Still(self.z_mm + self.slope_x * x + self.slope_y * y, np.full(x.shape, self.reflects))

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """Nothing ever changes."""
        return _still_truth(self.region_mm)


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """A ground that time does not touch."""

    still_height: Array
    still_albedo: Array

    def height(self, elapsed_h: float) -> Array:
        """The same at every age."""
        return self.still_height

    def albedo(self, elapsed_h: float) -> Array:
        """The same at every age."""
        return self.still_albedo


def _alternate(along: Array, side: float, count: int) -> Array:
    """+1 and -1 in turn over `count` squares, crossing 0 softly at each edge between two of them."""
    edge = np.floor(along / side + 0.5)
    to_edge = along - edge * side
    between = (edge > 0) & (edge < count)
    soft = np.where(between, np.tanh(to_edge / PRINT_EDGE_MM), np.where(to_edge < 0, -1.0, 1.0))
    alternate: Array = np.where(edge % 2 == 0, 1.0, -1.0) * soft
    return alternate


def _still_truth(region: tuple[float, float, float, float]) -> SceneTruth:
    return SceneTruth(region, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
