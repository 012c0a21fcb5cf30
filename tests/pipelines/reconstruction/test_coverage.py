"""Cells are measured where pixels cover them: outlines, cracks and holes, at pitches finer and coarser than pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import Grid, PointMap, Scan, parse_instant
from pipelines.reconstruction import Calibration, Lens, footprint_grid, scan_decoded, to_scan, triangulate
from pipelines.reconstruction.clean import reject_mixed

from .exact_rig import make_rig, see

NOON = parse_instant("2026-11-22T12:00:00Z")
SPACING = 0.02  # mm between pixels on the plane z = 0
FAR = 50.0
PITCHES = (0.008, 0.016, 0.02, 0.027, 0.05, 0.2)
Floats = npt.NDArray[np.float64]


def camera_above(rows: int, columns: int) -> Calibration:
    """A camera that looks straight down on the middle of the field; the projector plays no part here."""
    K = np.array([[FAR / SPACING, 0, (columns - 1) / 2], [0, FAR / SPACING, (rows - 1) / 2], [0, 0, 1]])
    lens = Lens((columns, rows), K, np.zeros(5))
    reference = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, FAR]])
    return Calibration(lens, lens, np.eye(3), np.zeros(3), reference, {})


def mapped(height: Floats, pitch: float, sigma: float = 0.001) -> Scan:
    """Put heights per camera pixel, NaN where not measured, on a grid of that pitch."""
    rows, columns = height.shape
    rig = camera_above(rows, columns)
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) - (np.array([columns, rows]) - 1) / 2
    rays = np.concatenate([pixels * SPACING / FAR, np.ones((rows, columns, 1))], axis=-1)
    xyz = (rays * (FAR - height)[..., None]).astype(np.float32)
    spread = np.where(np.isfinite(height), sigma, np.nan).astype(np.float32)
    grey = np.zeros((rows, columns), np.uint8)
    points = PointMap(xyz, spread, np.zeros((rows, columns, 2), np.float32), grey, grey)
    high, wide = (int(np.ceil(side * SPACING / pitch)) + 1 for side in (rows, columns))
    grid = Grid(high, wide, pitch, (0.31 - wide / 2) * pitch, (0.47 - high / 2) * pitch)
    return to_scan(points, rig, grid, NOON)


def places(rows: int, columns: int) -> tuple[Floats, Floats]:
    """Place of each pixel on the plane, mm."""
    x, y = (SPACING * (np.arange(side) - (side - 1) / 2) for side in (columns, rows))
    return np.broadcast_to(x, (rows, columns)), np.broadcast_to(y[:, None], (rows, columns))


@settings(max_examples=25, deadline=None)
@given(st.floats(0.8, 1.6), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.sampled_from(PITCHES))
def test_the_area_of_a_disc_is_its_area_whatever_the_pitch(radius: float, x0: float, y0: float, pitch: float) -> None:
    x, y = places(200, 240)
    scan = mapped(np.where(np.hypot(x - x0, y - y0) < radius, 0.0, np.nan), pitch)
    area = np.isfinite(scan.height).sum() * pitch**2
    # an outline of n cells, each right or wrong by chance
    chance = 3 * pitch**2 * np.sqrt(2 * np.pi * radius / pitch) * 0.5
    assert area == pytest.approx(np.pi * radius**2, abs=chance + 0.005 * np.pi * radius**2)


@pytest.mark.parametrize("pitch", PITCHES)
def test_a_surface_without_holes_has_none_on_the_grid(pitch: float) -> None:
    x, y = places(150, 200)
    rise = 0.3 * x - 0.2 * y  # y down the image
    scan = mapped(rise / (1 + rise / FAR), pitch)  # where the pixels' rays meet the plane
    X, Y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    inside = (np.abs(X) < 1.8) & (np.abs(Y) < 1.3)
    assert np.isfinite(scan.height[inside]).all()
    error = np.abs(scan.height - (0.3 * X + 0.2 * Y))[inside]
    assert np.percentile(error, 99.9) < 0.03 * pitch + 2e-5
    assert error.max() < 0.15 * pitch  # where no two measured neighbours lie opposite
    assert (scan.level[inside] == 0).all()
    assert (scan.sigma[inside] > 0).all()


@pytest.mark.parametrize("pitch", [0.008, 0.016, 0.02])
@pytest.mark.parametrize("width", [2, 3, 5, 10, 20])
def test_cracks_keep_their_floor_and_their_width(width: int, pitch: float) -> None:
    height = np.zeros((160, 200))
    height[:, 110 : 110 + width] = -0.4
    scan = mapped(height, pitch)
    inner = slice(len(scan.height) // 8, -len(scan.height) // 8)
    heights = scan.height[inner]
    off = np.min(np.abs(heights[np.isfinite(heights)][:, None] - np.array([0.0, -0.4])), axis=1)
    assert off.max() < 1e-3  # a wall is a wall
    floor = (heights < -0.2).sum(axis=1) * pitch
    assert floor.mean() == pytest.approx(width * SPACING * 1.008, abs=0.6 * SPACING)  # the floor is 0.8 % farther away
    assert floor.max() - floor.min() < 2.1 * pitch


@pytest.mark.parametrize("pitch", [0.016, 0.02, 0.04])
@pytest.mark.parametrize("width", [3, 6, 20])
def test_cracks_without_a_floor_stay_open(width: int, pitch: float) -> None:
    height = np.zeros((160, 200))
    height[:, 110 : 110 + width] = np.nan
    scan = mapped(height, pitch)
    inner = slice(len(scan.height) // 8, -len(scan.height) // 8)
    X = scan.grid.x_mm
    open_mm = np.isnan(scan.height[inner][:, (X > -1) & (X < 1.5)]).sum(axis=1) * pitch
    assert open_mm.mean() == pytest.approx(width * SPACING, abs=pitch)
    assert open_mm.min() > 0


def test_a_dark_line_one_pixel_wide_is_no_hole_but_a_dark_pixel_is() -> None:
    height = np.zeros((120, 160))
    height[:, 100] = np.nan
    height[40, 30] = np.nan
    scan = mapped(height, SPACING)
    X, Y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    x, y = places(120, 160)
    line = (np.abs(X - x[0, 100]) < 0.5 * SPACING) & (np.abs(Y) < 0.8)
    hole = np.hypot(X - x[40, 30], Y + y[40, 30]) < 2 * SPACING
    assert np.isnan(scan.height[line]).all()
    assert np.isfinite(scan.height[hole]).all()


def test_half_of_the_pixels_are_enough_for_cells_of_many() -> None:
    random = np.random.default_rng(3)
    height = np.where(random.random((200, 240)) < 0.55, 0.0, np.nan)
    scan = mapped(height, 0.2)
    X, Y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    assert np.isfinite(scan.height[(np.abs(X) < 2) & (np.abs(Y) < 1.6)]).all()


@pytest.mark.parametrize("steep", [1.0, 2.0, 2.8])
def test_walls_that_the_camera_sees_are_measured(steep: float) -> None:
    x, _ = places(160, 200)
    wall = np.clip(steep * x, -0.3, 0.3)
    scan = mapped(wall, SPACING)
    X, Y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    near = (np.abs(X) < 0.28 / steep) & (np.abs(Y) < 1.2)
    assert np.isfinite(scan.height[near]).mean() > 0.99
    off = (scan.height - steep * X)[near & np.isfinite(scan.height)]
    assert np.abs(off).max() < 0.25 * steep * SPACING


def test_sigma_of_a_cell_that_is_seen_in_part_says_so() -> None:
    random = np.random.default_rng(5)
    x, y = places(200, 240)
    relief = 0.02 * np.sin(21 * x + 3) * np.cos(17 * y)
    seen = np.where(x + 0.3 * y > 0, relief + 0.001 * random.standard_normal(x.shape), np.nan)
    scan, whole = mapped(seen, 0.1), mapped(relief, 0.1, 1e-6)
    both = np.isfinite(scan.height) & np.isfinite(whole.height)
    X, Y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    border = both & (X - 0.3 * Y < 0.05)
    within = both & (X - 0.3 * Y > 0.2)
    off = scan.height - whole.height
    assert np.median(scan.sigma[border]) > 2 * np.median(scan.sigma[within])
    assert 0.5 < np.sqrt(np.mean((off / scan.sigma)[border] ** 2)) < 1.5


@pytest.mark.parametrize("pitch", [None, 0.05])
def test_in_bands_or_by_a_map_of_all_points_the_scan_is_the_same(pitch: float | None) -> None:
    rig = make_rig((320, 200))
    decoded, _ = see(rig, lambda x, y: 0.3 * np.sin(2 * x) + np.where(np.abs(y - 0.2 * x) < 0.1, -0.5, 0.0))
    random = np.random.default_rng(8)
    lost, off = random.random(decoded.column.shape) < 0.05, random.random(decoded.column.shape) < 0.02
    column = np.where(lost, np.nan, decoded.column + np.where(off, 3, 0)).astype(np.float32)
    row = np.where(random.random(lost.shape) < 0.05, np.nan, decoded.row).astype(np.float32)
    decoded = replace(decoded, column=column, row=row)
    points = triangulate(decoded, rig)
    mixed = reject_mixed(points)
    xyz, sigma = np.where(mixed[..., None], np.nan, points.xyz), np.where(mixed, np.nan, points.sigma_z)
    points = replace(points, xyz=xyz.astype(np.float32), sigma_z=sigma.astype(np.float32))
    grid = footprint_grid(rig, pitch)
    banded, whole = scan_decoded(decoded, rig, grid, NOON), to_scan(points, rig, grid, NOON)
    assert np.isfinite(whole.height).mean() > 0.5
    for name in ("height", "sigma", "texture", "level"):
        assert np.array_equal(getattr(banded, name), getattr(whole, name), equal_nan=name in ("height", "sigma"))
