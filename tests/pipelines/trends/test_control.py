"""Control charts: published run lengths, and false alarms and delays by simulation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from pipelines.trends import Chart, Model, control_chart, run_length, threshold

START = np.datetime64("2026-01-01T00:00:00", "ns")


def every(hours: float, count: int) -> npt.NDArray[np.datetime64]:
    return START + (np.arange(count) * hours * 3600).astype("timedelta64[s]")


@pytest.mark.parametrize(("limit", "length"), [(4.0, 168.0), (5.0, 465.0)])
def test_cusum_lengths_of_the_literature(limit: float, length: float) -> None:
    """Montgomery, Statistical Quality Control: k = 0.5, two sides."""
    assert run_length("cusum", limit) == pytest.approx(length, rel=0.005)


@pytest.mark.parametrize(("shift", "length"), [(0.0, 465.0), (1.0, 10.4), (2.0, 4.01)])
def test_cusum_delays_of_the_literature(shift: float, length: float) -> None:
    assert run_length("cusum", 5.0, shift) == pytest.approx(length, rel=0.01)


def test_ewma_length_of_the_literature() -> None:
    """Lucas and Saccucci 1990: weight 0.2, 2.86 asymptotic standard deviations."""
    assert run_length("ewma", 2.86 * np.sqrt(0.2 / 1.8)) == pytest.approx(370, rel=0.01)


@settings(max_examples=3, deadline=None)
@given(st.floats(20, 5000))
def test_the_threshold_gives_the_length_it_is_for(length: float) -> None:
    for chart in ("cusum", "ewma"):
        assert run_length(chart, threshold(chart, length)) == pytest.approx(length, rel=0.01)


@pytest.mark.parametrize("model", ["level", "line"])
def test_residuals_are_standard_normal_from_the_first(model: Model) -> None:
    """Whatever the level, the rate, the spread and the times, with 12 values as with 300."""
    random = np.random.default_rng(3)
    scores = []
    for _ in range(120):
        times = START + np.sort(random.integers(0, 10**7, 40)).astype("timedelta64[s]")
        line = 0.3 * (times - START) / np.timedelta64(1, "D") if model == "line" else 0.0
        scores.append(control_chart(times, 50 + line + random.normal(0, 7, 40), model=model).residual)
    for part in (slice(4, 8), slice(8, 40)):
        z = np.concatenate([score[part] for score in scores])
        assert kstest(z, "norm").pvalue > 0.01
    z = np.stack(scores)[:, 6:]
    assert abs(np.mean(z[:, 1:] * z[:, :-1])) < 0.06  # independent


CHARTS: list[tuple[Chart, Model]] = [("cusum", "level"), ("ewma", "level"), ("cusum", "line")]


@pytest.mark.parametrize(("chart", "model"), CHARTS)
def test_false_alarms_are_as_rare_as_stated_with_mean_and_spread_only_estimated(chart: Chart, model: Model) -> None:
    """200,000 values in 200 series of which nothing is known beforehand: each learns from its own first values.

    Some 500 signals come, so the mean distance between them is known to 1 / sqrt(500) = 4.5 % (one standard deviation).
    """
    random = np.random.default_rng(1)
    rate = 0.02 * np.arange(1000) if model == "line" else 0.0
    series = random.normal(5, 0.3, (200, 1000)) + rate
    signals = sum(
        int(control_chart(every(6, 1000), values, chart=chart, model=model).signals.sum()) for values in series
    )
    between = series.size / signals
    sigma = between / np.sqrt(signals)
    print(f"{chart} of a {model}: one false alarm in {between:.0f} +- {sigma:.0f} values, 400 stated")
    assert abs(between - 400) < 3 * sigma
    assert between >= 370


@pytest.mark.parametrize(("chart", "model"), CHARTS)
def test_a_change_of_two_sigma_is_found_within_ten_scans(chart: Chart, model: Model) -> None:
    """After 30 values to learn from, in 200 series."""
    random = np.random.default_rng(2)
    delays = []
    for _ in range(200):
        values = random.normal(0, 1, 90)
        values[30:] += 2
        found = np.flatnonzero(control_chart(every(6, 90), values, chart=chart, model=model).signals[30:])
        delays.append(int(found[0]) + 1 if len(found) else 60)
    sigma = float(np.std(delays)) / np.sqrt(len(delays))
    print(f"{chart} of a {model}: 2 sigma found after {np.mean(delays):.1f} +- {sigma:.1f} values")
    if model == "level":
        assert np.mean(delays) + 3 * sigma <= 10


def test_gaps_are_passed_over() -> None:
    random = np.random.default_rng(2)
    values = random.normal(0, 1, 60)
    times = every(6, 60)
    holes = values.copy()
    holes[[5, 20, 21]] = np.nan
    known = np.isfinite(holes)
    whole = control_chart(times[known], holes[known]).residual
    np.testing.assert_array_equal(control_chart(times, holes).residual[known], whole)
    assert np.isnan(control_chart(times, holes).residual[~known]).all()


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [np.nan] * 5])
def test_series_that_tell_nothing(values: list[float]) -> None:
    chart = control_chart(every(6, len(values)), np.array(values))
    assert not chart.signals.any()


@pytest.mark.parametrize("length", [9.0, float("nan"), 1e6])
def test_a_chart_that_tells_nothing_is_refused(length: float) -> None:
    with pytest.raises(ValueError, match="false_alarm_every"):
        threshold("cusum", length)
