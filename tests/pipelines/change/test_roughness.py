"""ISO 25178-2 against closed forms, published values and another program's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.change import ROUGHNESS, Filters, filtered, roughness
from storage import read_raster
from tests.pipelines.change.scans import sampled

PITCH = 0.01
PLAIN = Filters(form=0)


def waves(amplitude: float = 0.02, wave_mm: float = 0.4) -> np.ndarray:
    """Whole waves along x: every mean over them is exact."""
    return sampled(lambda x, y: amplitude * np.sin(2 * np.pi * x / wave_mm) + 0 * y, 160, 200, PITCH)


def values(height: np.ndarray, filters: Filters = PLAIN) -> dict[str, float]:
    return {name: one.value for name, one in roughness(height, PITCH, filters).items()}


def test_a_sine_in_closed_form() -> None:
    found = values(waves())
    k = 2 * np.pi / 0.4
    assert found["Sa"] == pytest.approx(0.02 * 2 / np.pi, rel=3e-3)  # 40 cells a wave
    assert found["Sq"] == pytest.approx(0.02 / np.sqrt(2), rel=1e-12)
    assert found["Ssk"] == pytest.approx(0, abs=1e-12)
    assert found["Sku"] == pytest.approx(1.5, rel=1e-12)
    assert (found["Sp"], found["Sv"], found["Sz"]) == pytest.approx((0.02, 0.02, 0.04), rel=1e-12)
    slope = 0.02 * k * np.cos(k * PITCH * np.arange(3, 197))  # the seven-point formula leaves three cells a side out
    assert found["Sdq"] == pytest.approx(np.sqrt(np.mean(slope**2)), rel=1e-5)
    assert found["Sdr"] == pytest.approx(np.sqrt(1 + slope**2).mean() - 1, rel=1e-5)
    assert np.isnan(found["Str"])  # along the ridges the autocorrelation never falls


def test_normal_heights_have_the_core_of_theory() -> None:
    found = values(np.random.default_rng(0).normal(0, 0.003, (500, 500)))
    # the least steep 40 % of the normal curve lie between its 30 and 70 % points: Sk = 2 x 0.52440 / 0.4 sd
    assert found["Sk"] == pytest.approx(2.6220 * 0.003, rel=0.01)
    assert found["Smr1"] == pytest.approx(0.0950, abs=0.003)  # the share of a normal above 1.3110 sd
    assert found["Smr2"] == pytest.approx(0.9050, abs=0.003)
    assert found["Spk"] == pytest.approx(found["Svk"], rel=0.03)
    assert found["Ssk"] == pytest.approx(0, abs=0.02)
    assert found["Sku"] == pytest.approx(3, abs=0.03)
    even = values(np.random.default_rng(0).uniform(0, 1, (300, 300)))
    assert even["Sk"] == pytest.approx(1, rel=0.02)


def test_a_filter_passes_half_at_its_nesting_index() -> None:
    ridges = waves(wave_mm=0.2)
    inner = (slice(30, -30), slice(30, -30))
    for filters in (Filters(s_mm=0.2, form=0), Filters(l_mm=0.2, form=0)):
        passed = filtered(ridges, PITCH, filters)[inner]
        assert np.abs(passed).max() == pytest.approx(0.01, rel=0.01)


def test_form_is_taken_out_and_missing_cells_pull_nothing() -> None:
    ridges = waves()
    y, x = np.indices(ridges.shape) * PITCH
    bent = ridges + 0.3 + 0.2 * x - 0.1 * y
    assert values(bent, Filters(form=1))["Sq"] == pytest.approx(0.02 / np.sqrt(2), rel=0.05)
    curved = 0.05 * x**2 - 0.02 * x * y + 0.3 * y
    assert np.abs(filtered(curved, PITCH, Filters(form=2))).max() < 1e-12
    holes = bent.copy()
    holes[40:80, 50:120] = np.nan
    smooth = filtered(0.3 + 0 * holes, PITCH, Filters(s_mm=0.05, l_mm=0.5))
    np.testing.assert_array_equal(np.isnan(smooth), np.isnan(holes))
    assert np.nanmax(np.abs(smooth)) < 1e-12


def test_a_patterns_correlation_length() -> None:
    noise = np.random.default_rng(1).normal(size=(300, 300))
    surface = filtered(noise, PITCH, Filters(s_mm=0.2, form=0))
    found = values(surface)
    # a Gaussian of s leaves exp(-d^2 / (4 s^2)), which is 0.2 at 2 s sqrt(ln 5); s = 0.18739 x 0.2 mm
    assert found["Sal"] == pytest.approx(2 * 0.18739 * 0.2 * np.sqrt(np.log(5)), rel=0.1)
    assert found["Str"] > 0.8


def test_noise_is_in_the_uncertainty() -> None:
    random, ridges = np.random.default_rng(2), waves()
    noise = 0.002
    found = roughness(ridges + random.normal(0, noise, ridges.shape), PITCH, PLAIN, np.full(ridges.shape, noise))
    for name, truth in (("Sq", 0.02 / np.sqrt(2)), ("Sa", 0.04 / np.pi), ("Sdq", 0.02 * 2 * np.pi / 0.4 / np.sqrt(2))):
        assert abs(found[name].value - truth) < 3 * found[name].sigma
        assert found[name].sigma > 0
    assert np.isnan(roughness(ridges, PITCH, PLAIN)["Sq"].sigma)


@pytest.mark.parametrize(
    ("name", "rms_mm", "digits"),
    [
        ("al3d-1.al3d", 7.688265843e-03, 1e-9),
        ("bcrf-1.bcrf", 24.5602107e-6, 1e-8),
        ("matrix-3.txt", 3.5222919e-05, 1e-7),
        ("tmd-1.tmd", 0.0743413, 1e-6),
        ("x3p-2.x3p", 7.728e-05, 1e-4),
    ],
)
def test_published_rms_heights(shared_data: Path, name: str, rms_mm: float, digits: float) -> None:
    raster = read_raster(shared_data / "surfaces" / name)
    z = filtered(raster.height, raster.pitch_mm[0], PLAIN)
    assert np.sqrt(np.nanmean(z**2)) == pytest.approx(rms_mm, rel=digits)


def test_a_measured_surface_as_surfalize_has_it(shared_data: Path) -> None:
    raster = read_raster(shared_data / "surfaces" / "tmd-1.tmd")
    found = roughness(raster.height, raster.pitch_mm[0], PLAIN)
    # surfalize 0.19.2: Surface(z - z.mean(), px, px), heights and lengths in um there
    peer = {"Sa": 0.0655997, "Sq": 0.0743413, "Ssk": -0.303492, "Sku": 1.89238, "Sp": 0.178108, "Sv": 0.172879}
    for name, value in {**peer, "Sz": 0.350987}.items():
        assert found[name].value == pytest.approx(value, rel=1e-5)
    for name, value in {"Sal": 4.09878, "Str": 0.731758}.items():
        assert found[name].value == pytest.approx(value, rel=5e-3)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="finer than the L-filter"):
        Filters(0.5, 0.2)
    with pytest.raises(ValueError, match="above 0"):
        Filters(-1.0)
    with pytest.raises(ValueError, match="order 0, 1 or 2"):
        Filters(form=7)
    with pytest.raises(ValueError, match="cells are measured"):
        roughness(np.full((50, 50), np.nan), PITCH, PLAIN)
    assert set(values(waves())) == set(ROUGHNESS)
    flat = values(np.zeros((30, 30)))
    assert flat["Sq"] == 0
    assert np.isnan(flat["Ssk"])
