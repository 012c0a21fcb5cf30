"""Triangulation is exact on exact input, and gridding keeps planes, steps and cracks as they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import LEVEL_NONE, Grid, PointMap, Scan, parse_instant
from pipelines.reconstruction import Calibration, Decoded, footprint_grid, to_scan, triangulate
from pipelines.reconstruction.clean import reject_mixed
from pipelines.reconstruction.gridding import round_125

from .exact_rig import Floats, make_rig, see

NOON = parse_instant("2026-11-22T12:00:00Z")


def flat(x: Floats, y: Floats) -> Floats:
    return np.zeros_like(x)


def tilted(x: Floats, y: Floats) -> Floats:
    return 0.3 * x - 0.2 * y + 0.1


def step_with_crack(x: Floats, y: Floats) -> Floats:
    """1 mm up at x = 0.8, and cracks 0.4 mm wide and 0.6 mm deep along x = -1 and x = -4.5."""
    return np.where(x > 0.8, 1.0, 0.0) - np.where((np.abs(x + 1) < 0.2) | (np.abs(x + 4.5) < 0.2), 0.6, 0.0)


@cache
def seen(name: str) -> tuple[Calibration, Decoded, Floats]:
    rig = make_rig()
    decoded, points = see(rig, {"flat": flat, "tilted": tilted, "crack": step_with_crack}[name])
    return rig, decoded, points


def test_triangulation_is_exact() -> None:
    rig, decoded, points = seen("tilted")
    found = triangulate(decoded, rig)
    error = np.abs(found.xyz - points)[found.valid]
    assert found.valid.mean() > 0.9
    assert error.max() < 2e-4  # mm at 50 mm: float32 positions on the projector are good to 3e-5 px
    assert np.isnan(found.xyz[~found.valid]).all()
    assert (found.level[found.valid] == 0).all()
    assert (found.level[~found.valid] == 255).all()


@pytest.mark.parametrize("missing", ["row", "column"])
def test_one_axis_is_enough_where_it_carries_parallax(missing: str) -> None:
    rig, decoded, points = seen("tilted")
    gap = np.full_like(decoded.column, np.nan)
    if missing == "row":
        decoded = replace(decoded, row=gap, sigma_row=gap)
    else:
        decoded = replace(decoded, column=gap, sigma_column=gap)
    found = triangulate(decoded, rig)
    error = np.abs(found.xyz[..., 2] - points[..., 2])[found.valid]
    if missing == "row":
        assert error.max() < 2e-4
        assert found.projector[..., 1][found.valid].std() > 50  # the missing axis is where the ray falls
    else:  # hardly any parallax along rows: sigma says so
        assert np.nanmedian(found.sigma_z) > 5 * np.nanmedian(triangulate(seen("tilted")[1], rig).sigma_z)


def test_sigma_is_what_noise_does() -> None:
    rig, decoded, points = seen("tilted")
    random = np.random.default_rng(5)
    noisy = replace(
        decoded,
        column=(decoded.column + random.normal(0, 0.05, decoded.column.shape)).astype(np.float32),
        row=(decoded.row + random.normal(0, 0.05, decoded.row.shape)).astype(np.float32),
    )
    found = triangulate(noisy, rig)
    ratio = ((found.xyz[..., 2] - points[..., 2]) / found.sigma_z)[found.valid]
    assert ratio.std() == pytest.approx(1, abs=0.02)
    assert abs(ratio.mean()) < 0.02


def test_rays_that_pass_each_other_are_rejected() -> None:
    rig, decoded, _ = seen("flat")
    row = decoded.row.copy()
    row[100:120, 200:260] += 16  # a Gray error along rows leaves the epipolar line
    found = triangulate(replace(decoded, row=row), rig)
    assert not found.valid[100:120, 200:260].any()
    assert found.valid[130:150, 200:260].all()


def test_a_pixel_that_lost_the_axis_of_the_parallax_is_rejected() -> None:
    rig, decoded, _ = seen("flat")
    column, row = decoded.column.copy(), decoded.row.copy()
    column[100:120, 200:260] = np.nan  # what is left lies in planes that hold the camera's ray, nearly
    row[200:220, 200:260] = np.nan
    found = triangulate(replace(decoded, column=column, row=row), rig)
    assert not found.valid[100:120, 200:260].any()
    assert (found.level[100:120, 200:260] == LEVEL_NONE).all()
    assert found.valid[200:220, 200:260].all()
    assert found.valid[130:150, 200:260].all()


def test_images_of_another_size_are_refused() -> None:
    _, decoded, _ = seen("flat")
    with pytest.raises(ValueError, match="images of 640x400, but the calibration is for 320x200"):
        triangulate(decoded, make_rig((320, 200)))


def scan_of(name: str, grid: Grid | None = None) -> Scan:
    rig, decoded, _ = seen(name)
    return to_scan(triangulate(decoded, rig), rig, grid or footprint_grid(rig), NOON)


def test_footprint_covers_the_common_view_at_camera_pixels() -> None:
    rig, _, points = seen("flat")
    grid = footprint_grid(rig)
    assert grid.pitch_mm == 0.02  # 50 mm / 2048 px = 0.0244 mm
    x0, x1, y0, y1 = grid.extent_mm
    site = points @ rig.reference[:, :3].T + rig.reference[:, 3]
    assert x0 <= site[..., 0].min() + 0.1
    assert x1 >= site[..., 0].max() - 0.1
    assert (x1 - x0, y1 - y0) == pytest.approx((640 * 50 / 2048, 400 * 50 / 2048), rel=0.03)
    assert footprint_grid(rig, 0.1).pitch_mm == 0.1
    away = replace(rig, t_mm=rig.t_mm + np.array([500.0, 0, 0]))
    with pytest.raises(ValueError, match="no common part"):
        footprint_grid(away)


@given(st.floats(1e-6, 1e6))
def test_a_default_pitch_is_a_round_number_near(value: float) -> None:
    rounded = round_125(value)
    assert rounded / value == pytest.approx(1, rel=0.6)
    assert f"{rounded:e}"[0] in "125"
    assert float(f"{rounded:.1g}") == pytest.approx(rounded)


def test_a_tilted_plane_stays_that_plane() -> None:
    scan = scan_of("tilted", Grid(200, 300, 0.04, -6.0, -4.0))
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    error = scan.height - tilted(x, y)
    inner = np.isfinite(error)
    assert inner.mean() > 0.9
    assert np.abs(error[inner].mean()) < 1e-6
    assert np.abs(error[inner]).max() < 1.5e-4  # 0.5 % of what half a cell of this slope makes
    assert (scan.texture[inner] == 200).all()
    assert (scan.level[inner] == 0).all()
    assert (scan.level[~inner] == 255).all()
    assert np.isnan(scan.sigma[~inner]).all()


def test_edges_stay_sharp_and_crack_floors_stay() -> None:
    scan = scan_of("crack")
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    near = np.isfinite(scan.height) & (np.abs(y) < 3) & (np.abs(x) < 5)
    height = scan.height[near]
    # 1.0 above, 0 between, -0.6 on the floor; a wall is a wall, not a slope of averages
    off = np.min(np.abs(height[:, None] - np.array([1.0, 0.0, -0.6])), axis=1)
    assert (off > 0.02).mean() < 0.003
    floor = np.abs(scan.height + 0.6) < 0.02
    assert floor.sum() > 1000
    assert np.minimum(np.abs(x[floor] + 1), np.abs(x[floor] + 4.5)).max() < 0.25
    hidden = np.isnan(scan.height) & (np.abs(y) < 3) & (np.abs(x + 4.5) < 0.2)
    # the wall hides 0.6 mm x 4.7 / 50 of the floor from the camera: it is not invented
    assert hidden.sum() * scan.grid.cell_mm2 == pytest.approx(6 * 0.6 * 4.7 / 50, rel=0.3)


def test_gaps_wider_than_a_cell_are_not_filled() -> None:
    rig, decoded, _ = seen("flat")
    points = triangulate(decoded, rig)
    sigma, xyz = points.sigma_z.copy(), points.xyz.copy()
    sigma[150:170, 300:330], xyz[150:170, 300:330] = np.nan, np.nan
    scan = to_scan(replace(points, sigma_z=sigma, xyz=xyz), rig, footprint_grid(rig), NOON)
    site = points.xyz[160, 315] @ rig.reference[:, :3].T + rig.reference[:, 3]
    row = round((site[1] - scan.grid.y0_mm) / scan.grid.pitch_mm)
    column = round((site[0] - scan.grid.x0_mm) / scan.grid.pitch_mm)
    assert np.isnan(scan.height[row - 6 : row + 7, column - 12 : column + 13]).all()
    whole = scan.height[50:100, 100:500]
    assert np.isfinite(whole).all()  # and single empty cells between measured ones are


def cloud(depth: Floats) -> PointMap:
    rows, columns = depth.shape
    rays = np.stack([*np.meshgrid(np.arange(columns), np.arange(rows)), np.full(depth.shape, 2000.0)], axis=-1) / 2000
    grey = np.zeros(depth.shape, np.uint8)
    xyz = (rays * depth[..., None]).astype(np.float32)
    sigma = np.where(np.isfinite(depth), 0.002, np.nan).astype(np.float32)
    return PointMap(xyz, sigma, np.zeros((*depth.shape, 2), np.float32), grey, grey)


def heights_of(depth: Floats) -> npt.NDArray[np.float32]:
    rig = make_rig((depth.shape[1], depth.shape[0]))
    return to_scan(cloud(depth), rig, Grid(300, 400, 0.05, -10.0, -7.5), NOON).height


def test_a_background_that_stands_apart_is_removed_and_a_wide_crack_is_not() -> None:
    random = np.random.default_rng(0)
    depth = 50 + random.normal(0, 0.002, (300, 400))
    behind = depth.copy()
    behind[:, 280:] += 8.0
    far = ~np.isnan(heights_of(depth)).all(axis=0)
    kept = ~np.isnan(heights_of(behind)).all(axis=0)
    assert kept.sum() < 0.8 * far.sum()
    crack = depth.copy()
    crack[:, 200:209] += 8.0
    assert (heights_of(crack) < -7).sum() > 100


def test_points_that_tell_nothing_cost_no_scan() -> None:
    depth = np.full((200, 200), 50.0)
    points = cloud(depth)
    points.sigma_z[40:60, 40:60] = 2.0  # mm, of a field of 5: far off, and it says so
    points.xyz[40:60, 40:60, 2] += 40.0
    rig = make_rig((200, 200))
    scan = to_scan(points, rig, Grid(300, 400, 0.05, -10.0, -7.5), NOON, remove_background=False)
    assert np.nanmin(scan.height) > -0.001
    assert np.nanmax(scan.sigma) < 0.01


def test_pixels_that_see_two_surfaces_are_told_from_edges() -> None:
    depth = np.full((120, 160), 50.0)
    depth[:, 80:] += 1.5
    sharp = cloud(depth)
    assert not reject_mixed(sharp).any()  # an edge is no mixture
    depth[:, 80] = 50.0 + np.random.default_rng(2).uniform(0.2, 1.3, 120)
    mixed = reject_mixed(cloud(depth))
    assert mixed[:, 80].mean() > 0.9
    mixed[:, 80] = False
    assert not mixed.any()
    sheet = np.full((120, 160), np.nan)
    sheet[60:62] = 50.0  # a leg two pixels thick
    assert not reject_mixed(cloud(sheet))[:, 2:-2].any()


def test_lone_points_are_removed() -> None:
    depth = np.full((200, 200), 50.0)
    random = np.random.default_rng(1)
    rows, columns = random.integers(5, 195, (2, 60))
    depth[rows, columns] -= 3.0
    height = heights_of(depth)
    assert (height > 1).sum() == 0


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 3.0), st.floats(-0.3, 0.3))
def test_round_trip_of_any_plane(offset: float, slope: float) -> None:
    rig = make_rig((64, 40))
    decoded, points = see(rig, lambda x, y: slope * x + offset - 1.5)
    found = triangulate(decoded, rig)
    assert np.abs(found.xyz - points)[found.valid].max() < 1e-3
