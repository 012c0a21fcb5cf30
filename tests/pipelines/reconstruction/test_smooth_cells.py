"""Cells of smooth surfaces say no more than their heights show; rough ones stay as they are."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.reconstruction.smooth_cells import ladder, reach_of, tell_smooth

SHAPE = (150, 170)
NOISE = 0.5e-3


def plane(seed: int = 0) -> np.ndarray:
    """Heights of a tilted, gently bent plate with independent noise, mm."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    noise = NOISE * np.random.default_rng(seed).standard_normal(SHAPE)
    return np.asarray(1 + 2e-3 * u - 1e-3 * v + 1e-8 * u * u + noise, np.float32)


@pytest.mark.parametrize("said", [1.0, 2.0, 4.0])
def test_sigma_comes_down_to_the_noise(said: float) -> None:
    sigma = np.full(SHAPE, said * NOISE, np.float32)
    tell_smooth(plane(), sigma, 8)
    assert sigma.max() <= said * NOISE
    assert np.median(sigma) == pytest.approx(NOISE, rel=0.12)


def test_sigma_that_is_too_small_stays() -> None:
    sigma = np.full(SHAPE, 0.5 * NOISE, np.float32)
    tell_smooth(plane(), sigma, 8)
    assert (sigma == np.float32(0.5 * NOISE)).all()


def test_rough_surfaces_and_their_neighbours_stay() -> None:
    height, sigma = plane(), np.full(SHAPE, 3 * NOISE, np.float32)
    height[:, 96:] += 0.02 * np.random.default_rng(1).standard_normal((SHAPE[0], SHAPE[1] - 96)).astype(np.float32)
    tell_smooth(height, sigma, 8)
    assert (sigma[:, 64:] == np.float32(3 * NOISE)).all()
    assert np.median(sigma[:, :32]) == pytest.approx(NOISE, rel=0.15)


def test_what_is_not_measured_stays_unmeasured_and_too_little_tells_nothing() -> None:
    height, sigma = plane(), np.full(SHAPE, 3 * NOISE, np.float32)
    height[8:, 8:], sigma[8:, 8:] = np.nan, np.nan
    tell_smooth(height, sigma, 8)
    assert np.isnan(sigma[8:, 8:]).all()
    assert (sigma[np.isfinite(sigma)] <= np.float32(3 * NOISE)).all()
    small = np.full((5, 6), 3 * NOISE, np.float32)
    tell_smooth(np.ones((5, 6), np.float32), small, 8)
    assert (small == np.float32(3 * NOISE)).all()


def test_two_stripes_are_apart() -> None:
    assert reach_of(1.6, (0.3, 0.4)) == 8
    assert reach_of(5.0, (0.7, 1.0)) == 20


PERIODS = np.linspace(2, 32, 601)


@pytest.mark.parametrize("reach", [8, 10, 13, 20, 24, 31])
def test_no_period_hides_from_all_distances(reach: int) -> None:
    """In closed form: rms of second differences over that of an independent error of the same size."""
    shown = [np.sqrt(16 / 6) * np.sin(np.pi * lag / PERIODS) ** 2 for lag in ladder(reach)]
    assert np.max(shown, axis=0).min() > 0.75


@pytest.mark.parametrize("period", [2, 2.7, 4, 5.3, 8, 11, 16, 21.7, 32])
@pytest.mark.parametrize("way", [(1, 0), (0, 1), (1, 0.75)])
def test_an_error_that_repeats_is_not_taken_for_smooth(period: float, way: tuple[float, float]) -> None:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    ripple = np.sqrt(2) * NOISE * np.sin(2 * np.pi * (way[0] * u + way[1] * v) / period + 1)
    sigma = np.full(SHAPE, NOISE, np.float32)
    tell_smooth((2e-3 * u - 1e-3 * v + ripple).astype(np.float32), sigma, 8)
    assert np.median(sigma) > 0.8 * NOISE
