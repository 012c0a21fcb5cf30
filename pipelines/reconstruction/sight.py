"""Lines of sight: from pixels to rays and points, whether a lens is a pinhole or affine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .pinhole import Floats, undistort

if TYPE_CHECKING:
    from .rig_model import Calibration, Lens

__all__ = ["in_front", "on_plane", "projector_rows", "sight"]


def sight(lens: Lens, pixels: Floats) -> tuple[Floats, Floats]:
    """Start and direction (..., 3) of the rays of pixels (..., 2): at ``start + z direction`` the depth is z.

    All rays of a pinhole start at 0; those of an affine lens are parallel, and start beside each other.
    """
    flat = undistort(lens, pixels)
    one = np.ones((*flat.shape[:-1], 1))
    ray = np.concatenate([flat, one], axis=-1)
    if lens.parallel:
        return ray * np.array([1.0, 1.0, 0.0]), np.concatenate([np.zeros_like(flat), one], axis=-1)
    return np.zeros_like(ray), ray


def on_plane(lens: Lens, frame: Floats, pixels: Floats, height: float = 0.0) -> Floats:
    """Points (..., 3), of the lens's own frame, where the rays of pixels meet the plane at this height.

    `frame` (3, 4) leads from the lens's frame to the one that heights are told in.
    """
    start, ray = sight(lens, pixels)
    up = frame[2, :3]
    points: Floats = start + ray * ((height - frame[2, 3] - start @ up) / (ray @ up))[..., None]
    return points


def in_front(lens: Lens, points: Floats) -> npt.NDArray[np.bool_]:
    """Whether points (..., 3) of the lens's frame lie before it; an affine lens has no place, and so no behind."""
    result: npt.NDArray[np.bool_] = np.ones(points.shape[:-1], dtype=bool) if lens.parallel else points[..., 2] > 0
    return result


def projector_rows(rig: Calibration) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) from the camera to the projector, homogeneous: its x and y are to be divided by its z.

    An affine lens divides by nothing: its third row is 0 0 0 1.
    """
    if not rig.projector.parallel:
        return rig.R, rig.t_mm
    return rig.R * np.array([[1.0], [1.0], [0.0]]), np.array([rig.t_mm[0], rig.t_mm[1], 1.0])
