"""A scan of a video is followed from the one before; what jumped, tilted or fell apart in between is still found."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pipelines import Scan
from pipelines.change import Motion, compare, register
from pipelines.change.follow import followed_drift
from tests.pipelines.change.scans import bumps, sampled, scan_of

SHAPE = 400, 420
SMALL = 160, 168
"""Where nothing is found the sample is sought everywhere, turned and tilted: seconds at full size."""
PITCH = 0.02
SURFACE = bumps(seed=5, count=24)
MIDDLE = np.array([PITCH * SHAPE[1] / 2, PITCH * SHAPE[0] / 2, 0.0, 1.0])


@cache
def scan_at(
    x_cells: float = 0.0,
    y_cells: float = 0.0,
    lift: float = 0.0,
    tilt: float = 0.0,
    seed: int = 0,
    shape: tuple[int, int] = SHAPE,
) -> Scan:
    """The surface moved along x and y, lifted and tilted, with fresh noise of 1 um and a texture of its own."""
    random = np.random.default_rng(seed)
    height = sampled(lambda x, y: SURFACE(x - x_cells * PITCH, y - y_cells * PITCH) + lift + tilt * x, *shape)
    texture = 128 + 1500 * height + random.normal(0, 2, shape)
    return scan_of(height + random.normal(0, 0.001, shape), PITCH, sigma=0.001, texture=texture, hour=seed)


@cache
def first(shape: tuple[int, int] = SHAPE) -> Motion:
    """Motion of the scan before."""
    return register(scan_at(0.3, -0.2, 0.01, seed=1, shape=shape), scan_at(shape=shape))


def place(motion: Motion) -> np.ndarray:
    moved: np.ndarray = (motion.matrix @ MIDDLE - MIDDLE)[:3]
    return moved


def test_a_scan_that_hardly_moved_is_followed_to_the_same_motion() -> None:
    scan = scan_at(0.8, 0.3, 0.02, seed=2)
    assert followed_drift(scan, scan_at(), np.isfinite(scan.height), first()) is not None
    found, full = register(scan, scan_at(), near=first()), register(scan, scan_at())
    assert found.verdict == full.verdict == "good"
    truth = np.array([-0.8 * PITCH, -0.3 * PITCH, -0.02])
    for motion in (found, full):
        off = np.abs(place(motion) - truth)
        assert off[:2].max() < 0.02 * PITCH
        assert off[2] < 5e-5
    assert found.sigma_xy_mm < 2 * full.sigma_xy_mm
    assert found.sigma_z_mm < 2 * full.sigma_z_mm


@pytest.mark.parametrize(("x_cells", "y_cells", "tilt"), [(13.0, -7.0, 0.0), (0.3, -0.2, 0.004), (-6.0, 9.5, -0.003)])
def test_a_jump_in_the_middle_of_a_video_is_found(x_cells: float, y_cells: float, tilt: float) -> None:
    scan = scan_at(x_cells, y_cells, 0.05, tilt, seed=3)
    found = compare(scan, scan_at(), near=first()).change
    assert found.motion.verdict == "good", found.motion.reason
    x, y, _ = place(found.motion)
    assert abs(x / PITCH + x_cells) < 0.02
    assert abs(y / PITCH + y_cells) < 0.02
    assert found.motion.matrix[2, 0] == pytest.approx(-tilt, abs=1e-5)
    assert np.nanmedian(np.abs(found.dz)) < 0.002


def test_what_cannot_be_trusted_is_flagged_as_without_a_video() -> None:
    half = scan_at(0.3, -0.2, 0.01, seed=1).height.copy()
    half[:, SHAPE[1] // 2 :] = scan_at(8.3, -0.2, 0.01, seed=4).height[:, SHAPE[1] // 2 :]
    for height in (half, sampled(bumps(seed=77, count=24), *SMALL), np.random.default_rng(0).normal(0, 0.05, SMALL)):
        scan, before = scan_of(height, PITCH, sigma=0.001, hour=5), scan_at(shape=height.shape)
        near = first(height.shape)
        assert followed_drift(scan, before, np.isfinite(scan.height), near) is None
        found, full = register(scan, before, near=near), register(scan, before)
        assert (found.verdict, found.reason) == (full.verdict, full.reason)
        np.testing.assert_array_equal(found.matrix, full.matrix)
        assert height is half or full.verdict != "good"  # of a half that stands, the shift is the right one


def test_a_surface_that_heaved_has_the_full_verdict() -> None:
    heave = sampled(lambda x, y: 0.1 * np.sin(0.8 * x) * np.cos(0.9 * y), *SHAPE).astype(np.float32)
    before = scan_at(0.4, 0.1, 0.01, seed=6)
    scan = scan_of(before.height + heave, PITCH, sigma=0.001, texture=before.texture.astype(np.float64), hour=6)
    found = register(scan, scan_at(), near=first())
    assert found.verdict == "doubtful"
    assert "no stable areas" in found.reason
