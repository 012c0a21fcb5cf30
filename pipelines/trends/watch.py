"""Watch: what an alarm remembers of a series, carried from value to value, and where it stands after each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from .alarm_rule import AlarmRule, Decision
from .alarm_state import AlarmState
from .control import Charted, charted, threshold
from .environment import followed
from .forecast import time_to_limit
from .limits import Limits, judge, worst_state
from .trend import Trend, thinned, trend

__all__ = ["Watch", "aired", "decide", "remembered", "silent", "watched"]

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]

SIGNAL_STANDS = 10
"""A chart's warning stands until so many values gave no other signal: a real change of 1 sigma signals as often."""
MOST_IN_A_TREND = 400
"""A trend of more values is one of medians of runs of them: every visit must cost the same."""


def _no_times() -> Times:
    return np.zeros(0, dtype="datetime64[ns]")


def _no_values() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """What one alarm knows after a visit.

    Parameters
    ----------
    state, why
        Where it stands, and by which words of its rule.
    by_value : {"ok", "warning", "alarm"}
        Where the limits of the value alone stand: what hysteresis holds.
    silent : int
        Slots in a row without a value that can be judged.
    chart : Charted
    times, values, sigmas : ndarray, shape (n,)
        The newest values, as many as the rule looks back on; none: there was no value since the baseline.
    air_times, air : ndarray, shape (m,) and (m, quantities)
        What the environment was, as far back as the chart looks.
    """

    state: AlarmState = "ok"
    why: str = ""
    by_value: AlarmState = "ok"
    silent: int = 0
    chart: Charted = field(default_factory=Charted)
    times: Times = field(default_factory=_no_times)
    values: Floats = field(default_factory=_no_values)
    sigmas: Floats = field(default_factory=_no_values)
    air_times: Times = field(default_factory=_no_times)
    air: Floats = field(default_factory=_no_values)


def watched(rule: AlarmRule, before: Watch, time: np.datetime64, value: float, sigma: float) -> Watch:
    """Judge the next value that can be judged.

    Parameters
    ----------
    rule : AlarmRule
    before : Watch
        ``Watch()`` at the baseline.
    time : datetime64
    value, sigma : float
        The metric and its standard uncertainty; where either is not finite, it is one more slot without a value.
    """
    after = remembered(rule, before, time, value, sigma)
    if after.silent:
        return _stands(rule, after, "the environment was not read" if math.isfinite(value + sigma) else "not measured")
    decision = decide(rule, after)
    return replace(after, state=decision.state, why=decision.why)


def silent(rule: AlarmRule, before: Watch, slots: int, cause: str) -> Watch:
    """Let slots pass without a value that can be judged: nothing is raised or cleared, until there is no data."""
    return _stands(rule, replace(before, silent=before.silent + slots), cause)


def _stands(rule: AlarmRule, after: Watch, cause: str) -> Watch:
    if after.silent < rule.no_data_after:
        return after
    count = f"{after.silent} {'slot' if after.silent == 1 else 'slots'} in a row"
    never = "" if after.times.size else ", and no value since the baseline"
    return replace(after, state="no data", why=f"{count} without a value to judge{never}, the last: {cause}")


def aired(rule: AlarmRule, before: Watch, time: np.datetime64, air: Mapping[str, float]) -> Watch:
    """Take in what the environment was at a scan, before its value, whether that can be judged or not."""
    read = [air.get(name, math.nan) for name in rule.drivers]
    if not read or not all(map(math.isfinite, read)):
        return before
    times = np.append(before.air_times, time)
    readings = np.append(before.air.reshape(-1, len(read)), [read], axis=0)
    # one reading from before the longest lag, to interpolate from
    oldest = time - np.timedelta64(round(rule.max_lag_hours * 3_600_000), "ms")
    keep = max(0, int(np.searchsorted(times, oldest, side="right")) - 1)
    return replace(before, air_times=times[keep:], air=readings[keep:])


