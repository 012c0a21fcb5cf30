"""Limits judge values; silence is the worst state."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.trends import ALARM_STATES, AlarmState, Limits, judge, worst_state

BOTH = Limits(warn_above=1.0, alarm_above=2.0, warn_below=-1.0, alarm_below=-3.0)


@pytest.mark.parametrize(
    ("value", "state"),
    [(0, "ok"), (1, "ok"), (1.01, "warning"), (2, "warning"), (2.01, "alarm"), (-1.5, "warning"), (-3.5, "alarm")],
)
def test_a_value_beyond_a_limit(value: float, state: str) -> None:
    assert judge(value, 0.1, BOTH) == state


@pytest.mark.parametrize(("value", "sigma"), [(math.nan, 0.1), (math.inf, 0.1), (0.0, math.nan)])
def test_what_is_not_measured_is_no_data(value: float, sigma: float) -> None:
    assert judge(value, sigma, BOTH) == "no data"


def test_an_alarm_without_a_warning() -> None:
    limits = Limits(alarm_above=2.0)
    assert judge(1.9, 0, limits) == "ok"
    assert judge(2.1, 0, limits) == "alarm"


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_further_up_is_never_less_grave(one: float, two: float) -> None:
    low, high = sorted((one, two))
    limits = Limits(warn_above=0.0, alarm_above=10.0)
    assert ALARM_STATES.index(judge(low, 0, limits)) <= ALARM_STATES.index(judge(high, 0, limits))


@pytest.mark.parametrize(
    ("given_limits", "words"),
    [
        ({}, "at least one"),
        ({"warn_above": math.nan}, "finite"),
        ({"warn_above": 2.0, "alarm_above": 1.0}, "below warn_above"),
        ({"warn_below": 1.0, "alarm_below": 2.0}, "above warn_below"),
        ({"warn_above": 1.0, "warn_below": 1.0}, "no value is ok"),
    ],
)
def test_limits_that_make_no_sense(given_limits: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Limits(**given_limits)


def test_worst_state() -> None:
    states: list[AlarmState] = ["ok", "alarm", "warning"]
    assert worst_state(states) == "alarm"
    assert worst_state([*states, "no data"]) == "no data"
    assert worst_state([]) == "ok"
