"""Environment: a known effect with a known lag is taken out, and the interval of what is left holds the truth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.trends import Corrected, correct_for, trend

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]
START = np.datetime64("2026-01-01", "ns")
RATE, NOISE, LAG_HOURS = 0.004, 0.05, 4.0


def temperature(day: Floats, seed: int) -> Floats:
    """Days and fronts."""
    found: Floats = 15 + 6 * np.sin(2 * np.pi * day) + 4 * np.sin(2 * np.pi * day / 9 + seed)
    return found


def humidity(day: Floats, seed: int) -> Floats:
    found: Floats = 60 + 15 * np.sin(2 * np.pi * day / 3.3 + 2 * seed)
    return found


Drivers = dict[str, tuple[Times, Floats]]


def moments(day: Floats) -> Times:
    return START + (day * 86400e9).astype("timedelta64[ns]")


def series(seed: int, count: int = 160) -> tuple[Times, Floats, Drivers]:
    """A metric that creeps, and follows temperature and humidity of four hours ago, at irregular times."""
    random = np.random.default_rng(seed)
    day = np.sort(random.uniform(0, 40, count))
    then = day - LAG_HOURS / 24
    effect = 0.05 * (temperature(then, seed) - 15) - 0.01 * (humidity(then, seed) - 60)
    values = 1 + RATE * day + effect + random.normal(0, NOISE, count)
    read = np.arange(-1, 41, 1 / 24)  # a logger, every hour
    drivers = {
        name: (moments(read), of(read, seed)) for name, of in (("temperature", temperature), ("humidity", humidity))
    }
    return moments(day), values, drivers


def corrected(seed: int) -> Corrected:
    times, values, drivers = series(seed)
    found = correct_for(times, values, np.full(values.shape, NOISE), drivers, 12.0)
    assert found is not None
    return found


def test_intervals_hold_the_truth_and_are_narrower_than_without() -> None:
    found = [corrected(seed) for seed in range(200)]
    held = np.mean([each.low <= RATE <= each.high for each in found])
    assert 0.91 <= held <= 0.985  # 95 % in 200: three standard deviations are 4.6 %
    score = [(each.slope_per_day - RATE) / each.slope_sigma for each in found]
    assert np.std(score) == pytest.approx(1, abs=0.16)
    assert np.mean([each.lag_hours for each in found]) == pytest.approx(LAG_HOURS, abs=0.5)
    for name, truth in (("temperature", 0.05), ("humidity", -0.01)):
        effects = [next(each for each in one.effects if each.name == name) for one in found]
        assert np.mean([each.per_unit for each in effects]) == pytest.approx(truth, rel=0.03)
        assert np.std([(each.per_unit - truth) / each.sigma for each in effects]) < 1.3
    times, values, _ = series(0)
    raw = trend(times, values)
    assert found[0].high - found[0].low < (raw.high - raw.low) / 2


def test_corrected_values_lie_on_the_creep() -> None:
    times, _, _ = series(1)
    found = corrected(1)
    day = (times - times[0]) / np.timedelta64(1, "D")
    off = found.values - np.polyval(
        np.polyfit(day[np.isfinite(found.values)], found.values[np.isfinite(found.values)], 1), day
    )
    assert np.nanstd(off) == pytest.approx(NOISE, rel=0.2)
    assert (found.sigmas[np.isfinite(found.sigmas)] >= NOISE).all()


def test_a_few_gross_errors_do_not_count() -> None:
    times, values, drivers = series(2)
    values[[10, 50, 90]] += 5
    found = correct_for(times, values, np.full(values.shape, NOISE), drivers, 12.0)
    assert found is not None
    assert found.low <= RATE <= found.high
    assert found.slope_sigma < 0.002


def test_a_sensor_that_fell_silent_is_not_bridged() -> None:
    times, values, drivers = series(3)
    gap = (times[60], times[100])
    for read, driver in drivers.values():
        driver[(read >= gap[0]) & (read <= gap[1])] = np.nan
    found = correct_for(times, values, np.full(values.shape, NOISE), drivers)
    assert found is not None
    assert np.isnan(found.values[61:100]).all()
    assert found.count < 125


@pytest.mark.parametrize("what", ["few", "constant", "unknown", "none"])
def test_where_nothing_can_be_told_nothing_is_said(what: str) -> None:
    times, values, drivers = series(4, 11 if what == "few" else 60)
    if what == "constant":
        drivers["humidity"][1][:] = 60
    elif what == "unknown":
        drivers["humidity"][1][:] = np.nan
    elif what == "none":
        drivers = {}
    assert correct_for(times, values, np.full(values.shape, NOISE), drivers, 6.0) is None


def test_arrays_of_other_lengths_are_refused() -> None:
    times, values, drivers = series(5)
    with pytest.raises(ValueError, match="as many times"):
        correct_for(times, values[1:], values[1:], drivers)
