"""Slopes: robust, on irregular times, with an interval that holds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.trends import trend

START = np.datetime64("2026-03-01T00:00:00", "ns")


def times_of(days: npt.NDArray[np.float64]) -> npt.NDArray[np.datetime64]:
    return START + (days * 86_400e9).astype("timedelta64[ns]")


@settings(max_examples=30, deadline=None)
@given(st.floats(-5, 5), st.floats(-100, 100), st.integers(3, 40), st.integers(0, 1000))
def test_a_straight_line_is_exact_on_any_times(slope: float, start: float, count: int, seed: int) -> None:
    days = np.sort(np.random.default_rng(seed).uniform(0, 30, count))
    found = trend(times_of(days), start + slope * (days - days[0]))
    assert found.slope_per_day == pytest.approx(slope, abs=1e-6)
    assert found.low <= slope + 1e-6
    assert found.high >= slope - 1e-6
    assert found.intercept == pytest.approx(start, abs=1e-4)


def test_the_interval_holds_the_slope_as_often_as_it_says() -> None:
    held = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        days = np.sort(random.uniform(0, 20, 40))
        found = trend(times_of(days), 0.02 * days + random.normal(0, 0.1, 40))
        held += found.low <= 0.02 <= found.high
    assert 0.90 <= held / 200 <= 0.99


def test_autocorrelation_widens_the_interval() -> None:
    random = np.random.default_rng(0)
    noise = np.zeros(200)
    for k in range(1, 200):
        noise[k] = 0.8 * noise[k - 1] + random.normal(0, 0.1)
    days = np.arange(200.0)
    red = trend(times_of(days), noise)
    white = trend(times_of(days), random.permutation(noise))
    assert red.high - red.low > 1.8 * (white.high - white.low)


def test_gross_values_and_gaps_do_not_turn_it() -> None:
    days = np.concatenate([np.arange(0, 10, 0.25), np.arange(30, 40, 0.25)])
    values = 0.5 * days
    values[::7] += 100
    values[3::9] = np.nan
    found = trend(times_of(days), values)
    assert found.slope_per_day == pytest.approx(0.5, abs=0.01)
    assert found.count == int(np.isfinite(values).sum())
    assert found.significant


def test_order_does_not_matter() -> None:
    random = np.random.default_rng(1)
    days, values = random.uniform(0, 9, 30), random.normal(size=30)
    turn = random.permutation(30)
    assert trend(times_of(days), values) == trend(times_of(days[turn]), values[turn])


def test_known_uncertainties_widen_it() -> None:
    days = np.arange(10.0)
    found = trend(times_of(days), 0.1 * days, np.full(10, 0.5))
    assert found.high - found.low > 2 * 1.9 * 0.5 / np.sqrt(((days - 4.5) ** 2).sum())
    assert not found.significant


@pytest.mark.parametrize("days", [[], [1.0], [1.0, 2.0], [1.0, 1.0, 1.0]])
def test_too_little_is_nan(days: list[float]) -> None:
    found = trend(times_of(np.array(days)), np.ones(len(days)))
    assert np.isnan(found.slope_per_day)
    assert not found.significant


def test_long_series_are_thinned() -> None:
    days = np.arange(20_000.0) / 24
    found = trend(times_of(days), 0.003 * days + np.random.default_rng(2).normal(0, 0.05, days.size))
    assert found.slope_per_day == pytest.approx(0.003, abs=1e-4)


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="as many times"):
        trend(times_of(np.arange(3.0)), np.ones(4))
