"""Control charts: published run lengths, and false alarms and delays by simulation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, t

from pipelines.trends import Chart, Model, control_chart, followed, run_length, threshold

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


MOST = 60
"""Values after the change that are waited for."""


def shifted(learned: int, series: int = 200) -> npt.NDArray[np.float64]:
    """Series that shift by 2 sigma after so many values."""
    values = np.random.default_rng(2).normal(0, 1, (series, learned + MOST))
    values[:, learned:] += 2
    return values


def mean_delay(signals: npt.NDArray[np.bool_], words: str) -> tuple[float, float]:
    """Values until the first signal, in the mean, and how well that is known."""
    delays = np.where(signals.any(axis=1), signals.argmax(axis=1) + 1, MOST)
    mean, sigma = float(delays.mean()), float(delays.std()) / np.sqrt(len(delays))
    print(f"{words}: 2 sigma found after {mean:.1f} +- {sigma:.1f} values")
    return mean, sigma


@pytest.mark.parametrize(
    ("chart", "model", "learned"), [("cusum", "level", 30), ("ewma", "level", 30), ("cusum", "line", 50)]
)
def test_a_change_of_two_sigma_is_found_within_ten_scans(chart: Chart, model: Model, learned: int) -> None:
    times = every(6, learned + MOST)
    signals = [control_chart(times, values, chart=chart, model=model).signals[learned:] for values in shifted(learned)]
    mean, sigma = mean_delay(np.array(signals), f"{chart} of a {model} after {learned} values")
    assert mean + 3 * sigma <= 10


@pytest.mark.parametrize(("learned", "enough"), [(30, False), (50, True)])
def test_thirty_values_of_a_line_are_too_few_for_any_chart(learned: int, enough: bool) -> None:
    """A step is judged by the best test there is, Student's of its place, as rare a false alarm at each value.

    What a line learned from 30 values leaves of a step is too little: the line turns towards it.
    """
    values = shifted(learned, 5000)
    scores = []
    for after in range(1, MOST + 1):
        n = learned + after
        line = np.linalg.qr(np.column_stack([np.ones(n), np.arange(n)]))[0]
        step = (np.arange(n) >= learned).astype(float)
        left = step - line @ (line.T @ step)
        part = values[:, :n] @ left / np.linalg.norm(left)
        rest = (values[:, :n] ** 2).sum(axis=1) - ((values[:, :n] @ line) ** 2).sum(axis=1) - part**2
        scores.append(np.abs(part) / np.sqrt(rest / (n - 3)) > t.isf(1 / 370 / 2, n - 3))
    mean, sigma = mean_delay(np.array(scores).T, f"best test of a line after {learned} values")
    assert mean + 3 * sigma <= 10 if enough else mean - 3 * sigma > 10


def air(day: npt.NDArray[np.float64], phase: float) -> npt.NDArray[np.float64]:
    """Fronts, and the season's nine days."""
    found: npt.NDArray[np.float64] = 15 + 6 * np.sin(2 * np.pi * day / 4) + 4 * np.sin(2 * np.pi * day / 9 + phase)
    return found


@pytest.mark.parametrize(("lag_hours", "series", "count"), [(0.0, 60, 400), (12.0, 60, 200)])
def test_the_environment_alarms_nobody_once_it_is_taken_out(lag_hours: float, series: int, count: int) -> None:
    """A third of a degree's effect is as much as the noise; with the lag (4 h) told by the chart itself, too."""
    random = np.random.default_rng(5)
    times, day = every(6, count), np.arange(count) / 4
    plain, signals, known, delays = 0, 0, 0, []
    for phase in range(series):
        values = 0.9 * air(day - (4 / 24 if lag_hours else 0), phase) + random.normal(0, 0.3, count)
        drivers = followed(times, [(times, air(day, phase))], lag_hours)
        chart = control_chart(times, values, drivers=drivers)
        signals, known = signals + int(chart.signals.sum()), known + int(np.isfinite(chart.residual).sum())
        if phase < 15:
            plain += int(control_chart(times, values).signals.sum())
            values[100:] += 0.6
            delays.append(control_chart(times[:160], values[:160], drivers=drivers[:160]).signals[100:])
    between, sigma = known / signals, known / signals**1.5
    without = 15 * count / plain
    print(f"lag to {lag_hours:g} h: one false alarm in {between:.0f} +- {sigma:.0f} values, {without:.0f} if left in")
    assert abs(between - 400) < 3 * sigma
    assert without < 40
    assert mean_delay(np.array(delays), "beside the environment")[0] <= 10


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
