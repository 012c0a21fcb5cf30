"""A scan that was shifted, tilted and lifted comes back onto its baseline, and says how sure it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import Scan
from pipelines.change import Motion, apply_motion, compare, difference, polygon_mask, register
from pipelines.grid import Grid
from tests.pipelines.change.scans import bumps, sampled, scan_of

SURFACE = bumps()


def moved_pair(
    dx: float, dy: float, dz: float, a: float, b: float, noise: float = 0.002, seed: int = 0
) -> tuple[Scan, Scan]:
    """Baseline, and the same surface moved by (dx, dy, dz) and tilted by (a, b) about the middle of the field."""
    random = np.random.default_rng(seed)
    before = sampled(SURFACE)
    now = sampled(lambda x, y: SURFACE(x - dx, y - dy) + dz + a * (x - 2) + b * (y - 1.6))
    return (
        scan_of(before + random.normal(0, noise, before.shape)),
        scan_of(now + random.normal(0, noise, now.shape), hour=1),
    )


@settings(max_examples=10, deadline=None)
@given(
    st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.2, 0.2), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005)
)
def test_a_known_motion_is_found(dx: float, dy: float, dz: float, a: float, b: float) -> None:
    baseline, scan = moved_pair(dx, dy, dz, a, b)
    motion = register(scan, baseline)
    assert motion.verdict == "good", motion.reason
    # where the middle of the field goes
    x, y, z = (motion.matrix @ [2, 1.6, 0, 1])[:3] - [2, 1.6, 0]
    assert abs(x + dx) < 0.0006
    assert abs(y + dy) < 0.0006
    assert abs(z + dz) < 0.0006
    assert motion.matrix[2, 0] == pytest.approx(-a, abs=2e-4)
    assert motion.matrix[2, 1] == pytest.approx(-b, abs=2e-4)
    moved = apply_motion(scan, motion)
    assert np.nanmedian(np.abs(moved.height - baseline.height)) < 0.0025
    np.testing.assert_allclose(motion.matrix[:3, :3] @ motion.matrix[:3, :3].T, np.eye(3), atol=1e-12)


def test_the_uncertainty_of_a_shift_is_honest() -> None:
    scores = []
    for seed in range(12):
        baseline, scan = moved_pair(0.031, -0.017, 0.01, 0, 0, noise=0.006, seed=seed)
        motion = register(scan, baseline)
        x, y, z = (motion.matrix @ [2, 1.6, 0, 1])[:3] - [2, 1.6, 0]
        scores += [(x + 0.031) / motion.sigma_xy_mm, (y - 0.017) / motion.sigma_xy_mm]
        assert abs(z + 0.01) < 4 * motion.sigma_z_mm
    assert 0.1 < np.sqrt(np.mean(np.square(scores))) < 2


def test_soil_that_settles_is_seen_against_ground_that_stands() -> None:
    baseline, scan = moved_pair(0, 0, 0.05, 0, 0)
    ground = np.zeros(baseline.grid.shape, dtype=np.bool_)
    ground[:, :40] = ground[:, -40:] = True
    height = scan.height.copy()
    height[:, 40:-40] -= 0.03
    settled = scan_of(height, hour=1)
    change = compare(settled, baseline, stable=ground).change
    assert change.motion.verdict == "good", change.motion.reason
    assert np.nanmedian(change.dz[:, 45:-45]) == pytest.approx(-0.03, abs=0.001)
    assert np.nanmedian(change.dz[:, 5:35]) == pytest.approx(0, abs=0.001)


def test_given_stable_areas_do_not_count_as_region() -> None:
    baseline, scan = moved_pair(0, 0, 0, 0, 0)
    ground = polygon_mask([[(0, 0), (1, 0), (1, 4), (0, 4)]], baseline.grid)
    assert not (compare(scan, baseline, stable=ground).region & ground).any()
    assert compare(scan, baseline).region.all()


def test_texture_alone_shows_a_drift() -> None:
    random = np.random.default_rng(1)
    shape = (160, 200)
    before = 128 + 800 * sampled(SURFACE)
    now = 0.8 * (128 + 800 * sampled(lambda x, y: SURFACE(x - 0.05, y + 0.03)))  # a darker lamp as well
    flat = random.normal(0, 0.002, (2, *shape))
    motion = register(scan_of(flat[1], texture=now, hour=1), scan_of(flat[0], texture=before))
    assert motion.shift_mm[0] == pytest.approx(-0.05, abs=0.001)
    assert motion.shift_mm[1] == pytest.approx(0.03, abs=0.001)


def test_ridges_in_one_direction_are_doubtful() -> None:
    random = np.random.default_rng(2)
    ridges = sampled(lambda x, _: 0.05 * np.sin(2 * np.pi * x / 0.3))
    scans = [scan_of(ridges + random.normal(0, 0.0002, ridges.shape), sigma=0.0002) for _ in range(2)]
    motion = register(scans[1], scans[0])
    assert motion.verdict == "doubtful"
    assert "one direction" in motion.reason
    assert motion.conditioning < 0.02


def test_no_majority_is_doubtful() -> None:
    baseline, scan = moved_pair(0, 0, 0, 0, 0)
    heaved = scan.height + sampled(lambda x, y: 0.1 * np.sin(1.5 * x) * np.cos(1.7 * y)).astype(np.float32)
    motion = register(scan_of(heaved, hour=1), baseline)
    assert motion.verdict == "doubtful"
    assert "no stable areas" in motion.reason


def test_half_of_the_surface_moving_sideways_is_doubtful() -> None:
    random = np.random.default_rng(3)
    before = sampled(SURFACE)
    now = before.copy()
    now[:, 100:] = sampled(lambda x, y: SURFACE(x - 0.16, y))[:, 100:]
    noise = random.normal(0, 0.002, (2, *before.shape))
    motion = register(scan_of(now + noise[0], hour=1), scan_of(before + noise[1]))
    assert motion.verdict == "doubtful"
    ground = np.zeros(before.shape, dtype=np.bool_)
    ground[:, :90] = True
    motion = register(scan_of(now + noise[0], hour=1), scan_of(before + noise[1]), ground)
    assert motion.verdict == "good", motion.reason
    assert np.hypot(*motion.shift_mm[:2]) < 0.001


@pytest.mark.parametrize("case", ["nothing measured", "elsewhere", "no ground", "another surface"])
def test_what_cannot_be_registered_fails_with_a_reason(case: str) -> None:
    baseline, scan = moved_pair(0, 0, 0, 0, 0)
    ground = None
    height = scan.height.copy()
    if case == "nothing measured":
        height[:] = np.nan
    elif case == "elsewhere":
        height[:, 50:] = np.nan
    elif case == "no ground":
        ground = np.zeros(height.shape, dtype=np.bool_)
    else:
        ground = np.ones(height.shape, dtype=np.bool_)
        height = sampled(bumps(seed=9)).astype(np.float32)
    motion = register(scan_of(height, hour=1), baseline, ground)
    assert motion.verdict == "failed"
    assert motion.reason


def test_other_grids_and_shapes_are_refused() -> None:
    baseline, scan = moved_pair(0, 0, 0, 0, 0)
    with pytest.raises(ValueError, match="different grids"):
        register(scan_of(scan.height, 0.03), baseline)
    with pytest.raises(ValueError, match="shape"):
        register(scan, baseline, np.ones((3, 3), dtype=np.bool_))
    with pytest.raises(ValueError, match="shape"):
        compare(scan, baseline, region=np.ones((3, 3), dtype=np.bool_))
    with pytest.raises(ValueError, match="different grids"):
        difference(scan_of(scan.height, 0.03), baseline, Motion.none())


def test_what_is_missing_stays_missing_and_smears_nothing() -> None:
    height = np.zeros((20, 30))
    height[:, 15:] = 5.0
    height[:, 14:16] = np.nan
    matrix = np.eye(4)
    matrix[0, 3] = 0.4 * 0.02
    motion = Motion(matrix, 0, 1, 1, 0, 0, "good")
    moved = apply_motion(scan_of(height), motion)
    finite = moved.height[np.isfinite(moved.height)]
    assert set(np.unique(finite)) == {0.0, 5.0}
    assert np.isnan(moved.height[:, 14:16]).all()
    assert np.isnan(moved.sigma).sum() == np.isnan(moved.height).sum()
    assert (moved.level == 255).sum() == np.isnan(moved.height).sum()
    assert np.isnan(moved.height[:, 0]).all()  # nothing was seen beyond the border


def test_whole_cells_move_exactly() -> None:
    height = np.random.default_rng(0).normal(size=(20, 30))
    matrix = np.eye(4)
    matrix[:3, 3] = 2 * 0.02, -3 * 0.02, 0.5
    moved = apply_motion(scan_of(height), Motion(matrix, 0, 1, 1, 0, 0, "good"))
    np.testing.assert_allclose(moved.height[:-3, 2:], height[3:, :-2] + 0.5, atol=1e-6)


def test_a_rotation_is_exact_on_a_plane() -> None:
    angle = 0.02
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    plane = sampled(lambda x, _: 0.3 + 0.1 * x, 40, 60)
    moved = apply_motion(scan_of(plane), Motion(turn, 0, 1, 1, 0, 0, "good"))
    x = np.arange(60) * 0.02
    # the plane z = 0.3 + 0.1 x turned: solve for its height over the new x
    slope = np.tan(np.arctan(0.1) + angle)
    start = turn[:3, :3] @ [0, 0, 0.3]
    expected = start[2] + slope * (x - start[0])
    inner = np.isfinite(moved.height[20])
    assert inner.sum() > 50
    np.testing.assert_allclose(moved.height[20, inner], expected[inner], atol=2e-6)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_difference_is_antisymmetric(seed: int) -> None:
    random = np.random.default_rng(seed)
    heights = random.normal(size=(2, 12, 9))
    heights[random.random(heights.shape) < 0.1] = np.nan
    a, b = scan_of(heights[0], sigma=0.01), scan_of(heights[1], sigma=0.02)
    forth, back = difference(b, a, Motion.none()), difference(a, b, Motion.none())
    np.testing.assert_array_equal(forth.dz, -back.dz)
    np.testing.assert_array_equal(forth.lod, back.lod)
    np.testing.assert_array_equal(np.isnan(forth.dz), np.isnan(heights).any(axis=0))
    np.testing.assert_allclose(forth.lod[np.isfinite(forth.lod)], 1.959964 * np.hypot(0.01, 0.02), rtol=1e-6)


def test_white_noise_is_significant_one_time_in_twenty() -> None:
    random = np.random.default_rng(5)
    noise = random.normal(0, 0.01, (2, 300, 300))
    change = difference(scan_of(noise[1], sigma=0.01), scan_of(noise[0], sigma=0.01), Motion.none())
    assert change.significant.mean() == pytest.approx(0.05, abs=0.005)


def test_polygons_share_no_cell_and_miss_none() -> None:
    grid = Grid(40, 60, 0.1, x0_mm=-1.0, y0_mm=2.0)
    left = polygon_mask([[(-2, 0), (1.3, 0), (2.1, 9), (-2, 9)]], grid)
    right = polygon_mask([[(1.3, 0), (9, 0), (9, 9), (2.1, 9)]], grid)
    assert not (left & right).any()
    assert (left | right).all()
    square = polygon_mask([[(0, 3), (1, 3), (1, 4), (0, 4)]], grid)
    assert square.sum() == 100
    with pytest.raises(ValueError, match="polygon 2"):
        polygon_mask([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1)]], grid)
