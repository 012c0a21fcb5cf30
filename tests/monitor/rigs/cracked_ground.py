"""CrackedGround: a scene of rough ground with cracks of known width, depth and tips, one of which grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines.scenes import SceneTruth
from pipelines.scenes.noise import fractal

__all__ = ["CrackedGround", "StraightCrack"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StraightCrack:
    """From one point to another, mm, with round tips and a parabolic floor; its end grows by `growth` mm an hour."""

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    depth: float
    growth: float = 0.0

    def tips(self, age_h: float) -> Floats:
        """Where it begins and ends, shape (2, 2)."""
        start, end = np.array(self.start), np.array(self.end)
        along = (end - start) / np.hypot(*(end - start))
        grown = end + along * self.growth * age_h
        return np.array([start - along * self.width / 2, grown + along * self.width / 2])

    def length(self, age_h: float) -> float:
        """From tip to tip, mm."""
        return float(np.hypot(*np.diff(self.tips(age_h), axis=0)[0]))

    def away(self, x: Floats, y: Floats, age_h: float) -> Floats:
        """Distance to its centre line, mm."""
        first, last = self.tips(age_h)
        along = (last - first) / np.hypot(*(last - first))
        half = self.width / 2
        where = np.clip((x - first[0]) * along[0] + (y - first[1]) * along[1], half, self.length(age_h) - half)
        found: Floats = np.hypot(x - first[0] - where * along[0], y - first[1] - where * along[1])
        return found


CRACKS = (
    StraightCrack((-4.0, -3.0), (-1.0, -2.2), 0.15, 0.12, growth=0.1),
    StraightCrack((0.8, 2.6), (4.2, 0.4), 0.25, 0.20),
    StraightCrack((-4.2, 2.4), (-0.6, 0.2), 0.40, 0.32),
    StraightCrack((0.6, -3.0), (4.0, -1.6), 0.20, 0.60),
)
"""The last is too deep for both, the camera's and the projector's view of its floor."""


@dataclass(frozen=True, kw_only=True)
class CrackedGround:
    """See `Scene`."""

    seed: int = 0

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """All of it may change."""
        return -5.0, 5.0, -4.0, 4.0

    def at(self, x_mm: Floats, y_mm: Floats) -> _Ground:
        """Fix the places."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        return _Ground(self.seed, x, y)

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """`CRACKS` are the truth."""
        raise NotImplementedError("compare with CRACKS")


class _Ground:
    def __init__(self, seed: int, x: Floats, y: Floats) -> None:
        self._x, self._y = x, y
        self._relief = 0.15 * fractal(x, y, seed, 4.0, 4) + 0.02 * fractal(x, y, seed + 1, 0.3, 3, 0.6)
        self._albedo = np.clip(0.45 + 0.16 * fractal(x, y, seed + 2, 0.16, 2, 0.7), 0.15, 0.8)

    def height(self, elapsed_h: float) -> Floats:
        floor = np.zeros_like(self._relief)
        for crack in CRACKS:
            away = crack.away(self._x, self._y, elapsed_h)
            floor = np.maximum(floor, crack.depth * (1 - np.minimum(2 * away / crack.width, 1) ** 2))
        height: Floats = self._relief - floor
        return height

    def albedo(self, elapsed_h: float) -> Floats:
        return self._albedo
