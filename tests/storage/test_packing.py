"""Packed heights come back within half a step, and the step that is chosen for strange heights is small beside them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs import StoreError
from pipelines import Grid, Scan
from storage import Packing, fitting_packing
from storage.packing import STEP_MM, pack_sigmas

SEEDS = st.integers(0, 2**32 - 1)


def _scan(relief_mm: float, noise_mm: float, sigma_mm: float = np.nan, seed: int = 0) -> Scan:
    """A wave of a given standard deviation, noise on it, a hole."""
    grid = Grid(24, 40, 0.01)
    rng = np.random.default_rng(seed)
    wave = np.sqrt(2) * relief_mm * np.sin(np.arange(40) / 6.0)
    height = (wave + noise_mm * rng.normal(size=grid.shape)).astype(np.float32)
    sigma = np.full(grid.shape, sigma_mm, np.float32)
    height[2:5, 3] = sigma[2:5, 3] = np.nan
    plain = np.zeros(grid.shape, np.uint8)
    return Scan(grid, np.datetime64("2026-01-01", "ns"), height, sigma, plain, plain, "x")


@settings(deadline=None)
@given(seed=SEEDS, kind=st.sampled_from(["int16", "int32"]), decade=st.integers(0, 5))
def test_heights_come_back_within_half_a_step(seed: int, kind: str, decade: int) -> None:
    packing = Packing("int16" if kind == "int16" else "int32", STEP_MM / 10**decade)
    rng = np.random.default_rng(seed)
    heights = (packing.reach_mm * rng.uniform(-1, 1, (7, 11))).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = np.nan
    back = packing.unpack(packing.pack(heights, "height"))
    np.testing.assert_array_equal(np.isnan(back), np.isnan(heights))
    assert np.nanmax(np.abs(back - heights), initial=0) <= 0.51 * packing.step_mm + 2.0**-23 * packing.reach_mm
    np.testing.assert_array_equal(packing.pack(back, "height"), packing.pack(heights, "height"), "packed again alike")


@settings(deadline=None)
@given(seed=SEEDS, relief=st.floats(-6, 4), noise=st.floats(-7, 0), sigma=st.one_of(st.none(), st.floats(-6, 1)))
def test_the_chosen_step_is_small_beside_relief_noise_and_sigma(
    seed: int, relief: float, noise: float, sigma: float | None
) -> None:
    scan = _scan(10**relief, 10**noise, np.nan if sigma is None else 10**sigma, seed)
    packing = fitting_packing([_scan(1.0, 0.1), scan])
    back = packing.unpack(packing.pack(scan.height, "height"))
    error, floor = float(np.nanstd(back - scan.height)), 2.0**-22 * float(np.nanmax(np.abs(scan.height)))
    assert error <= 0.01 * float(np.nanstd(scan.height)) + floor
    between_neighbours = np.hypot(10**noise, 10**relief / 36)  # noise, and how much the wave bends
    assert error <= 0.2 * (between_neighbours if sigma is None else 10**sigma) + floor
    assert packing.step_mm <= STEP_MM


def test_soil_keeps_the_usual_packing() -> None:
    assert fitting_packing([_scan(0.3, 0.005)]) == Packing("int16")
    assert fitting_packing([_scan(0.3, 1e-5, sigma_mm=0.004)]) == Packing("int16"), "a known sigma tells the noise"
    assert fitting_packing([_scan(20.0, 0.005)]) == Packing("int32")


@pytest.mark.parametrize("packing", [Packing("int16"), Packing("int32", 5e-7)])
def test_what_does_not_fit_is_refused(packing: Packing) -> None:
    for wrong in (1.01 * packing.reach_mm, -1.01 * packing.reach_mm, np.inf):
        heights = np.zeros((300, 300), np.float32)
        heights[200, 7] = wrong
        with pytest.raises(StoreError, match=r"a change of -?(inf|[\d.]+) mm does not fit this store's \+-"):
            packing.pack(heights, "change")


@settings(deadline=None)
@given(seed=SEEDS, quantum=st.sampled_from([0.0, STEP_MM, 5e-6]))
def test_sigmas_keep_8_bits_and_take_the_rounding_in(seed: int, quantum: float) -> None:
    rng = np.random.default_rng(seed)
    sigmas = (10 ** rng.uniform(-6, 1, (5, 9))).astype(np.float32)
    sigmas[0, 0] = np.nan
    np.testing.assert_allclose(pack_sigmas(sigmas, quantum), np.hypot(sigmas, quantum / np.sqrt(12)), rtol=0.0040)