def remembered(rule: AlarmRule, before: Watch, time: np.datetime64, value: float, sigma: float) -> Watch:
    """Take a value in without judging it: `state` and `why` stay; for a series of which only the end matters.

    A chart passes over a value beside which the environment is not known. Where it is all there is to judge by, that is
    a slot without a value.
    """
    unread = bool(rule.drivers) and (not before.air_times.size or before.air_times[-1] != time)
    if not (math.isfinite(value) and math.isfinite(sigma)) or (unread and rule.judges_by_chart_alone):
        return replace(before, silent=before.silent + 1)
    times, values, sigmas = (
        np.append(old, new) for old, new in ((before.times, time), (before.values, value), (before.sigmas, sigma))
    )
    keep = _first_kept(rule, times)
    chart = before.chart
    if rule.chart is not None:
        limit = threshold(rule.chart, float(rule.false_alarm_every))
        drivers = _followed(rule, before, time)
        if np.isfinite(drivers).all():
            chart = charted(chart, _days(time), value, rule.chart, limit, rule.model, drivers.tolist())
    by_value = before.by_value
    if rule.limits is not None:
        by_value = _value_state(rule, rule.limits, values, sigmas, before.by_value)
    return replace(
        before,
        by_value=by_value,
        silent=0,
        chart=chart,
        times=times[keep:],
        values=values[keep:],
        sigmas=sigmas[keep:],
    )


def decide(rule: AlarmRule, watch: Watch) -> Decision:
    """Say where an alarm stands after the newest value that it remembers, and by which words of its rule."""
    found = [decision for decision in _parts(rule, watch) if decision.state != "ok"]
    worst = worst_state(decision.state for decision in found)
    return Decision(worst, "; ".join(decision.why for decision in found if decision.state == worst))


def _followed(rule: AlarmRule, watch: Watch, time: np.datetime64) -> Floats:
    """Give the environment by each lag before a time, shape (lags, quantities); NaN where it is not known."""
    if not rule.drivers:
        return np.zeros((1, 0))
    quantities = [(watch.air_times, x) for x in watch.air.reshape(-1, len(rule.drivers)).T]
    found: Floats = followed(np.array([time]), quantities, rule.max_lag_hours)[0]
    return found


def _days(time: np.datetime64) -> float:
    return float(time.astype("datetime64[ns]").astype(np.int64)) / 86_400e9


def _first_kept(rule: AlarmRule, times: Times) -> int:
    newest = max(0, len(times) - rule.confirm[1])
    if not rule.follows_a_trend:
        return newest
    if rule.window_days is None:
        return 0
    since = times[-1] - np.timedelta64(round(rule.window_days * 86_400_000), "ms")
    return min(newest, int(np.searchsorted(times, since)))


def _parts(rule: AlarmRule, watch: Watch) -> Iterator[Decision]:
    if rule.limits is not None and watch.by_value != "ok":
        yield _by_value(rule, rule.limits, watch)
    if rule.follows_a_trend:
        since = 0
        if rule.window_days is not None:  # values for `confirm` may reach back farther
            window = np.timedelta64(round(rule.window_days * 86_400_000), "ms")
            since = int(np.searchsorted(watch.times, watch.times[-1] - window))
        recent = watch.times[since:], watch.values[since:], watch.sigmas[since:]
        times, values, sigmas = thinned(*recent, MOST_IN_A_TREND)
        line = trend(times, values, sigmas)
        if rule.rate is not None:
            yield _by_rate(line, rule.rate, rule.unit)
        if rule.within_days is not None and rule.limits is not None:
            elapsed = float((watch.times[-1] - times[0]) / np.timedelta64(1, "D"))
            yield _by_forecast(line, elapsed, rule.limits, rule.within_days, rule.unit)
    if rule.chart is not None and 0 <= watch.chart.quiet < SIGNAL_STANDS:
        ago = watch.chart.quiet
        what = "level" if rule.model == "level" else "rate"
        when = "" if ago == 0 else f", {ago} {'value' if ago == 1 else 'values'} ago"
        every = f"by chance once in {rule.false_alarm_every:g} values"
        yield Decision("warning", f"the {what} has changed{when} ({rule.chart.upper()}, {every})")


