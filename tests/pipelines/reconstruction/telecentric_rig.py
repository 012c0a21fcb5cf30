"""Rigs in closed form whose lenses are affine, or pinholes as far away as one likes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipelines.reconstruction import Board, Calibration, Decoded, Lens
from pipelines.reconstruction.board_check import corner_points
from pipelines.reconstruction.pinhole import Floats, project, rotation
from pipelines.reconstruction.sight import sight
from pipelines.reconstruction.stereo_start import PoseCorners

BOARD = Board((9, 6), 1.0)
FIELD_MM = 10.0
SIZES = ((480, 300), (608, 684))
TILTS = ((0.0, 0.0), (0.35, 0.1), (-0.3, 0.25), (0.1, -0.4), (-0.2, -0.2), (0.25, -0.2))
FAR = np.inf


def device(size: tuple[int, int], field_mm: float, fields: float, shape: float) -> tuple[Lens, float]:
    """A lens that sees `field_mm` in its width from `fields` widths away, or from infinity; and its distance."""
    scale = size[0] / field_mm
    if np.isinf(fields):
        K = np.array([[scale, 0, size[0] / 2 - 0.5], [0, shape * scale, size[1] / 2 - 0.5], [0, 0, 1]])
        return Lens(size, K, np.array([2e-4, 0, 0, 0, 0]), "affine"), 0.0
    far = fields * field_mm
    K = np.array([[scale * far, 0, size[0] / 2 + 2.5], [0, shape * scale * far, size[1] / 2 - 0.5], [0, 0, 1]])
    return Lens(size, K, np.array([2e-4 * far**2, 0, 0, 0, 0])), far


def make_rig(camera: float = FAR, projector: float = FAR, side: int = 1) -> Calibration:
    """Camera and projector 31 degrees apart, at these distances in widths of the field; side -1: on the left."""
    seen, near = device(SIZES[0], FIELD_MM, camera, 1.0)
    lit, far = device(SIZES[1], 1.1 * FIELD_MM, projector, 2.0)
    R = rotation(np.array([0.03, side * np.radians(31), 0.02]))
    shift = np.array([0.05, -0.1, far]) - R @ np.array([0.1, -0.05, near])
    site = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, near]])
    return Calibration(seen, lit, R, shift, site, {})


def corners_of(
    rig: Calibration,
    noise_px: float,
    seed: int,
    tilts: tuple[tuple[float, float], ...] = TILTS,
    board: Board = BOARD,
) -> list[PoseCorners]:
    """Corners of the tilted boards, as both devices see them; the first board lies in the plane z = 0 of the site."""
    random = np.random.default_rng(seed)
    flat = board.points_mm - board.points_mm.mean(axis=0)
    poses = []
    for n, (a, b) in enumerate(tilts):
        points = np.c_[flat, np.zeros(len(flat))] @ rotation(np.array([a, b, 0.1 * n])).T
        points += np.array([0.1 * n - 0.2, 0.1, rig.reference[2, 3] + 0.1 * n])
        seen, lit = project(rig.camera, points), project(rig.projector, points @ rig.R.T + rig.t_mm)
        seen, lit = (px + random.normal(0, noise_px, px.shape) for px in (seen, lit))
        poses.append(PoseCorners(f"pose {n}", board.points_mm, seen, lit))
    return poses


def seen_by(true: Calibration, found: Calibration, site: Floats) -> Floats:
    """Where a calibration puts points (n, 3) of the true site frame, in its own site frame."""
    points = (site - true.reference[:, 3]) @ true.reference[:, :3]
    seen, lit = project(true.camera, points), project(true.projector, points @ true.R.T + true.t_mm)
    return corner_points(found, seen, lit) @ found.reference[:, :3].T + found.reference[:, 3]


def see(rig: Calibration, height: Callable[[Floats, Floats], Floats], sigma_px: float) -> tuple[Decoded, Floats]:
    """What both devices see of a surface z = height(x, y) of the site frame, and the true points, camera frame."""
    columns, rows = rig.camera.size
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    start, ray = sight(rig.camera, pixels)
    M, origin = rig.reference[:, :3], rig.reference[:, 3]
    low, high = np.full((2, rows, columns), origin[2]) + np.array([-5.0, 5.0])[:, None, None]
    for _ in range(50):  # bisection: above the surface before the ray meets it
        depth = (low + high) / 2
        site = (start + ray * depth[..., None]) @ M.T + origin
        above = site[..., 2] > height(site[..., 0], site[..., 1])
        low, high = np.where(above, depth, low), np.where(above, high, depth)
    points = start + ray * depth[..., None]
    where = project(rig.projector, points @ rig.R.T + rig.t_mm)
    where += np.random.default_rng(3).normal(0, sigma_px, where.shape)
    outside = ((where < 0) | (where > np.array(rig.projector.size) - 1)).any(axis=-1)
    where[outside] = np.nan
    sigma = np.where(outside, np.nan, sigma_px).astype(np.float32)
    full = np.full((rows, columns), 200, np.uint8)
    column, row = np.moveaxis(where.astype(np.float32), -1, 0)
    return Decoded(column, row, sigma, sigma.copy(), np.where(outside, 255, 0).astype(np.uint8), full, full), points
