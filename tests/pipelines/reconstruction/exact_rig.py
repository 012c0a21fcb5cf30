"""A rig in closed form: lenses, boards and surfaces whose projections are exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines.reconstruction import Board, Calibration, Decoded, Lens
from pipelines.reconstruction.pinhole import project, rotation, undistort
from pipelines.reconstruction.stereo_start import PoseCorners

Floats = npt.NDArray[np.float64]

BOARD = Board((9, 7), 0.9)
TILTS = ((0.0, 0.0), (0.35, 0.1), (-0.3, 0.25), (0.1, -0.4), (-0.2, -0.2))


def make_rig(camera_size: tuple[int, int] = (640, 400)) -> Calibration:
    """A microscope's long lenses 31 degrees apart; the projector's pixels are twice as wide as high."""
    columns, rows = camera_size
    f = 3.2 * columns
    camera = Lens(
        camera_size,
        np.array([[f, 0, columns / 2 + 3.3], [0, f * 1.0004, rows / 2 - 2.1], [0, 0, 1]]),
        np.array([-0.12, 0.2, 3e-4, -2e-4, 0]),
    )
    projector = Lens(
        (608, 684),
        np.array([[3040.0, 0, 301.2], [0, 6080, 380.5], [0, 0, 1]]),
        np.array([0.2, 0, -1e-4, 1e-4, 0]),
    )
    R = rotation(np.array([0.03, 0.541, 0.02]))
    target = np.array([0.1, -0.05, 50.0])  # both look at it, the projector from 90 mm
    return Calibration(
        camera=camera,
        projector=projector,
        R=R,
        t_mm=np.array([0.05, -0.1, 90.0]) - R @ target,
        reference=np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 50]]),
        rms_px={"camera": 0.0, "projector": 0.0, "stereo": 0.0},
    )


def board_corners(rig: Calibration, noise_px: float = 0.0, board: Board = BOARD) -> list[PoseCorners]:
    """Corners of the tilted boards, as both devices see them."""
    random = np.random.default_rng(7)
    poses = []
    flat = board.points_mm - board.points_mm.mean(axis=0)
    for n, (a, b) in enumerate(TILTS):
        R = rotation(np.array([a, b, 0.1 * n]))
        points = np.c_[flat, np.zeros(len(flat))] @ R.T + np.array([0.1 * n - 0.2, 0.1, 50.0 + 0.3 * (n - 2)])
        seen, lit = project(rig.camera, points), project(rig.projector, points @ rig.R.T + rig.t_mm)
        seen = seen + random.normal(0, 1, seen.shape) * noise_px
        lit = lit + random.normal(0, 1, lit.shape) * noise_px
        poses.append(PoseCorners(f"pose {n}", board.points_mm, seen, lit))
    return poses


def see(rig: Calibration, height: Callable[[Floats, Floats], Floats], sigma_px: float = 0.05) -> tuple[Decoded, Floats]:
    """What both devices see of a surface z = height(x, y) in the site frame: decoded exactly, and the true points."""
    columns, rows = rig.camera.size
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    rays = np.concatenate([undistort(rig.camera, pixels), np.ones((rows, columns, 1))], axis=-1)
    M, origin = rig.reference[:, :3], rig.reference[:, 3]
    turned = rays @ M.T
    depth = np.full((rows, columns), 50.0)
    low, high = depth - 5, depth + 5
    for _ in range(60):  # bisection: the surface is below the ray before it is hit, above it after
        site = turned * depth[..., None] + origin
        above = site[..., 2] > height(site[..., 0], site[..., 1])
        low, high = np.where(above, depth, low), np.where(above, high, depth)
        depth = (low + high) / 2
    points = rays * depth[..., None]
    where = project(rig.projector, points @ rig.R.T + rig.t_mm)
    wide, tall = rig.projector.size
    outside = (where[..., 0] < 0) | (where[..., 0] > wide - 1) | (where[..., 1] < 0) | (where[..., 1] > tall - 1)
    where[outside] = np.nan
    sigma = np.where(outside, np.nan, sigma_px).astype(np.float32)
    full = np.full((rows, columns), 200, np.uint8)
    decoded = Decoded(
        where[..., 0].astype(np.float32),
        where[..., 1].astype(np.float32),
        sigma,
        sigma.copy(),
        np.where(outside, 255, 0).astype(np.uint8),
        full,
        full,
    )
    return decoded, points


def turned(decoded: Decoded, how: tuple[slice, slice]) -> Decoded:
    """The same capture by a camera whose images are turned or mirrored."""

    def other(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.ascontiguousarray(image[how])

    return replace(
        decoded,
        column=other(decoded.column),
        row=other(decoded.row),
        sigma_column=other(decoded.sigma_column),
        sigma_row=other(decoded.sigma_row),
        level=other(decoded.level),
        texture=other(decoded.texture),
        contrast=other(decoded.contrast),
    )


def flat_site(x: Floats, y: Floats) -> Floats:
    """The plane that heights count from."""
    return np.zeros_like(x + y)
