"""The frame that heights are told in, and a lens from the numbers of a bundle."""

from __future__ import annotations

import numpy as np

from .bundle import LENS
from .pinhole import Floats
from .rig_model import Lens

__all__ = ["lens_of", "site_frame"]


def lens_of(numbers: Floats, size: tuple[int, int], parallel: bool = False) -> Lens:
    """Make a lens of the eight numbers of `Solution`."""
    fx, fy, cx, cy, k1, k2, p1, p2 = (float(value) for value in numbers[:LENS])
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Lens(size, K, np.array([k1, k2, p1, p2, 0.0]), "affine" if parallel else "pinhole")


def site_frame(normal: Floats, point: Floats, mirrored: bool) -> Floats:
    """Camera frame to site frame (3, 4): z along the plane's normal towards the camera, x along the image's +x.

    The origin is where the camera's axis meets the plane through `point` with `normal` (camera frame, mm).
    """
    z = -normal if normal[2] > 0 else normal
    origin = np.array([0.0, 0.0, float(point @ z) / float(z[2])])
    along = np.array([-1.0 if mirrored else 1.0, 0.0, 0.0])
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    return np.concatenate([R, (-R @ origin)[:, None]], axis=1)
