"""Depth and volume of cracks: closed forms with noise, floors that nobody sees, and the soils."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.change import CrackDepths, crack_depths, crack_mask
from pipelines.change.crack_lines import crack_lines
from tests.pipelines.change.scans import bumps, sampled, scan_of, soil_scan

PITCH = 0.02
Floats = npt.NDArray[np.float64]


def crack(width: float, depth: float, step: float = 0.0) -> tuple[Floats, Floats]:
    """A parabolic crack across a rough surface, the far plate `step` higher, and its distance from the middle line."""

    def across(x: Floats, y: Floats) -> Floats:
        return np.asarray((x - 2.4) * np.cos(0.4) + (y - 2.4) * np.sin(0.4), dtype=np.float64)

    def surface(x: Floats, y: Floats) -> Floats:
        u = across(x, y)
        missing = depth * np.clip(1 - (2 * u / width) ** 2, 0, None)
        plates = 0.3 * bumps(4)(x, y) + step * np.clip(0.5 + u / width, 0, 1)
        return np.asarray(plates - missing, dtype=np.float64)

    return sampled(surface, 240, 240, PITCH), np.abs(sampled(across, 240, 240, PITCH))


def measured(height: Floats) -> CrackDepths:
    scan = scan_of(height, PITCH, sigma=0.003)
    mask = crack_mask(scan)
    return crack_depths(scan, mask, crack_lines(mask))


@pytest.mark.parametrize("width", [0.12, 0.3])
@pytest.mark.parametrize("step", [0.0, 0.1])
def test_a_crack_of_known_shape(width: float, step: float) -> None:
    height, _ = crack(width, 0.5, step)
    found = measured(height + np.random.default_rng(2).normal(0, 0.003, height.shape))
    truth = 2 / 3 * width * 0.5 * 4.8 / np.cos(0.4)
    assert found.seen == 1.0
    assert found.volume.value == pytest.approx(truth, rel=0.1)
    assert abs(found.volume.value - truth) < 2.5 * found.volume.sigma
    assert found.mean.value == pytest.approx(0.5, rel=0.1)


def test_an_unseen_floor_makes_it_at_least() -> None:
    height, distance = crack(0.3, 0.5)
    whole = measured(height)
    height[distance < 0.08] = np.nan
    found = measured(height)
    assert 0.3 < found.seen < 0.6
    assert found.volume.value < 0.5 * whole.volume.value
    assert np.isnan(found.depth_mm[distance < 0.08]).all()
    # nothing is seen along the middle
    assert np.isnan(found.mean.value)


def test_no_crack_and_nothing_measured() -> None:
    for height in (sampled(bumps(1), 60, 60), np.full((60, 60), np.nan)):
        found = measured(height)
        assert np.isnan(found.volume.value)
        assert np.isnan(found.seen)


@pytest.mark.parametrize(("name", "epoch"), [("a", 0), ("a", 1), ("b", 0), ("b", 1)])
def test_soils(shared_data: Path, name: str, epoch: int) -> None:
    scan, _, known = soil_scan(shared_data, name, epoch)
    width, depth = known["width_mm"][epoch], known["depth_mm"][epoch]
    truth = depth * np.clip(1 - (2 * known["edge_distance"] / width) ** 2, 0, None).sum() * scan.grid.cell_mm2
    mask = crack_mask(scan)
    found = crack_depths(scan, mask, crack_lines(mask))
    assert found.volume.value == pytest.approx(truth, rel=0.03)
    assert abs(found.volume.value - truth) < 2.5 * found.volume.sigma
    assert found.mean.value == pytest.approx(depth, rel=0.05)