def _value_state(rule: AlarmRule, limits: Limits, values: Floats, sigmas: Floats, before: AlarmState) -> AlarmState:
    """Where the limits of the value stand after the newest one, by m of n and hysteresis."""
    of, among = rule.confirm
    states = [judge(float(v), float(s), limits) for v, s in zip(values[-among:], sigmas[-among:], strict=True)]
    grave, beyond = states.count("alarm"), len(states) - states.count("ok")
    state: AlarmState = "alarm" if grave >= of else "warning" if beyond >= of else "ok"
    if rule.clear_by and before != "ok":
        held = judge(float(values[-1]), float(sigmas[-1]), _inward(limits, rule.clear_by))
        # what was raised stays up to its own height, until the value is well inside
        state = worst_state((state, "warning" if before == "warning" and held == "alarm" else held))
    return state


def _by_value(rule: AlarmRule, limits: Limits, watch: Watch) -> Decision:
    state, (of, among), value = watch.by_value, rule.confirm, float(watch.values[-1])
    words = _passed(limits, state, value, rule.unit)
    if words:
        words += f" ({of} of the newest {among} values)" if among > 1 else ""
    elif rule.clear_by and among == 1:
        words = f"not yet {rule.clear_by:g} {rule.unit}".rstrip() + " inside its limit"
    else:
        words = f"{of} of the newest {among} values are beyond its limit"
    return Decision(state, words)


def _passed(limits: Limits, state: AlarmState, value: float, unit: str) -> str:
    """Name the limit that a value is beyond."""
    grade = "alarm" if state == "alarm" else "warn"
    above, below = getattr(limits, f"{grade}_above"), getattr(limits, f"{grade}_below")
    if above is not None and value > above:
        return f"above the limit of {above:g} {unit}".rstrip()
    if below is not None and value < below:
        return f"below the limit of {below:g} {unit}".rstrip()
    return ""


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


def _by_rate(line: Trend, rate: Limits, unit: str) -> Decision:
    if not math.isfinite(line.slope_per_day):
        return Decision("ok")
    ends = [judge(end, 0.0, rate) for end in (line.low, line.high)]
    # both ends beyond the same limit: the interval as a whole is
    same_side = (line.low > 0) == (line.high > 0)
    state = min(ends, key=("ok", "warning", "alarm").index) if same_side else "ok"
    if state == "ok":
        return Decision("ok")
    per = f"{unit} a day".strip()
    limit = _passed(rate, state, line.low if line.low > 0 else line.high, per)
    told = f"changes by {line.slope_per_day:.3g} {per} (95 %: {line.low:.3g} to {line.high:.3g}), {limit}"
    return Decision(state, told)


def _by_forecast(line: Trend, elapsed: float, limits: Limits, within: float, unit: str) -> Decision:
    if not line.significant:
        return Decision("ok")
    for name, limit, above in (
        ("alarm", limits.alarm_above, True),
        ("warning", limits.warn_above, True),
        ("alarm", limits.alarm_below, False),
        ("warning", limits.warn_below, False),
    ):
        if limit is None:
            continue
        left = time_to_limit(line, elapsed, limit, above=above)
        if 0 < left.days <= within:
            latest = f"{left.latest:.3g}" if math.isfinite(left.latest) else "never"
            where = f"its {name} limit of {limit:g} {unit}".rstrip()
            told = f"reaches {where} in {left.days:.3g} days (95 %: {left.earliest:.3g} to {latest})"
            return Decision("warning", told)
    return Decision("ok")
