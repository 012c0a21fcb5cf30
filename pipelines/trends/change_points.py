"""Change points: when a series took another course, looking back (PELT of Killick, Fearnhead and Eckley 2012)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .trend import thinned

__all__ = ["ChangePoint", "change_points"]

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]

MOST = 200
"""More values are taken as medians of runs: the search grows with their square."""
FEWEST = 5
"""Values on each side of a change."""
PENALTY = 4.0
"""Times log n: three parameters of a piece by Schwarz's criterion, and one for looking at every place."""

MOST_ALIKE = 0.9


@dataclass(frozen=True, slots=True)
class ChangePoint:
    """Where one straight line ends and another begins.

    Parameters
    ----------
    time : datetime64
        Of the first value of the new course.
    shift, sigma : float
        How far the new line lies from the old one there, and its standard uncertainty.
    rate_before, rate_after : float
        Of the two lines, per day.
    """

    time: np.datetime64
    shift: float
    sigma: float
    rate_before: float
    rate_after: float


def change_points(times: Times, values: Floats) -> tuple[ChangePoint, ...]:
    """Find where a series takes another course: another level, another rate, or both.

    The series is cut into straight lines so that their squared residuals and a penalty of ``4 log n`` noise variances
    per piece are least. The noise and how it follows itself from value to value (r) are estimated from the differences
    of neighbours and of those next to them, which jumps and trends hardly touch; its variance counts (1 + r) / (1 - r)
    times.

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
        Ascending.
    values : ndarray of float64, shape (n,)
        NaN where not measured.

    Returns
    -------
    tuple of ChangePoint
        Oldest first; none in fewer than 10 values.
    """
    good = np.isfinite(values) & ~np.isnat(times)
    at, value, _ = thinned(times[good], values[good], values[good], MOST)
    if len(at) < 2 * FEWEST or np.ptp(value) <= 0:
        return ()
    day = (at - at[0]) / np.timedelta64(1, "D")
    noise, wide = _noise(value)
    if noise <= 0:
        return ()
    lines = _Lines(day, (value - value.mean()) / noise)
    pieces = _pieces(_cut(lines, wide * PENALTY * math.log(len(day))))
    found = []
    for (start, middle), (_, end) in pairwise(pieces):
        before, before_variance, rate_before = lines.at(start, middle, day[middle])
        after, after_variance, rate_after = lines.at(middle, end, day[middle])
        sigma = math.sqrt(wide * (before_variance + after_variance))
        found.append(
            ChangePoint(
                at[middle],
                float(noise * (after - before)),
                noise * sigma,
                float(noise * rate_before),
                float(noise * rate_after),
            )
        )
    return tuple(found)


class _Lines:
    """Straight lines through any run of values, from sums: each costs the same."""

    def __init__(self, day: Floats, value: Floats) -> None:
        scale = max(float(day[-1]), 1e-300)
        self.value, self.scale = value, scale
        t = day / scale - 0.5
        columns = (np.ones_like(t), t, t * t, value, t * value, value * value)
        self.sums = [np.concatenate([[0.0], np.cumsum(column)]).tolist() for column in columns]

    def _moments(self, start: int, end: int) -> tuple[float, float, float, float, float, float]:
        n, t, tt, v, tv, vv = (sums[end] - sums[start] for sums in self.sums)
        return n, t / n, max(tt - t * t / n, 0.0), v / n, tv - t * v / n, vv - v * v / n

    def error(self, start: int, end: int) -> float:
        """Sum of squared residuals of the line through values `start` to `end`."""
        _, _, tt, _, tv, vv = self._moments(start, end)
        return vv - tv * tv / tt if tt > 0 else vv

    def at(self, start: int, end: int, day: float) -> tuple[float, float, float]:
        """Give the line's value at a time, its variance in noise variances, and its rate per day."""
        n, mean_t, tt, mean_v, tv, _ = self._moments(start, end)
        slope, away = (tv / tt if tt > 0 else 0.0), day / self.scale - 0.5 - mean_t
        return mean_v + slope * away, 1 / n + (away * away / tt if tt > 0 else 0.0), slope / self.scale


def _cut(lines: _Lines, penalty: float) -> list[int]:
    """Give the ends of the pieces, the last of all values among them."""
    from ruptures import Pelt
    from ruptures.base import BaseCost

    class Cost(BaseCost):  # type: ignore[misc] # ships no types
        model, min_size, signal = "", FEWEST, lines.value[:, np.newaxis]

        def fit(self, signal: Floats) -> Cost:
            return self

        def error(self, start: int, end: int) -> float:
            return lines.error(start, end)

    search = Pelt(custom_cost=Cost(), min_size=FEWEST, jump=1).fit(lines.value[:, np.newaxis])
    return [int(end) for end in search.predict(pen=penalty)]


def _pieces(ends: list[int]) -> list[tuple[int, int]]:
    return list(zip([0, *ends[:-1]], ends, strict=True))


def _noise(value: Floats) -> tuple[float, float]:
    """Standard deviation of the noise, and (1 + r) / (1 - r) of its lag-one correlation r.

    Differences over one and two steps have variances in the ratio 1 to 1 + r where noise follows itself like that.
    """
    near, far = (_robust_variance(value[step:] - value[:-step]) for step in (1, 2))
    if near <= 0:
        return float(value.std()), 1.0
    r = min(max(far / near - 1, 0.0), MOST_ALIKE)
    return math.sqrt(near / (2 * (1 - r))), (1 + r) / (1 - r)


def _robust_variance(values: Floats) -> float:
    return (1.4826 * float(np.median(np.abs(values - np.median(values))))) ** 2
