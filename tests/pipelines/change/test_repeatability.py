"""The calibrated level of detection: on scans that did not change, 5 % of the cells lie beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from pipelines import Comparison, Scan
from pipelines.change import Motion, NoiseModel, compare, difference, noise_model, repeat_pairs, unrest, volumes
from pipelines.change.noise_model import local_slope
from tests.pipelines.change.scans import bumps, sampled, scan_of

SHAPE = (120, 160)
SURFACE = sampled(bumps(seed=4), *SHAPE) * 3
SLOPE = local_slope(SURFACE.astype(np.float32), 0.02)
SAID = 0.001 + 0.003 * (np.arange(SHAPE[1]) / SHAPE[1])
"""Sigma that the scans state, growing from left to right."""


def correlated(random: np.random.Generator, cells: float) -> npt.NDArray[np.float64]:
    noise = ndimage.gaussian_filter(random.normal(size=SHAPE), cells, mode="wrap")
    scaled: npt.NDArray[np.float64] = noise * (2 * np.sqrt(np.pi) * cells)
    return scaled


def repeat(
    seed: int, *, gain: float = 1.0, smooth_mm: float = 0.002, sideways_mm: float = 0.0, reach: float = 4
) -> Scan:
    """The surface once more, with white noise of `gain` times what it states, correlated noise, and noise on slopes."""
    random = np.random.default_rng(seed)
    error = gain * SAID * random.normal(size=SHAPE) + smooth_mm * correlated(random, reach)
    error += sideways_mm * SLOPE * random.normal(size=SHAPE)
    scan = scan_of(SURFACE + error, hour=seed % 24)
    return replace(scan, sigma=np.broadcast_to(SAID, SHAPE).astype(np.float32))


def still(scans: list[Scan]) -> list[Comparison]:
    """Compared without registration, which has its own tests."""
    everywhere = np.ones(SHAPE, dtype=np.bool_)
    first, motion = scans[0], Motion.none()
    return [Comparison(first, each, difference(each, first, motion), everywhere, everywhere) for each in scans[1:]]


@pytest.mark.parametrize("seed", range(0, 600, 100))
def test_false_positives_at_nominal_5_percent(seed: int) -> None:
    model = noise_model([compare(repeat(seed + k), repeat(seed)) for k in range(1, 6)])
    assert 0.03 <= model.false_positives <= 0.07
    fresh = compare(repeat(seed + 51), repeat(seed + 50), noise=model)
    plain = compare(repeat(seed + 51), repeat(seed + 50))
    assert 0.03 <= fresh.change.significant.mean() <= 0.07
    assert plain.change.significant.mean() > 0.08  # what Lague's alone would give


def test_a_surface_that_goes_on_changing_is_not_at_rest() -> None:
    scans = [repeat(k) for k in range(6)]
    assert unrest(still(scans)) == pytest.approx(1.0, abs=0.1)
    drift = sampled(bumps(seed=9), *SHAPE).astype(np.float32)
    changing = [replace(each, height=each.height + 0.2 * k * drift) for k, each in enumerate(scans)]
    assert unrest(still(changing)) > 2.5
    assert np.isnan(unrest(still(scans[:2])))


def test_the_parts_of_the_noise_are_found() -> None:
    model = noise_model(still([repeat(k, gain=1.5, sideways_mm=0.004) for k in range(8)]))
    assert model.gain == pytest.approx(1.5, rel=0.07)
    assert model.floor_mm == pytest.approx(0.002 * np.sqrt(2), rel=0.25)
    assert model.sideways_mm == pytest.approx(0.004 * np.sqrt(2), rel=0.1)
    assert all(cell.beyond == pytest.approx(0.05, abs=0.02) for cell in model.cells)
    assert sum(cell.count for cell in model.cells) > 1000


def test_the_correlation_is_that_of_the_errors() -> None:
    model = noise_model(still([repeat(k, gain=0.0, reach=3) for k in range(8)]))
    lag = np.arange(8)
    np.testing.assert_allclose(model.correlation[:8], np.exp(-(lag**2) / (4 * 3**2)), atol=0.06)
    white = noise_model(still([repeat(k, smooth_mm=0.0) for k in range(8)]))
    assert np.abs(white.correlation[1:]).max(initial=0) < 0.02


def test_maps_without_sigma_get_a_level_of_detection() -> None:
    nothing = np.full(SHAPE, np.nan, dtype=np.float32)
    scans = [replace(repeat(k), sigma=nothing) for k in range(4)]
    model = noise_model(still(scans))
    assert model.gain == 0
    change = difference(scans[1], scans[0], Motion.none(), model)
    assert change.significant.mean() == pytest.approx(0.05, abs=0.02)


def test_volumes_of_still_scans_are_honest() -> None:
    model = noise_model(still([repeat(k) for k in range(8)]))
    region = np.zeros(SHAPE, dtype=np.bool_)
    region[30:90, 40:120] = True
    scores = []
    for seed in range(100, 160):
        change = difference(repeat(seed), repeat(seed + 200), Motion.none(), model)
        net = volumes(change, region, ~region, model).net
        scores.append(net.value / net.sigma)
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


def test_each_scan_is_in_two_pairs() -> None:
    for count in range(2, 14):
        pairs = repeat_pairs(count)
        assert len(set(pairs)) == len(pairs) == (1 if count == 2 else count)
        assert all(first < second < count for first, second in pairs)
        assert set(np.ravel(pairs)) == set(range(count))
    assert repeat_pairs(1) == []


def test_a_model_comes_back_from_its_text() -> None:
    model = noise_model(still([repeat(k) for k in range(3)]))
    back = NoiseModel.from_json(model.to_json())
    assert back.id == model.id
    assert back.to_json() == model.to_json()
    assert replace(model, gain=2.0).id != model.id
    for text in ("{}", "[]", "nonsense", '{"correlation": [1]}'):
        with pytest.raises(ValueError):
            NoiseModel.from_json(text)


def test_what_cannot_be_calibrated_is_refused() -> None:
    with pytest.raises(ValueError, match="two scans"):
        noise_model([])
    empty = replace(repeat(1), height=np.full(SHAPE, np.nan, dtype=np.float32))
    with pytest.raises(ValueError, match="cells are common"):
        noise_model(still([repeat(0), empty]))
    with pytest.raises(ValueError, match="must not be below 0"):
        replace(noise_model(still([repeat(k) for k in range(2)])), gain=-1.0)
