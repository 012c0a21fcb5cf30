"""Trend: a robust slope with its interval, on times as irregular as they are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

__all__ = ["Trend", "inflation", "thinned", "trend"]

MOST_POINTS = 1500
"""Theil-Sen looks at every pair: above this many points an even subset of them is taken."""
Z_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Trend:
    """A straight line through a series.

    Parameters
    ----------
    slope_per_day : float
        Change of the metric per day; NaN where there are fewer than 3 values at different times.
    low, high : float
        95 % interval of the slope.
    intercept : float
        Value of the line at the first time.
    count : int
        Number of values used.
    """

    slope_per_day: float
    low: float
    high: float
    intercept: float
    count: int

    @property
    def significant(self) -> bool:
        """Whether the interval leaves out a slope of zero."""
        return self.low > 0 or self.high < 0


def trend(
    times: npt.NDArray[np.datetime64], values: npt.NDArray[np.float64], sigmas: npt.NDArray[np.float64] | None = None
) -> Trend:
    """Fit a robust slope (Theil 1950, Sen 1968).

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
        In any order and spacing.
    values : ndarray of float64, shape (n,)
        NaN where not measured.
    sigmas : ndarray of float64, shape (n,), optional
        Standard uncertainties. The interval is never narrower than they allow: that of a least-squares slope of values
        with these errors.

    Returns
    -------
    Trend
        The slope is the median of the slopes of all pairs; its interval is Sen's, from the variance of Kendall's
        statistic, widened for autocorrelation of the residuals by (1 + r) / (1 - r), r their lag-one correlation where
        it is positive (Hamed and Rao 1998 in its first-order form).

    Raises
    ------
    ValueError
        If the arrays differ in length.
    """
    if times.shape != values.shape or (sigmas is not None and sigmas.shape != values.shape):
        raise ValueError(f"a trend needs as many times as values: {times.shape} and {values.shape}")
    good = np.isfinite(values) & ~np.isnat(times)
    order = np.argsort(times[good], kind="stable")
    at, value = times[good][order], values[good][order].astype(np.float64)
    spread = None if sigmas is None else np.asarray(sigmas, dtype=np.float64)[good][order]
    count = int(value.size)
    nothing = Trend(float("nan"), float("nan"), float("nan"), float("nan"), count)
    if count < 3:
        return nothing
    day = (at - at[0]) / np.timedelta64(1, "D")
    used = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(np.intp))
    t, v = day[used], value[used]
    first, second = np.triu_indices(used.size, k=1)
    apart = t[second] - t[first]
    pairs = apart > 0
    if not pairs.any():
        return nothing
    slopes = np.sort((v[second] - v[first])[pairs] / apart[pairs])
    slope = float(np.median(slopes))
    intercept = float(np.median(v - slope * t))

    n = used.size
    variance = n * (n - 1) * (2 * n + 5) / 18
    residual = v - intercept - slope * t
    variance *= inflation(residual)
    half = Z_95 * np.sqrt(variance)
    low_rank = int(np.floor((slopes.size - half) / 2))
    high_rank = int(np.ceil((slopes.size + half) / 2))
    # too few pairs for the rank interval: the extreme slopes are all that can be said
    low = float(slopes[max(0, low_rank)])
    high = float(slopes[min(slopes.size - 1, high_rank)])
    if spread is not None and np.isfinite(spread).all():
        known = Z_95 * _least_squares_sigma(day, spread)
        low, high = min(low, slope - known), max(high, slope + known)
    return Trend(slope, low, high, intercept, count)


def inflation(residual: npt.NDArray[np.float64]) -> float:
    """(1 + r) / (1 - r) for a positive lag-one correlation r, at most 20."""
    centred = residual - residual.mean()
    power = float((centred**2).sum())
    if residual.size < 10 or power == 0:
        return 1.0
    r = float((centred[1:] * centred[:-1]).sum()) / power
    return min(20.0, (1 + r) / max(1 - r, 1e-6)) if r > 0 else 1.0


def _least_squares_sigma(day: npt.NDArray[np.float64], sigma: npt.NDArray[np.float64]) -> float:
    """Standard uncertainty of an unweighted least-squares slope of values with independent errors."""
    lever = day - day.mean()
    return float(np.sqrt(((lever * sigma) ** 2).sum()) / (lever**2).sum())


def thinned(
    times: npt.NDArray[np.datetime64], values: npt.NDArray[np.float64], sigmas: npt.NDArray[np.float64], most: int
) -> tuple[npt.NDArray[np.datetime64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Take medians of runs where there are more than `most` values; a run is as sure as one of them: errors repeat."""
    if len(times) <= most:
        return times, values, sigmas
    edges = np.linspace(0, len(times), most + 1).astype(np.intp)
    runs = [slice(start, stop) for start, stop in pairwise(edges.tolist())]
    middle = np.array([times[run.start] + (times[run.stop - 1] - times[run.start]) // 2 for run in runs])
    both = [np.array([np.median(array[run]) for run in runs]) for array in (values, sigmas)]
    return middle, both[0], both[1]
