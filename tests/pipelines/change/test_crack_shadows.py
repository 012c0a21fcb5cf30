"""Cracks with a wall in shadow: the rim is where the light has fallen to half, whatever the optics spread."""

from __future__ import annotations

from math import erf

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from pipelines import Scan
from pipelines.change import crack_openings
from tests.pipelines.change.scans import bumps, scan_of

PITCH = 0.02
WIDTH = 0.32


def shaded(spread: float, reach: float, colour: float, seed: int) -> Scan:
    """A crack whose floor nobody sees; light, spread by `spread` cells, lets `reach` cells of it be measured as rim."""
    y, x = np.mgrid[:200, :200] * PITCH
    wall = (np.abs((x - 2) * np.cos(0.3) + (y - 2) * np.sin(0.3)) - WIDTH / 2) / PITCH  # cells beyond the rim
    height = 0.3 * bumps(seed)(x, y)
    height[wall < -reach] = np.nan
    speckle = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=wall.shape), 2)
    ground = 160 * (1 + colour * speckle / speckle.std())
    light = 0.5 * (1 + np.vectorize(erf)(wall / (spread * np.sqrt(2))))
    return scan_of(height, PITCH, texture=np.where(np.isfinite(height), ground * light, 0))


def mean_opening(scan: Scan) -> float:
    found = crack_openings(scan)
    known = np.isfinite(found.opening_mm)
    assert known.mean() > 0.9
    return float(np.average(found.opening_mm[known], weights=found.step_mm[known]))


@pytest.mark.parametrize(("spread", "reach"), [(0.5, 0.6), (0.8, 1.0), (1.2, 1.4)])
@pytest.mark.parametrize("colour", [0.0, 0.2])
def test_the_rim_is_at_half_the_light(spread: float, reach: float, colour: float) -> None:
    """By where measurement begins the crack would be 2 * reach cells too narrow."""
    scan = shaded(spread, reach, colour, 3)
    assert mean_opening(scan) == pytest.approx(WIDTH, abs=0.25 * PITCH)
    assert crack_openings(scan).unseen_edges < 0.5


def test_a_texture_that_tells_of_no_shadow_is_not_asked() -> None:
    scan = shaded(0.8, 0.0, 0.0, 3)
    flat: npt.NDArray[np.uint8] = np.full(scan.height.shape, 128, dtype=np.uint8)
    for texture in (flat, flat * 0):
        plain = Scan(scan.grid, scan.time, scan.height, scan.sigma, texture, scan.level)
        assert mean_opening(plain) == pytest.approx(WIDTH, abs=0.5 * PITCH)
        assert crack_openings(plain).unseen_edges > 0.9
