"""Views merged on one grid: what agrees is averaged with the right sigma, two surfaces never are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import Grid, Scan
from pipelines.reconstruction import LEVEL_CONTESTED, View, covering_grid, edge_weight, merge, regrid
from tests.pipelines.change.scans import bumps, sampled, scan_of

SURFACE = bumps()


def shifted(x: float, y: float, z: float = 0.0, turn_deg: float = 0.0) -> npt.NDArray[np.float64]:
    matrix = np.eye(4)
    a = np.deg2rad(turn_deg)
    matrix[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    matrix[:3, 3] = x, y, z
    return matrix


def noisy(values: npt.NDArray[np.float64], sigma: float, seed: int) -> Scan:
    noise = np.random.default_rng(seed).normal(0, sigma, values.shape)
    return scan_of(values + noise, sigma=sigma)


def test_a_moved_plane_is_still_that_plane() -> None:
    scan = scan_of(sampled(lambda x, y: 0.3 + 0.5 * x - 0.2 * y, 60, 80))
    for turn in (0.0, 3.0, 90.0, 180.0):
        matrix = shifted(0.0137, -0.0271, 0.05, turn)
        moved = regrid(scan, matrix, covering_grid([scan], [matrix], 0.02))
        x, y = np.meshgrid(moved.grid.x_mm, moved.grid.y_mm)
        back = np.linalg.inv(matrix) @ np.stack([x.ravel(), y.ravel(), 0 * x.ravel(), np.ones(x.size)])
        expected = (0.3 + 0.5 * back[0] - 0.2 * back[1] + 0.05).reshape(x.shape)
        good = np.isfinite(moved.height)
        assert good.sum() > 0.95 * scan.height.size
        np.testing.assert_allclose(moved.height[good], expected[good], atol=4e-5)  # offsets are kept to 1/254 cell


def test_a_wall_stays_sharp() -> None:
    height = np.zeros((40, 50))
    height[:, 25:] = 1.0
    moved = regrid(scan_of(height), shifted(0.0093, 0.0041), Grid(40, 50, 0.02))
    assert set(np.unique(moved.height[np.isfinite(moved.height)])) == {0.0, 1.0}


def test_own_noise_is_averaged_and_what_is_shared_is_not() -> None:
    truth = sampled(SURFACE)
    common = 0.003 * np.cos(np.linspace(0, 3, truth.shape[1]))[None, :] * np.sqrt(2)  # rms of about 0.003
    views = []
    for seed, sigma in enumerate((0.002, 0.002, 0.004)):
        scan = noisy(truth + common, sigma, seed)
        scan = replace(scan, sigma=np.full(truth.shape, np.hypot(sigma, 0.003), np.float32), calibration_id="rig")
        views.append(View(scan, bow_mm=0.003))
    merged = merge(views, views[0].scan.grid)
    own = 1 / np.sqrt(1 / 0.002**2 + 1 / 0.002**2 + 1 / 0.004**2)
    assert merged.scan.calibration_id == "rig"
    assert np.median(merged.views) == 3
    assert not merged.contested.any()
    np.testing.assert_allclose(merged.scan.sigma, np.hypot(own, 0.003), rtol=1e-4)
    assert np.std(merged.scan.height - truth - common) == pytest.approx(own, rel=0.03)
    apart = merge([replace(view, bow_mm=0.0) for view in views[:1]], views[0].scan.grid)
    np.testing.assert_allclose(apart.scan.sigma, views[0].scan.sigma, rtol=1e-6)


def test_where_a_view_lies_counts_in_sigma_and_sideways_only_on_slopes() -> None:
    flat = scan_of(np.zeros((30, 30)), sigma=0.001)
    steep = scan_of(sampled(lambda x, _: 1.0 * x, 30, 30), sigma=0.001)
    for scan, expected in ((flat, np.hypot(0.001, 0.002)), (steep, np.sqrt(0.001**2 + 0.002**2 + 0.005**2))):
        merged = merge([View(scan, sigma_z_mm=0.002, sigma_xy_mm=0.005)], scan.grid)
        np.testing.assert_allclose(merged.scan.sigma[5:-5, 5:-5], expected, rtol=1e-3)


def test_the_majority_counts_and_two_surfaces_are_never_averaged() -> None:
    low, high = scan_of(np.zeros((10, 12)), sigma=0.002), scan_of(np.full((10, 12), 0.5), sigma=0.002)
    merged = merge([View(low), View(high), View(low)], low.grid)
    assert (merged.scan.height == 0).all()
    assert not merged.contested.any()
    assert (merged.views == 2).all()
    tie = merge([View(low), View(high)], low.grid)
    assert (tie.scan.height == 0.5).all()  # the upper one, as where one view's cell holds two surfaces
    assert (tie.scan.level == LEVEL_CONTESTED).all()
    worse = replace(high, sigma=np.full((10, 12), 0.02, np.float32))
    better = merge([View(worse), View(low)], low.grid)
    assert (better.scan.height == 0).all()
    assert better.contested.all()


def test_a_wall_that_each_view_sees_half_of() -> None:
    """A trench 1 mm deep lit from the left, then from the right: each leaves a shadow on the floor."""
    truth = np.zeros((80, 200))
    truth[:, 70:130] = -1.0
    views = []
    for seed, dark in enumerate((slice(70, 105), slice(95, 130))):
        seen = truth.copy()
        seen[:, dark] = np.nan
        views.append(noisy(seen, 0.002, seed))
    merged = merge([View(each) for each in views], views[0].grid)
    assert max(each.coverage for each in views) < 0.83
    assert merged.scan.coverage > 0.94
    good = np.isfinite(merged.scan.height)
    error = (merged.scan.height - truth)[good]
    assert np.abs(error).max() < 0.012
    assert np.std(error / merged.scan.sigma[good]) == pytest.approx(1, abs=0.03)
    assert np.isnan(merged.scan.height[:, 96:104]).all()  # nobody saw it: nothing is invented


def test_a_step_between_tiles_is_faded_not_kept() -> None:
    left, right = np.zeros((60, 200)), np.full((60, 200), 0.004)
    left[:, 130:], right[:, :70] = np.nan, np.nan
    views = [scan_of(left, sigma=0.002), scan_of(right, sigma=0.002)]
    merged = merge([View(each, weight=edge_weight(each, 20)) for each in views], views[0].grid)
    profile = merged.scan.height[30]
    assert np.abs(np.diff(profile)).max() < 0.0008
    assert profile[65] == 0
    assert profile[140] == np.float32(0.004)
    middle = merged.scan.sigma[30, 100]
    assert middle == pytest.approx(0.002 / np.sqrt(2), rel=0.02)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31))
def test_the_order_of_views_does_not_matter_and_nothing_lies_outside_of_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    heights = random.choice([0.0, 1.0], (3, 9, 11)) + random.normal(0, 0.001, (3, 9, 11))
    heights[random.random(heights.shape) < 0.2] = np.nan
    views = [View(scan_of(each, sigma=0.001 * (1 + n))) for n, each in enumerate(heights)]
    merged, back = (merge(each, views[0].scan.grid) for each in (views, views[::-1]))
    np.testing.assert_allclose(merged.scan.height, back.scan.height, atol=1e-6)
    np.testing.assert_allclose(merged.scan.sigma, back.scan.sigma, rtol=1e-5)
    good = np.isfinite(merged.scan.height)
    np.testing.assert_array_equal(good, np.isfinite(heights).any(axis=0))
    nearest = np.nanmin(np.abs(heights - merged.scan.height), axis=0, where=good, initial=np.inf)
    assert (nearest[good] < 0.01).all()


def test_cells_that_do_not_fit_are_refused() -> None:
    scan = scan_of(np.zeros((5, 5)))
    with pytest.raises(ValueError, match="regrid the view first"):
        merge([View(scan)], Grid(5, 5, 0.02, x0_mm=0.007))
    with pytest.raises(ValueError, match="nothing to merge"):
        merge([], scan.grid)
    with pytest.raises(ValueError, match="no cell was measured"):
        covering_grid([scan_of(np.full((5, 5), np.nan))], [np.eye(4)], 0.02)
