"""Change points and rates of cells: jumps found where they are, none where there is none, rates of closed form."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.trends import RateMoments, change_points

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]
START = np.datetime64("2026-01-01", "ns")


def irregular(random: np.random.Generator, count: int = 120) -> tuple[Times, Floats]:
    times = START + np.sort(random.integers(0, 60 * 86400, count)).astype("timedelta64[s]")
    return times, (times - START) / np.timedelta64(1, "D")


def test_a_steady_course_has_none() -> None:
    found = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        times, day = irregular(random)
        found += bool(change_points(times, 5 + 0.02 * day + random.normal(0, 0.1, len(day))))
    assert found <= 5  # at 2 %, three standard deviations more


def test_a_jump_is_found_in_its_place_with_its_size() -> None:
    score, right = [], 0
    for seed in range(30):
        random = np.random.default_rng(seed)
        times, day = irregular(random)
        values = 0.02 * day + random.normal(0, 0.1, len(day)) + 0.4 * (np.arange(len(day)) >= 70)
        found = change_points(times, values)
        if len(found) == 1 and abs(int(np.searchsorted(times, found[0].time)) - 70) <= 2:
            right += 1
            score.append((found[0].shift - 0.4) / found[0].sigma)
    assert right >= 27
    assert np.std(score) < 1.4


def test_a_change_of_rate_is_one_too() -> None:
    random = np.random.default_rng(1)
    times, day = irregular(random)
    (found,) = change_points(times, np.maximum(day - 30, 0) * 0.1 + random.normal(0, 0.1, len(day)))
    assert abs(float((found.time - START) / np.timedelta64(1, "D")) - 30) < 4
    assert found.rate_before == pytest.approx(0, abs=0.02)
    assert found.rate_after == pytest.approx(0.1, abs=0.02)


def test_a_slow_wander_is_not_cut_to_pieces() -> None:
    """Residuals that follow each other are not as many pieces of evidence."""
    cut = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        times, day = irregular(random)
        noise = np.zeros(len(day))
        for n in range(1, len(day)):
            noise[n] = 0.6 * noise[n - 1] + random.normal(0, 0.1)
        cut += len(change_points(times, noise))
    assert cut <= 10


def test_many_values_are_thinned_and_a_jump_keeps_its_place() -> None:
    random = np.random.default_rng(0)
    times = START + np.arange(5000).astype("timedelta64[h]")
    values = random.normal(0, 1, 5000) + 2.0 * (np.arange(5000) >= 3000)
    (found,) = change_points(times, values)
    assert abs(float((found.time - times[3000]) / np.timedelta64(1, "h"))) <= 50
    assert found.shift == pytest.approx(2, abs=4 * found.sigma)


@pytest.mark.parametrize("values", [[], [1.0] * 5, [1.0] * 40, [np.nan] * 30])
def test_series_that_tell_nothing(values: list[float]) -> None:
    assert change_points(START + np.arange(len(values)).astype("timedelta64[h]"), np.array(values)) == ()


def test_rates_of_cells_are_the_least_squares_slopes() -> None:
    random = np.random.default_rng(2)
    day = np.sort(random.uniform(0, 30, 40))
    truth = random.normal(0, 0.01, (6, 7))
    stack = truth * day[:, np.newaxis, np.newaxis] + random.normal(0, 0.02, (40, 6, 7))
    stack[random.random(stack.shape) < 0.2] = np.nan
    stack[4:, 0, 0] = np.nan
    moments = RateMoments((6, 7))
    for each, values in zip(day.tolist(), stack.astype(np.float32), strict=True):
        moments.add(each, values)
    rate, sigma = moments.rate()
    assert np.isnan(rate[0, 0])
    for row, column in ((0, 1), (3, 3), (5, 6)):
        cell = stack[:, row, column]
        known = np.isfinite(cell)
        fit, covariance = np.polyfit(day[known], cell[known], 1, cov=True)
        assert rate[row, column] == pytest.approx(fit[0], abs=1e-7)
        assert sigma[row, column] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    score = (rate - truth) / sigma
    assert np.nanstd(score) == pytest.approx(1, abs=0.35)
