"""Optics: the two lenses of the simulated rig, where they stand, and how far from focus they blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines import Lens

__all__ = ["Device", "Optics", "paper_optics", "small_motion"]

Matrix = npt.NDArray[np.float64]

VIEW_MM = 11.2
"""Height of the camera's view on the plane z = 0: the paper's 10 mm and some of what holds the sample."""

DISTANCE_MM = 90.0
ANGLE_DEG = 31.0
WORKING_NA = 0.006
"""Working aperture of both: 3 mm out of focus blur to a disc of 36 um, the paper's +-3 mm of depth of field."""


@dataclass(frozen=True, slots=True, eq=False)
class Device:
    """A lens somewhere: ``x_device = R x_scene + t_mm``; sharp at `focus_mm` along its axis."""

    lens: Lens
    R: Matrix
    t_mm: Matrix
    focus_mm: float
    aperture: float

    @property
    def centre_mm(self) -> Matrix:
        """Centre of projection, scene frame."""
        centre: Matrix = -self.R.T @ self.t_mm
        return centre

    def moved(self, motion: Matrix) -> Device:
        """The same device seen from a scene that was moved by `motion` (3x4: x_world = motion x_scene)."""
        return Device(
            self.lens, self.R @ motion[:, :3], self.R @ motion[:, 3] + self.t_mm, self.focus_mm, self.aperture
        )

    def rays(self) -> npt.NDArray[np.float32]:
        """Undistorted directions (x/z, y/z) per pixel, shape (row, column, 2), device frame."""
        columns, rows = self.lens.size
        x_d = (np.arange(columns) - self.lens.K[0, 2]) / self.lens.K[0, 0]
        y_d = (np.arange(rows) - self.lens.K[1, 2]) / self.lens.K[1, 1]
        x_d, y_d = np.broadcast_arrays(x_d[None, :], y_d[:, None])
        k1, k2, p1, p2, k3 = self.lens.dist
        x, y = x_d.copy(), y_d.copy()
        for _ in range(12):  # Brown's model has no closed inverse; the distortion is slight, so this converges fast
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            x = (x_d - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial
            y = (y_d - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial
        return np.stack([x, y], axis=-1).astype(np.float32)

    def on_plane(self) -> Matrix:
        """Where the pixels' rays meet z = 0, shape (row, column, 2), mm."""
        rays = self.rays().astype(np.float64)
        directions = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ self.R
        centre = self.centre_mm
        met: Matrix = centre[:2] - directions[..., :2] * (centre[2] / directions[..., 2:])
        return met


@dataclass(frozen=True, slots=True, eq=False)
class Optics:
    """Camera and projector."""

    camera: Device
    projector: Device


def paper_optics(camera_size: tuple[int, int] = (960, 720)) -> Optics:
    """Build the paper's rig: a camera from above, a 608x684 projector 31 degrees beside it.

    The camera's image is rotated by 180 degrees against the scene, as a microscope's is. Mirrors of the projector are
    twice as wide as high. Both are a little askew and off centre, as built things are.

    Parameters
    ----------
    camera_size : (int, int)
        Columns, rows; the view is `VIEW_MM` high whatever the rows.
    """
    focal = DISTANCE_MM / VIEW_MM * camera_size[1]
    camera = Device(
        _lens(camera_size, focal, focal * 1.0004, (0.006, -0.009), (0.35, -1.2, 4e-4, -3e-4, 0.0)),
        _turn(0.10, -0.15, 0.3) @ np.diag([-1.0, 1.0, -1.0]),
        np.array([0.06, -0.04, DISTANCE_MM]),
        DISTANCE_MM,
        WORKING_NA,
    )
    angle = np.deg2rad(ANGLE_DEG)
    aim = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, -1, 0], [-np.sin(angle), 0, -np.cos(angle)]])
    width_mm = VIEW_MM * 4 / 3 * np.cos(angle) * 1.06
    projector = Device(
        _lens(
            (608, 684),
            608 * DISTANCE_MM / width_mm,
            684 * DISTANCE_MM / (VIEW_MM * 1.10),
            (-0.004, 0.007),
            (-0.30, 0.8, -3e-4, 2e-4, 0.0),
        ),
        _turn(-0.2, 0.1, 0.4) @ aim,
        np.array([-0.08, 0.05, DISTANCE_MM]),
        DISTANCE_MM,
        WORKING_NA,
    )
    return Optics(camera, projector)


def small_motion(tilt_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> Matrix:
    """A rigid motion as 3x4: turns about x, y, z in this order, then a shift."""
    return np.column_stack([_turn(*tilt_deg), np.asarray(shift_mm, np.float64)])


def _lens(
    size: tuple[int, int],
    fx: float,
    fy: float,
    off_centre: tuple[float, float],
    dist: tuple[float, float, float, float, float],
) -> Lens:
    cx, cy = ((n - 1) / 2 + share * n for n, share in zip(size, off_centre, strict=True))
    return Lens(size, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.array(dist))


def _turn(x_deg: float, y_deg: float, z_deg: float) -> Matrix:
    a, b, c = np.deg2rad([x_deg, y_deg, z_deg])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    turn: Matrix = rz @ ry @ rx
    return turn
