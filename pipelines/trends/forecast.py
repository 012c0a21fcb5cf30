"""Forecast: when a trend reaches a limit, with its interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .trend import Trend

__all__ = ["TimeToLimit", "time_to_limit"]


@dataclass(frozen=True, slots=True)
class TimeToLimit:
    """Days from the newest value until a limit is reached.

    Parameters
    ----------
    days : float
        By the trend's slope; 0 where the limit is passed already, infinite where the trend leads away from it.
    earliest, latest : float
        By the ends of the slope's 95 % interval.
    """

    days: float
    earliest: float
    latest: float


def time_to_limit(trend: Trend, elapsed_days: float, limit: float, *, above: bool) -> TimeToLimit:
    """Tell when a trend reaches a limit, if it goes on.

    Parameters
    ----------
    trend : Trend
    elapsed_days : float
        From the trend's first time to now.
    limit : float
        In the metric's unit.
    above : bool
        Whether the limit is passed upwards.

    Returns
    -------
    TimeToLimit
        NaN where there is no trend.
    """
    if not math.isfinite(trend.slope_per_day):
        return TimeToLimit(math.nan, math.nan, math.nan)
    here = trend.intercept + trend.slope_per_day * elapsed_days
    left = limit - here if above else here - limit

    def days(slope: float) -> float:
        towards = slope if above else -slope
        if left <= 0:
            return 0.0
        return left / towards if towards > 0 else math.inf

    by_interval = days(trend.low), days(trend.high)
    return TimeToLimit(days(trend.slope_per_day), min(by_interval), max(by_interval))
