"""Limits: where a metric warns and where it alarms; and what a value within or beyond them means."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from .alarm_state import ALARM_STATES, AlarmState

__all__ = ["Limits", "judge", "worst_state"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one metric, in its unit; None where there is none.

    Parameters
    ----------
    warn_above, alarm_above : float, optional
        A value above is a warning or an alarm; the alarm may not lie below the warning.
    warn_below, alarm_below : float, optional
        A value below is a warning or an alarm; the alarm may not lie above the warning.
    """

    warn_above: float | None = None
    alarm_above: float | None = None
    warn_below: float | None = None
    alarm_below: float | None = None

    def __post_init__(self) -> None:
        given = [
            limit
            for limit in (self.warn_above, self.alarm_above, self.warn_below, self.alarm_below)
            if limit is not None
        ]
        if not given:
            raise ValueError("limits need at least one of warn_above, alarm_above, warn_below, alarm_below")
        if not all(math.isfinite(limit) for limit in given):
            raise ValueError("limits must be finite numbers")
        if self.warn_above is not None and self.alarm_above is not None and self.alarm_above < self.warn_above:
            raise ValueError(f"alarm_above {self.alarm_above} lies below warn_above {self.warn_above}")
        if self.warn_below is not None and self.alarm_below is not None and self.alarm_below > self.warn_below:
            raise ValueError(f"alarm_below {self.alarm_below} lies above warn_below {self.warn_below}")
        highest_below = max((v for v in (self.warn_below, self.alarm_below) if v is not None), default=-math.inf)
        lowest_above = min((v for v in (self.warn_above, self.alarm_above) if v is not None), default=math.inf)
        if highest_below >= lowest_above:
            raise ValueError(f"no value is ok: the lower limit {highest_below} meets the upper limit {lowest_above}")


def judge(value: float, sigma: float, limits: Limits) -> AlarmState:
    """Say what a value means against its limits.

    Parameters
    ----------
    value : float
    sigma : float
        Standard uncertainty of `value`; it does not shift a limit (a value just beyond is beyond), but a value whose
        uncertainty is not known is no measurement.
    limits : Limits

    Returns
    -------
    {"ok", "warning", "alarm", "no data"}
        "no data" where value or sigma is NaN or infinite.
    """
    if not (math.isfinite(value) and math.isfinite(sigma)):
        return "no data"

    def beyond(above: float | None, below: float | None) -> bool:
        return (above is not None and value > above) or (below is not None and value < below)

    if beyond(limits.alarm_above, limits.alarm_below):
        return "alarm"
    return "warning" if beyond(limits.warn_above, limits.warn_below) else "ok"


def worst_state(states: Iterable[AlarmState]) -> AlarmState:
    """The gravest of some states, in the order of `ALARM_STATES`; "ok" where there is none."""
    return max(states, key=ALARM_STATES.index, default="ok")
