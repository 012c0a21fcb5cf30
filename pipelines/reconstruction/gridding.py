"""Where the cells of a height map lie: the grid that both devices see, and how large a pixel is on it."""

from __future__ import annotations

import math

import numpy as np

from ..grid import Grid
from .pinhole import Floats, project
from .rig_model import Calibration
from .sight import in_front, on_plane

__all__ = ["field_mm", "footprint_grid", "on_reference", "pixel_mm"]


def footprint_grid(calibration: Calibration, pitch_mm: float | None = None) -> Grid:
    """Give the grid that covers what both camera and projector see of the reference plane.

    Parameters
    ----------
    calibration : Calibration
    pitch_mm : float, optional
        Side of a cell; by default the median camera pixel on the reference plane, rounded to 1-2-5.

    Returns
    -------
    Grid
        Cell edges at multiples of the pitch.

    Raises
    ------
    ValueError
        If the two fields of view do not overlap on the reference plane.
    """
    columns, rows = calibration.camera.size
    u, v = np.linspace(0, columns - 1, 97), np.linspace(0, rows - 1, 97)
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    points = on_reference(calibration, pixels)
    aside = on_reference(calibration, pixels + np.array([1.0, 0.0]))
    below = on_reference(calibration, pixels + np.array([0.0, 1.0]))
    pixel_mm2 = np.linalg.norm(np.cross(aside - points, below - points), axis=-1)
    lit = points @ calibration.R.T + calibration.t_mm
    where = project(calibration.projector, lit)
    wide, high = calibration.projector.size
    inside = in_front(calibration.projector, lit) & in_front(calibration.camera, points)
    inside &= (where[..., 0] >= -0.5) & (where[..., 0] <= wide - 0.5)
    inside &= (where[..., 1] >= -0.5) & (where[..., 1] <= high - 0.5)
    if not inside.any():
        raise ValueError(
            "camera and projector see no common part of the reference plane: choose another reference pose"
        )
    pitch = round_125(float(np.sqrt(np.median(pixel_mm2[inside])))) if pitch_mm is None else pitch_mm
    site = points[inside] @ calibration.reference[:, :3].T + calibration.reference[:, 3]
    half_step = 0.5 * np.sqrt(np.median(pixel_mm2[inside])) * max(columns, rows) / 96  # the samples are this coarse
    low = np.floor((site[:, :2].min(axis=0) - half_step) / pitch)
    high_ = np.ceil((site[:, :2].max(axis=0) + half_step) / pitch)
    count = np.maximum(high_ - low, 1).astype(int)
    return Grid(
        rows=int(count[1]),
        columns=int(count[0]),
        pitch_mm=pitch,
        x0_mm=float((low[0] + 0.5) * pitch),
        y0_mm=float((low[1] + 0.5) * pitch),
    )


def round_125(value: float) -> float:
    """Round to 1, 2 or 5 times a power of ten, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    choice = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / (step * power))))
    return float(f"{choice * power:.12g}")


def field_mm(calibration: Calibration) -> float:
    """Shorter side of what the camera sees of the reference plane."""
    columns, rows = calibration.camera.size
    edges = np.array([[0, rows / 2], [columns, rows / 2], [columns / 2, 0], [columns / 2, rows]])
    left, right, top, bottom = on_plane(calibration.camera, calibration.reference, edges)
    return float(min(np.linalg.norm(right - left), np.linalg.norm(bottom - top)))


def pixel_mm(calibration: Calibration) -> tuple[float, float]:
    """Sides along x and y of what a pixel in the middle of the image sees of the reference plane, as a rectangle."""
    middle = np.array(calibration.camera.size) / 2
    here, aside, below = on_reference(calibration, middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    a, b = (calibration.reference[:2, :3] @ (other - here) for other in (aside, below))
    area = abs(a[0] * b[1] - a[1] * b[0])
    return float(abs(a[0])), float(area / abs(a[0]))


def on_reference(calibration: Calibration, pixels: Floats) -> Floats:
    """Points of the reference plane (camera frame, mm) that camera pixels see."""
    return on_plane(calibration.camera, calibration.reference, pixels)
