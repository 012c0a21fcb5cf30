"""What lines share of their errors: as it was put in, as it goes down in a cell, and against a plane in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import gaussian_filter1d

from pipelines import Calibration, Frames, Instant, PatternSet, Scan, Shared
from pipelines.reconstruction import footprint_grid, reconstruct, to_scan, triangulate
from pipelines.reconstruction.pinhole import project, undistort
from pipelines.reconstruction.shared_error import left_by_mean
from pipelines.reconstruction.subpixel import _shared_by_lines

from .exact_rig import Floats, flat_site, make_rig, see

NOON = Instant("2026-01-01T12:00:00", "ns")
Map = npt.NDArray[np.float32]
PARTS = 3  # of a camera pixel, along both sides: a pixel adds up what falls on it
DRAWN = 16  # samples of a blurred stripe per projector px
BLUR_PX = 0.4
SLOPE = np.array([0.04, -0.03])


def sees(rig: Calibration) -> Floats:
    """Columns and rows of the projector that parts of the camera's pixels see of a tilted plane; (2, row, column)."""
    columns, rows = rig.camera.size
    u, v = ((np.arange(size * PARTS) + 0.5) / PARTS - 0.5 for size in (columns, rows))
    flat = undistort(rig.camera, np.stack(np.meshgrid(u, v), axis=-1))
    rays = np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=-1)
    M, origin = rig.reference[:, :3], rig.reference[:, 3]
    upright = M[2] - SLOPE @ M[:2]  # along it the plane's height does not change
    depth = (SLOPE @ origin[:2] - origin[2]) / (rays @ upright)
    return np.moveaxis(project(rig.projector, rays * depth[..., None] @ rig.R.T + rig.t_mm), -1, 0)


def shoot(rig: Calibration, noise: float, seed: int) -> Frames:
    """Blurred stripes that fall on square pixels, with noise."""
    patterns, places = PatternSet("gray", rig.projector.size), sees(rig)
    columns, rows = rig.camera.size
    random = np.random.default_rng(seed)
    stack = np.empty((len(patterns.roles), rows, columns), np.uint8)
    for frame, image, role in zip(stack, patterns.images(), patterns.roles, strict=True):
        line, at = (image[:, 0], places[1]) if role.axis == "rows" else (image[0], places[0])
        fine = gaussian_filter1d(np.repeat(line / 255.0, DRAWN), BLUR_PX * DRAWN, mode="nearest")
        light = np.interp((at + 0.5) * DRAWN - 0.5, np.arange(fine.size), fine)
        seen = light.reshape(rows, PARTS, columns, PARTS).mean(axis=(1, 3))
        frame[:] = np.rint(20 + 160 * seen + noise * random.standard_normal(seen.shape))
    return Frames(stack, NOON, patterns)


def ratio(scan: Scan) -> float:
    """Error over sigma, robust."""
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    over: npt.NDArray[np.float64] = ((scan.height - SLOPE[0] * x - SLOPE[1] * y) / scan.sigma)[np.isfinite(scan.height)]
    return float(1.4826 * np.median(np.abs(over - np.median(over))))


def test_sharp_square_pixels_as_wide_as_stripes_are_not_blamed_for_what_they_do_not_do() -> None:
    """What the profile of an edge leaves open is shared by lines, but only as far as the capture shows it."""
    rig = make_rig((480, 160))
    points = reconstruct(shoot(rig, 1.5, 3), rig)
    side = 50 / 3.2 / 480
    found = [ratio(to_scan(points, rig, footprint_grid(rig, many * side), NOON)) for many in (1, 4, 8)]
    print(f"square pixels: error over sigma in cells of 1, 4 and 8 pixels {np.round(found, 2)}")
    assert min(found) > 0.6
    assert max(found) < 1.2


def positions(cell_px: float, wave: float, noise: float) -> tuple[Map, Map]:
    """Positions of 120 lines between edges that are off by a wave of their phase and by noise, and their variances."""
    u, random = np.arange(900), np.random.default_rng(5)
    number = np.arange(-3, int(900 / cell_px) + 4)
    found = np.empty((120, 900), np.float32)
    for line, out in enumerate(found):
        at = (number - 0.002 * line) * cell_px
        off = wave * np.sqrt(2) * np.sin(2 * np.pi * at) + noise * random.standard_normal(at.size)
        out[:] = np.interp(u, at + cell_px * off, number)
    return found, np.full(found.shape, 2 / 3 * noise**2, np.float32)


@pytest.mark.parametrize("cell_px", [1.06, 1.12, 1.3, 2.1])
@pytest.mark.parametrize("down", [False, True])
def test_an_error_of_all_lines_is_found_whether_its_phase_goes_on_quickly_or_not(cell_px: float, down: bool) -> None:
    for wave in (0.0, 0.02):
        found, variance = (np.ascontiguousarray(each.T if down else each) for each in positions(cell_px, wave, 0.01))
        unseen, shared = _shared_by_lines(found, variance, down, round(cell_px))
        assert 0 <= unseen <= shared.within + shared.beside
        # at least two thirds of the variance are left between edges; a median takes a sine for 1.48 times what it is
        assert 0.8 * wave <= np.sqrt(shared.within + shared.beside) < 1.5 * wave + 0.004


def raster(growth: float, shift: float) -> tuple[Map, Map, Map]:
    """Samples of positions that grow and shift evenly."""
    here = np.zeros((5, 5), np.float32)
    return here, here + np.float32(growth), here + np.float32(shift)


def test_a_mean_over_a_cell_leaves_what_repeats_in_all_its_pixels() -> None:
    assert left_by_mean(8, 1.5, *raster(1, 0)) == pytest.approx(1)  # each edge lies as the last
    assert left_by_mean(1, 1.5, *raster(0.7, 0.1)) == pytest.approx(1)
    alone = 1 / (1 + 7 / 1.5)
    assert left_by_mean(8, 1.5, *raster(1 / 1.5, 0)) == pytest.approx(alone, rel=0.05)  # phases go on, lines share
    assert left_by_mean(8, 1.5, *raster(1 / 1.5, 0.5 / 1.5)) == pytest.approx(alone**2, rel=0.1)  # nor do lines
    assert left_by_mean(8, 1.5, *raster(0.1, 1)) == pytest.approx(left_by_mean(8, 1.5, *raster(1, 0.1)))


def test_variance_on_the_projector_is_carried_to_distances_by_the_axis_with_the_parallax() -> None:
    rig = make_rig((160, 100))
    decoded, _ = see(rig, flat_site, sigma_px=0.05)
    points = triangulate(replace(decoded, shared=(Shared(0.05**2, 0.1**2), Shared(1.0, 1.0))), rig)
    middle = points.sigma_z[50, 80]
    assert np.sqrt(points.shared.within) == pytest.approx(middle, rel=0.01)
    assert np.sqrt(points.shared.beside) == pytest.approx(2 * middle, rel=0.01)
