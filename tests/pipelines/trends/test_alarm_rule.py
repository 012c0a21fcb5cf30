"""AlarmRule: each part by itself, hysteresis and m of n, and that the gravest counts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.trends import AlarmRule, AlarmState, Limits, decide, time_to_limit, trend

START = np.datetime64("2026-01-01T00:00:00", "ns")
LIMITS = Limits(warn_above=1.0, alarm_above=2.0)


def days(count: int) -> npt.NDArray[np.datetime64]:
    return START + np.arange(count) * np.timedelta64(1, "D")


def states(rule: AlarmRule, values: list[float]) -> list[AlarmState]:
    """Where the alarm stands after each value, each time knowing only those before."""
    found: list[AlarmState] = []
    series = np.array(values, dtype=np.float64)
    for n in range(1, len(values) + 1):
        before = found[-1] if found else "ok"
        found.append(decide(rule, days(n), series[:n], np.full(n, 0.01), before).state)
    return found


def test_plain_limits() -> None:
    assert states(AlarmRule(LIMITS), [0.5, 1.5, 2.5, np.nan, 0.5]) == ["ok", "warning", "alarm", "no data", "ok"]


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
        return decide(rule, days(count), values, np.full(count, noise)).state

    assert state(0.05, 0.01, 30) == "ok"
    assert state(0.2, 0.01, 30) == "warning"
    assert state(0.5, 0.01, 30) == "alarm"
    assert state(0.2, 2.0, 8) == "ok"  # nobody can tell yet
    assert state(0.5, 0.01, 2) == "ok"  # nor with two values


def test_only_the_window_counts() -> None:
    values = np.concatenate([np.zeros(20), np.arange(10) * 0.5])
    sigma = np.full(30, 0.001)
    rate = Limits(alarm_above=0.4)
    assert decide(AlarmRule(rate=rate), days(30), values, sigma).state == "ok"
    assert decide(AlarmRule(rate=rate, window_days=9), days(30), values, sigma).state == "alarm"


def test_forecast() -> None:
    values = 0.05 * np.arange(11) + np.random.default_rng(1).normal(0, 0.001, 11)
    sigma = np.full(11, 0.001)
    soon = decide(AlarmRule(LIMITS, within_days=40), days(11), values, sigma)
    assert soon.state == "warning"
    assert "reaches alarm_above 2 in 30" in soon.why  # 0.5 now, 0.05 a day
    assert decide(AlarmRule(Limits(alarm_above=2.0), within_days=20), days(11), values, sigma).state == "ok"
    left = time_to_limit(trend(days(11), values, sigma), 10.0, 2.0, above=True)
    assert left.earliest < left.days < left.latest
    assert left.days == pytest.approx(30, rel=0.03)
    assert time_to_limit(trend(days(11), values, sigma), 10.0, -1.0, above=False).days == np.inf


def test_chart() -> None:
    values = np.random.default_rng(4).normal(0, 1, 60)
    values[40:] += 3
    found = states(AlarmRule(chart="cusum"), values.tolist())
    assert "warning" not in found[:40]
    assert "warning" in found[40:46]


def test_the_gravest_counts_and_says_why() -> None:
    values = np.append(np.random.default_rng(0).normal(0, 0.1, 40), 5.0)
    rule = AlarmRule(Limits(alarm_above=2.0), chart="ewma")
    found = decide(rule, days(41), values, np.full(41, 0.1))
    assert found.state == "alarm"
    assert found.why == "beyond its limit"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, "needs limits"),
        ({"chart": "cusum", "within_days": 3}, "within_days"),
        ({"limits": LIMITS, "confirm": (3, 2)}, "confirm"),
        ({"limits": LIMITS, "clear_by": -1}, "clear_by"),
        ({"limits": LIMITS, "window_days": 0}, "window_days"),
        ({"chart": "cusum", "false_alarm_every": 1}, "false_alarm_every"),
    ],
)
def test_rules_that_make_no_sense(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        AlarmRule(**fields)  # type: ignore[arg-type]  # wrong on purpose
