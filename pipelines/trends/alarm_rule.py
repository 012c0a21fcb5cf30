"""AlarmRule: all that can raise one alarm, and where it stands after the newest value of its series."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .alarm_state import AlarmState
from .control import Chart, control_chart, threshold
from .forecast import time_to_limit
from .limits import Limits, judge, worst_state
from .trend import Trend, trend

__all__ = ["AlarmRule", "Decision", "decide"]

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """What raises an alarm on one metric; each part by itself, the gravest counts.

    Parameters
    ----------
    limits : Limits, optional
        Of the value.
    rate : Limits, optional
        Of the rate, in the metric's unit per day; passed where the whole 95 % interval of the trend's slope is beyond.
    window_days : float, optional
        Trends look back so far; over the whole series if left out.
    within_days : float, optional
        A warning if the trend, which must be significant, reaches a limit of the value within so many days.
    chart : {"cusum", "ewma"}, optional
        A warning where a control chart of the series signals a change.
    false_alarm_every : float
        Of that chart: values between false alarms in the mean.
    confirm : (int, int)
        (m, n): limits of the value count once m of the newest n values are beyond them.
    clear_by : float
        Hysteresis, in the metric's unit: a raised alarm falls back once the value is so far inside its limit.

    Raises
    ------
    ValueError
        If nothing raises it, or a number is out of range.
    """

    limits: Limits | None = None
    rate: Limits | None = None
    window_days: float | None = None
    within_days: float | None = None
    chart: Chart | None = None
    false_alarm_every: float = 370.0
    confirm: tuple[int, int] = (1, 1)
    clear_by: float = 0.0

    def __post_init__(self) -> None:
        if self.limits is None and self.rate is None and self.chart is None:
            raise ValueError("an alarm needs limits of the value, limits of its rate, or a control chart")
        if self.within_days is not None and self.limits is None:
            raise ValueError("within_days foretells when a limit of the value is reached: give one")
        for name in ("window_days", "within_days"):
            days = getattr(self, name)
            if days is not None and not (math.isfinite(days) and days > 0):
                raise ValueError(f"{name} is a number of days above 0, not {days}")
        of, among = self.confirm
        if not 1 <= of <= among:
            raise ValueError(f"confirm is (m, n) with 1 <= m <= n, not ({of}, {among})")
        if not (math.isfinite(self.clear_by) and self.clear_by >= 0):
            raise ValueError(f"clear_by is a distance of at least 0, not {self.clear_by}")
        if self.chart is not None:
            threshold(self.chart, float(self.false_alarm_every))


@dataclass(frozen=True, slots=True)
class Decision:
    """Where an alarm stands, and why, in words; the words are empty where it is ok."""

    state: AlarmState
    why: str = ""


def decide(rule: AlarmRule, times: Times, values: Floats, sigmas: Floats, before: AlarmState = "ok") -> Decision:
    """Judge the newest value of a series.

    Parameters
    ----------
    rule : AlarmRule
    times : ndarray of datetime64, shape (n,)
        Ascending.
    values, sigmas : ndarray of float64, shape (n,)
        The metric and its standard uncertainty; NaN where not measured.
    before : {"ok", "warning", "alarm", "no data"}
        Where the alarm stood after the value before: what has been raised falls back by `clear_by` later.

    Returns
    -------
    Decision
        "no data" where the newest value was not measured, or there is none.

    Raises
    ------
    ValueError
        If the arrays differ in length.
    """
    if not times.shape == values.shape == sigmas.shape:
        raise ValueError(f"as many times as values and sigmas: {times.shape}, {values.shape}, {sigmas.shape}")
    if not len(values) or not (math.isfinite(values[-1]) and math.isfinite(sigmas[-1])):
        return Decision("no data", "the newest value was not measured")
    found = [decision for decision in _parts(rule, times, values, sigmas, before) if decision.state != "ok"]
    worst = worst_state(decision.state for decision in found)
    return next((decision for decision in found if decision.state == worst), Decision("ok"))


def _parts(rule: AlarmRule, times: Times, values: Floats, sigmas: Floats, before: AlarmState) -> Iterator[Decision]:
    if rule.limits is not None:
        yield _by_value(rule, rule.limits, values, sigmas, before)
    if rule.rate is not None or rule.within_days is not None:
        recent = np.ones(times.shape, dtype=np.bool_)
        if rule.window_days is not None:
            recent = times >= times[-1] - np.timedelta64(round(rule.window_days * 86_400_000), "ms")
        line = trend(times[recent], values[recent], sigmas[recent])
        first = times[recent][np.isfinite(values[recent])][0]
        elapsed = float((times[-1] - first) / np.timedelta64(1, "D"))
        if rule.rate is not None:
            yield _by_rate(line, rule.rate)
        if rule.within_days is not None and rule.limits is not None:
            yield _by_forecast(line, elapsed, rule.limits, rule.within_days)
    if rule.chart is not None:
        signals = control_chart(times, values, chart=rule.chart, false_alarm_every=rule.false_alarm_every).signals
        if signals[-1]:
            every = f"by chance once in {rule.false_alarm_every:g} values"
            yield Decision("warning", f"the level has changed ({rule.chart.upper()}, {every})")


def _by_value(rule: AlarmRule, limits: Limits, values: Floats, sigmas: Floats, before: AlarmState) -> Decision:
    of, among = rule.confirm
    states = [judge(float(v), float(s), limits) for v, s in zip(values[-among:], sigmas[-among:], strict=True)]
    grave = sum(state == "alarm" for state in states)
    beyond = sum(state in ("warning", "alarm") for state in states)
    state: AlarmState = "alarm" if grave >= of else "warning" if beyond >= of else "ok"
    if rule.clear_by and before in ("warning", "alarm"):
        held = judge(float(values[-1]), float(sigmas[-1]), _inward(limits, rule.clear_by))
        # what was raised stays up to its own height, until the value is well inside
        state = worst_state((state, "warning" if before == "warning" and held == "alarm" else held))
    if state == "ok":
        return Decision("ok")
    share = f" in {grave if state == 'alarm' else beyond} of {among} values" if among > 1 else ""
    return Decision(state, f"beyond its limit{share}")


def _inward(limits: Limits, by: float) -> Limits:
    """Limits so much stricter; where nothing would be ok any more, as they are."""
    moved = {
        "warn_above": None if limits.warn_above is None else limits.warn_above - by,
        "alarm_above": None if limits.alarm_above is None else limits.alarm_above - by,
        "warn_below": None if limits.warn_below is None else limits.warn_below + by,
        "alarm_below": None if limits.alarm_below is None else limits.alarm_below + by,
    }
    try:
        return replace(limits, **moved)
    except ValueError:
        return limits


def _by_rate(line: Trend, rate: Limits) -> Decision:
    if not math.isfinite(line.slope_per_day):
        return Decision("ok")
    ends = [judge(end, 0.0, rate) for end in (line.low, line.high)]
    # both ends beyond the same limit: the interval as a whole is
    same_side = (line.low > 0) == (line.high > 0)
    state = min(ends, key=("ok", "warning", "alarm").index) if same_side else "ok"
    told = f"changes by {line.slope_per_day:.3g} a day (95 %: {line.low:.3g} to {line.high:.3g})"
    return Decision(state, told if state != "ok" else "")


def _by_forecast(line: Trend, elapsed: float, limits: Limits, within: float) -> Decision:
    if not line.significant:
        return Decision("ok")
    for name, limit, above in (
        ("alarm_above", limits.alarm_above, True),
        ("warn_above", limits.warn_above, True),
        ("alarm_below", limits.alarm_below, False),
        ("warn_below", limits.warn_below, False),
    ):
        if limit is None:
            continue
        left = time_to_limit(line, elapsed, limit, above=above)
        if 0 < left.days <= within:
            latest = f"{left.latest:.3g}" if math.isfinite(left.latest) else "never"
            told = f"reaches {name} {limit:g} in {left.days:.3g} days (95 %: {left.earliest:.3g} to {latest})"
            return Decision("warning", told)
    return Decision("ok")
