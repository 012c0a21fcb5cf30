"""Arrays to colours: what is significant, what is a hole, which way is up."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from dashboards.palette import BELOW_DETECTION, CHANGE_SCALE, NOT_MEASURED
from dashboards.raster import Range, block_mean, change_png, height_png, round_limit, shrink_factor
from dashboards.scales import Detail, Scales
from dashboards.surface import surface, triangles
from pipelines import Grid, Scan

from .drying import START, DryingStore


def pixels(png: bytes) -> np.ndarray:
    return np.array(Image.open(io.BytesIO(png)).convert("RGB"))


def test_change_map_colours_only_what_is_significant() -> None:
    dz = np.array([[0.5, -0.5], [0.01, np.nan]], dtype=np.float32)
    lod = np.array([[0.1, 0.1], [0.1, np.nan]], dtype=np.float32)
    picture = pixels(change_png(dz, lod, 0.5))
    below = np.abs(picture[0, 0].astype(int) - BELOW_DETECTION).max()  # row 0 of the grid is at the bottom
    assert below <= 2
    assert tuple(picture[0, 1]) == NOT_MEASURED
    assert tuple(picture[1, 0]) == CHANGE_SCALE[-1]
    assert tuple(picture[1, 1]) == CHANGE_SCALE[0]


def test_height_map_puts_the_largest_y_on_top() -> None:
    height = np.array([[0.0, 0.0], [1.0, 1.0]], dtype=np.float32)
    picture = pixels(height_png(height, Range(0, 1))).astype(int)
    assert picture[0].sum() > picture[1].sum()  # yellow above, dark below


def test_shrinking_averages_what_was_measured_and_keeps_holes() -> None:
    cells = np.full((5, 4), 2.0, dtype=np.float32)
    cells[0, 0] = np.nan
    cells[2:4, 2:] = np.nan
    small = block_mean(cells, 2)
    assert small.shape == (3, 2)
    assert small[0, 0] == 2
    assert np.isnan(small[1, 1])
    assert small[2, 0] == 2  # half of a block at the edge is enough
    assert shrink_factor(500, 500, 62_500) == 2


def test_a_scale_ends_at_a_round_number() -> None:
    assert [round_limit(value) for value in (0.031, 0.05, 0.72, 9.0, 0.0, float("nan"))] == [
        0.05,
        0.05,
        1.0,
        10.0,
        0.001,
        0.001,
    ]


def test_surface_of_a_tilted_plane_has_its_normal_everywhere_and_faces_up() -> None:
    grid = Grid(40, 60, 0.05, -1.0, 2.0)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    height = (0.3 * x - 0.2 * y).astype(np.float32)
    height[10:14, 20:26] = np.nan
    flat = np.zeros(grid.shape, dtype=np.uint8)
    scan = Scan(grid, START, height, np.where(np.isnan(height), np.nan, 0.01).astype(np.float32), flat, flat)
    for most in (10_000, 600):
        scales = Scales(grid, Range(-1, 1), 0.1, 0.01, 1.0, Detail(most, most))
        shape = surface(scan, None, scales)
        faces = triangles(grid, most)
        assert faces.max() == len(shape.positions) - 1
        known = np.isfinite(shape.positions[:, 2])
        expected = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
        np.testing.assert_allclose(
            shape.normals[known], np.broadcast_to(expected, shape.normals[known].shape), atol=2e-4
        )
        np.testing.assert_allclose(
            shape.positions[known, 2], 0.3 * shape.positions[known, 0] - 0.2 * shape.positions[known, 1], atol=1e-5
        )
        corners = shape.positions[faces[known[faces].all(axis=1)]]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (cross[:, 2] > 0).all()


def test_surface_of_a_real_scan_stays_within_its_vertices(drying: DryingStore) -> None:
    scales = Scales(drying[3].scan.grid, Range(-0.5, 0.2), 0.5, 0.01, 1.0, Detail(4000, 4000))
    shape = surface(drying[3].scan, drying[3].change, scales)
    assert len(shape.positions) <= 4000
    assert np.isfinite(shape.normals).all()
    holes = np.isnan(shape.positions[:, 2])
    for colours in (shape.by_height, shape.by_change):
        assert set(colours[holes].tolist()) == {int.from_bytes((*NOT_MEASURED, 255))}
