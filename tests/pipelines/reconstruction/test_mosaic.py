"""Positions of many tiles from the offsets between neighbours, and how well tiles meet."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.reconstruction import Offset, place_tiles, seam_between
from tests.pipelines.change.scans import bumps, sampled, scan_of

STAGE = (0.05, 0.05, 0.5)


def grid_of_tiles(random: np.random.Generator, n: int = 4) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Commanded and real positions of n x n tiles."""
    y, x = np.divmod(np.arange(n * n), n)
    commanded = np.stack([4.0 * x, 3.0 * y, 0.0 * x], axis=1)
    real = commanded + random.normal(0, 0.02, commanded.shape)
    real[0] = commanded[0]
    return commanded, real


def neighbours(real: npt.NDArray[np.float64], random: np.random.Generator, sigma: float) -> list[Offset]:
    n = round(np.sqrt(len(real)))
    pairs = [(k, k + 1) for k in range(n * n) if k % n < n - 1] + [(k, k + n) for k in range(n * (n - 1))]
    offsets = []
    for i, j in pairs:
        x, y, z = real[j] - real[i] + random.normal(0, sigma, 3)
        offsets.append(Offset(i, j, (x, y, z), (sigma, sigma, sigma)))
    return offsets


def test_positions_are_found_and_their_uncertainty_is_true() -> None:
    scores = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        commanded, real = grid_of_tiles(random)
        found = place_tiles(commanded, neighbours(real, random, 0.001), STAGE)
        assert np.abs(found.position_mm - real).max() < 0.006
        scores.append((found.position_mm - real)[1:] / found.sigma_mm[1:])
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1, abs=0.15)


def test_an_offset_that_went_astray_is_left_out() -> None:
    random = np.random.default_rng(1)
    commanded, real = grid_of_tiles(random)
    offsets = neighbours(real, random, 0.001)
    wrong = offsets[5]
    offsets[5] = Offset(wrong.first, wrong.second, (wrong.shift_mm[0] + 0.2, *wrong.shift_mm[1:]), wrong.sigma_mm)
    found = place_tiles(commanded, offsets, STAGE)
    assert np.flatnonzero(~found.counts).tolist() == [5]
    assert np.abs(found.position_mm - real).max() < 0.006


def test_a_tile_without_offset_stays_where_the_stage_says() -> None:
    commanded = np.array([[0.0, 0, 0], [4, 0, 0], [8, 0, 0]])
    found = place_tiles(commanded, [Offset(0, 1, (4.03, 0.01, 0.0), (0.001, 0.001, 0.001))], STAGE)
    np.testing.assert_allclose(found.position_mm[1], [4.03, 0.01, 0], atol=2e-5)
    np.testing.assert_allclose(found.position_mm[2], commanded[2])
    np.testing.assert_allclose(found.sigma_mm[2], STAGE)
    assert list(found.group == found.group[0]) == [True, True, False]


def test_a_tile_whose_offsets_all_contradict_belongs_to_no_other() -> None:
    random = np.random.default_rng(3)
    commanded, real = grid_of_tiles(random)
    offsets = neighbours(real, random, 0.001)
    for number, sign in zip((k for k, each in enumerate(offsets) if each.second == 15), (1, -1), strict=True):
        x, y, z = offsets[number].shift_mm
        offsets[number] = Offset(offsets[number].first, 15, (x + 0.3 * sign, y, z), offsets[number].sigma_mm)
    found = place_tiles(commanded, offsets, STAGE)
    assert found.counts.sum() == len(offsets) - 2
    assert list(found.group == found.group[0]) == [True] * 15 + [False]
    np.testing.assert_allclose(found.position_mm[15], commanded[15], atol=1e-6)


def test_a_seam_is_measured() -> None:
    random = np.random.default_rng(2)
    surface = bumps()
    left = scan_of(sampled(surface) + random.normal(0, 0.002, (160, 200)), sigma=0.002)
    right = sampled(lambda x, y: surface(x + 2.0, y + 0.4)) + 0.003 + random.normal(0, 0.004, (160, 200))
    seam = seam_between(left, scan_of(right, sigma=0.004, origin=(2.0, 0.4)))
    assert seam.cells == 140 * 100
    assert seam.bias_mm == pytest.approx(0.003, abs=2e-4)
    assert seam.sd_mm == pytest.approx(np.hypot(0.002, 0.004), rel=0.03)
    assert seam.over_sigma == pytest.approx(1, abs=0.03)
    assert seam_between(left, scan_of(right, origin=(40.0, 0.0))).cells == 0
