"""AlarmRule: each part by itself, hysteresis and m of n, and that the gravest counts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.trends import (
    AlarmRule,
    AlarmState,
    Limits,
    Watch,
    aired,
    decide,
    remembered,
    silent,
    time_to_limit,
    trend,
    watched,
)

START = np.datetime64("2026-01-01T00:00:00", "ns")
LIMITS = Limits(warn_above=1.0, alarm_above=2.0)


def days(count: int) -> npt.NDArray[np.datetime64]:
    return START + np.arange(count) * np.timedelta64(1, "D")


def watch(rule: AlarmRule, values: npt.ArrayLike, sigma: float = 0.01) -> list[Watch]:
    """What the alarm knows after each value, one a day."""
    found = [Watch()]
    series = np.asarray(values, dtype=np.float64)
    for time, value in zip(days(len(series)), series.tolist(), strict=True):
        found.append(watched(rule, found[-1], time, value, sigma))
    return found[1:]


def states(rule: AlarmRule, values: npt.ArrayLike) -> list[AlarmState]:
    return [each.state for each in watch(rule, values)]


def test_plain_limits() -> None:
    rule = AlarmRule(LIMITS, no_data_after=1)
    assert states(rule, [0.5, 1.5, 2.5, np.nan, 0.5]) == ["ok", "warning", "alarm", "no data", "ok"]


def test_what_was_never_seen_is_no_data_as_what_is_seen_no_more() -> None:
    rule = AlarmRule(LIMITS, no_data_after=2)
    found = watch(rule, [np.nan] * 3 + [0.5, np.nan, np.nan, 0.5, np.nan])
    assert [each.state for each in found] == ["ok", "no data", "no data", "ok", "ok", "no data", "ok", "ok"]
    assert found[2].why == (
        "3 slots in a row without a value to judge, and no value since the baseline, the last: not measured"
    )
    assert found[5].why == "2 slots in a row without a value to judge, the last: not measured"


def breathe(rule: AlarmRule, values: npt.ArrayLike, air: npt.ArrayLike) -> list[Watch]:
    found = [Watch()]
    readings = np.asarray(air, dtype=np.float64).tolist()
    for time, value, read in zip(days(len(readings)), np.asarray(values).tolist(), readings, strict=True):
        found.append(watched(rule, aired(rule, found[-1], time, {"temperature": read}), time, value, 0.01))
    return found[1:]


def test_a_chart_beside_the_environment_warns_of_what_the_environment_does_not_explain() -> None:
    random = np.random.default_rng(4)
    air = 15 + 8 * np.sin(np.arange(80) / 7) + random.normal(0, 1, 80)
    values = 0.5 * np.append(air[:2], air[:-2]) + random.normal(0, 0.2, 80)  # two days late
    values[60:] += 0.8
    rule = AlarmRule(chart="cusum", drivers=("temperature",), max_lag_hours=72)
    found = breathe(rule, values, air)
    assert "warning" not in [each.state for each in found[:60]]
    assert "warning" in [each.state for each in found[60:70]]
    assert len(found[-1].air_times) <= 5, "no more is carried than the longest lag needs"
    assert "warning" in states(AlarmRule(chart="cusum"), values[:60]), "which the weather alone would have raised"


def test_without_the_environment_a_chart_of_it_has_no_data_and_limits_go_on() -> None:
    unread = [1.0, 2.0, np.nan, np.nan, 3.0]
    alone = AlarmRule(chart="cusum", drivers=("temperature",), no_data_after=2)
    found = breathe(alone, [0.5] * 5, unread)
    assert [each.state for each in found] == ["ok", "ok", "ok", "no data", "ok"]
    assert found[3].why.endswith("the last: the environment was not read")
    both = AlarmRule(LIMITS, chart="cusum", drivers=("temperature",), no_data_after=2)
    assert [each.state for each in breathe(both, [0.5, 0.5, 0.5, 1.5, 0.5], unread)] == [*["ok"] * 3, "warning", "ok"]


def test_silence_neither_clears_nor_raises_until_it_lasts() -> None:
    rule = AlarmRule(LIMITS, no_data_after=3)
    raised = watch(rule, [0.5, 2.5])[-1]
    short = silent(rule, raised, 2, "missed")
    assert short.state == "alarm"
    assert short.why == "above the limit of 2"
    long = silent(rule, short, 1, "the rig is not there")
    assert long.state == "no data"
    assert long.why == "3 slots in a row without a value to judge, the last: the rig is not there"
    assert watched(rule, long, days(9)[8], 2.5, 0.01).state == "alarm"


def test_two_of_three() -> None:
    rule = AlarmRule(LIMITS, confirm=(2, 3))
    assert states(rule, [2.5, 0.5, 2.5, 2.5, 0.5, 0.5]) == ["ok", "ok", "alarm", "alarm", "alarm", "ok"]
    assert states(rule, [1.5, 2.5, 0.5, 0.5]) == ["ok", "warning", "warning", "ok"]


def test_hysteresis() -> None:
    rule = AlarmRule(LIMITS, clear_by=0.2)
    assert states(rule, [0.9, 1.1, 0.9, 1.1, 0.7, 0.9]) == ["ok", "warning", "warning", "warning", "ok", "ok"]
    assert states(rule, [2.1, 1.9, 1.7, 1.9]) == ["alarm", "alarm", "warning", "warning"]


def test_rate_needs_the_whole_interval() -> None:
    random = np.random.default_rng(0)
    rule = AlarmRule(rate=Limits(warn_above=0.1, alarm_above=0.3))
    time = np.arange(30)

    def state(slope: float, noise: float, count: int) -> AlarmState:
        values = slope * time[:count] + random.normal(0, noise, count)
        return watch(rule, values, noise)[-1].state

    assert state(0.05, 0.01, 30) == "ok"
    assert state(0.2, 0.01, 30) == "warning"
    assert state(0.5, 0.01, 30) == "alarm"
    assert state(0.2, 2.0, 8) == "ok"  # nobody can tell yet
    assert state(0.5, 0.01, 2) == "ok"  # nor with two values


def test_only_the_window_counts() -> None:
    values = np.concatenate([np.zeros(20), np.arange(10) * 0.5])
    rate = Limits(alarm_above=0.4)
    assert watch(AlarmRule(rate=rate), values, 0.001)[-1].state == "ok"
    found = watch(AlarmRule(rate=rate, window_days=9, unit="mm"), values, 0.001)[-1]
    assert found.state == "alarm"
    assert found.why == "changes by 0.5 mm a day (95 %: 0.5 to 0.5), above the limit of 0.4 mm a day"
    assert len(found.times) == 10, "no more is carried than is looked at"


def test_a_long_window_costs_the_same_and_says_the_same() -> None:
    random = np.random.default_rng(8)
    count = 2000
    times = START + (np.arange(count) * 6).astype("timedelta64[h]")
    values = 0.01 * np.arange(count) / 4 + random.normal(0, 0.2, count)
    rule = AlarmRule(rate=Limits(warn_above=0.008))
    seen = Watch()
    for time, value in zip(times, values.tolist(), strict=True):
        seen = remembered(rule, seen, time, value, 0.2)
    assert len(seen.values) == count
    assert decide(rule, seen).state == "warning"
    assert decide(AlarmRule(rate=Limits(warn_above=0.012)), seen).state == "ok"


def test_forecast() -> None:
    values = 0.05 * np.arange(11) + np.random.default_rng(1).normal(0, 0.001, 11)
    sigma = np.full(11, 0.001)
    soon = watch(AlarmRule(LIMITS, within_days=40), values, 0.001)[-1]
    assert soon.state == "warning"
    assert "reaches its alarm limit of 2 in 30" in soon.why  # 0.5 now, 0.05 a day
    assert watch(AlarmRule(Limits(alarm_above=2.0), within_days=20), values, 0.001)[-1].state == "ok"
    left = time_to_limit(trend(days(11), values, sigma), 10.0, 2.0, above=True)
    assert left.earliest < left.days < left.latest
    assert left.days == pytest.approx(30, rel=0.03)
    assert time_to_limit(trend(days(11), values, sigma), 10.0, -1.0, above=False).days == np.inf


def test_a_chart_warns_of_a_change_and_falls_silent_after_it() -> None:
    values = np.random.default_rng(4).normal(0, 1, 80)
    values[40:50] += 3
    found = watch(AlarmRule(chart="cusum"), values)
    assert "warning" not in [each.state for each in found[:40]]
    assert "warning" in [each.state for each in found[40:46]]
    assert found[-1].state == "ok", "the level came back, and is quiet since"
    raised = next(each for each in found if each.state == "warning")
    assert raised.why == "the level has changed (CUSUM, by chance once in 400 values)"


def test_a_chart_of_a_steady_rate_keeps_quiet_where_one_of_a_level_warns() -> None:
    values = 0.2 * np.arange(60) + np.random.default_rng(4).normal(0, 1, 60)
    assert "warning" in states(AlarmRule(chart="cusum"), values)
    assert "warning" not in states(AlarmRule(chart="cusum", model="line"), values)


def test_the_gravest_counts_and_says_why() -> None:
    values = np.append(np.random.default_rng(0).normal(0, 0.1, 40), 5.0)
    found = watch(AlarmRule(Limits(alarm_above=2.0), chart="ewma", unit="mm³"), values, 0.1)[-1]
    assert found.state == "alarm"
    assert found.why == "above the limit of 2 mm³"


def test_all_that_is_alike_grave_is_said() -> None:
    values = np.append(np.random.default_rng(0).normal(0, 0.1, 40), 5.0)
    found = watch(AlarmRule(Limits(warn_above=2.0), chart="ewma"), values, 0.1)[-1]
    assert found.why.startswith("above the limit of 2; the level has changed (EWMA")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, "needs limits"),
        ({"chart": "cusum", "within_days": 3}, "within_days"),
        ({"limits": LIMITS, "confirm": (3, 2)}, "confirm"),
        ({"limits": LIMITS, "clear_by": -1}, "clear_by"),
        ({"limits": LIMITS, "window_days": 0}, "window_days"),
        ({"chart": "cusum", "false_alarm_every": 1}, "false_alarm_every"),
        ({"limits": LIMITS, "no_data_after": 0}, "no_data_after"),
    ],
)
def test_rules_that_make_no_sense(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        AlarmRule(**fields)  # type: ignore[arg-type]  # wrong on purpose
