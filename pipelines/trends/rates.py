"""Rates: how fast each cell moves, from moments that one scan after another adds to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["RateMoments"]

Floats = npt.NDArray[np.float64]
FEWEST = 5


class RateMoments:
    """Moments of a map through time (Welford 1962, in two variables): memory and work do not grow with the scans.

    Parameters
    ----------
    shape : (int, int)
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._count = np.zeros(shape)
        self._day, self._value, self._days, self._both, self._values = (np.zeros(shape) for _ in range(5))

    def add(self, day: float, values: npt.NDArray[np.floating]) -> None:
        """Add a map, shape as made, NaN where not measured; `day` in days after any fixed moment."""
        known = np.isfinite(values)
        self._count += known
        share = np.where(known, 1.0 / np.maximum(self._count, 1), 0.0)
        off_day = day - self._day
        off = np.where(known, values - self._value, 0.0)
        self._day += share * off_day
        self._value += share * off
        left = np.where(known, day - self._day, 0.0)
        self._days += off_day * left
        self._both += left * off
        self._values += off * np.where(known, values - self._value, 0.0)

    def rate(self) -> tuple[Floats, Floats]:
        """Give the least-squares rate per day and its standard uncertainty, each of the map's shape.

        The uncertainty is from how far the values scatter about their line. NaN in cells of fewer than 5 values.
        """
        enough = (self._count >= FEWEST) & (self._days > 0)
        days = np.where(enough, self._days, np.nan)
        rate = self._both / days
        rest = np.maximum(self._values - rate * self._both, 0.0)
        return rate, np.sqrt(rest / np.maximum(self._count - 2, 1) / days)
