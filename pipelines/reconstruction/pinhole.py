"""The camera model in numpy: Rodrigues' rotation, Brown's distortion, homographies of a plane.

Every function that a bundle adjustment differentiates is analytic, so that a complex step gives exact derivatives.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .rig_model import Lens

__all__ = [
    "distort",
    "finite",
    "fit_homography",
    "map_homography",
    "plane_pose",
    "project",
    "rotation",
    "rotation_vector",
    "undistort",
]

Array = npt.NDArray[Any]  # float64, or complex128 where a complex step runs through
Floats = npt.NDArray[np.float64]


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.sqrt((vector * vector).sum(-1) + 1e-30)  # never abs(): it is not analytic
    a = np.sin(angle) / angle
    half = np.sin(angle / 2) / angle
    b = 2 * half * half
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)
    result: Array = np.eye(3) + a[..., None, None] * cross + b[..., None, None] * (cross @ cross)
    return result


def rotation_vector(R: Floats) -> Floats:
    """Rotation vector (3,) of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    vector: Floats = Rotation.from_matrix(R).as_rotvec()
    return vector


def distort(x: Array, y: Array, dist: Array) -> tuple[Array, Array]:
    """Apply Brown's distortion (k1 k2 p1 p2 k3, OpenCV's convention) to normalised coordinates."""
    k1, k2, p1, p2, k3 = dist
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy2 = 2 * x * y
    return x * radial + p1 * xy2 + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + p2 * xy2


def project(lens: Lens, points: Floats) -> Floats:
    """Project points (..., 3) of the device's frame to pixels (..., 2)."""
    z = np.ones_like(points[..., 2]) if lens.parallel else points[..., 2]
    x, y = distort(points[..., 0] / z, points[..., 1] / z, lens.dist)
    K = lens.K
    return np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], axis=-1)


def undistort(lens: Lens, pixels: Floats, rounds: int = 20) -> Floats:
    """Undistorted coordinates (..., 2) of pixels (..., 2), by Newton's method on `distort`: x/z and y/z, or mm.

    They are those of the ray in the plane z = 1: mm for an affine lens, whose rays all run along z.
    """
    K = lens.K
    yd = (pixels[..., 1] - K[1, 2]) / K[1, 1]
    xd = (pixels[..., 0] - K[0, 2] - K[0, 1] * yd) / K[0, 0]
    x, y = xd.copy(), yd.copy()
    k1, k2, p1, p2, k3 = lens.dist
    for _ in range(rounds):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2))  # d(radial)/d(r2) times 2
        ex, ey = distort(x, y, lens.dist)
        ex, ey = xd - ex, yd - ey
        jxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        jyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        jxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        det = jxx * jyy - jxy * jxy
        dx, dy = (jyy * ex - jxy * ey) / det, (jxx * ey - jxy * ex) / det
        x, y = x + dx, y + dy
        if max(np.abs(dx).max(initial=0.0), np.abs(dy).max(initial=0.0)) < 1e-12:
            break
    return np.stack([x, y], axis=-1)


def finite(points: Floats) -> npt.NDArray[np.bool_]:
    """Tell which points (n, 2) are numbers."""
    result: npt.NDArray[np.bool_] = np.isfinite(points[:, 0]) & np.isfinite(points[:, 1])
    return result


def fit_homography(source: Floats, target: Floats, weight: Floats | None = None) -> Floats:
    """Homography (3, 3) that maps source (n, 2) to target (n, 2), by normalised least squares (DLT)."""
    a, Ta = _normalised(source)
    b, Tb = _normalised(target)
    x, y, u, v = a[:, 0], a[:, 1], b[:, 0], b[:, 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    if weight is not None:
        rows *= np.sqrt(np.concatenate([weight, weight]))[:, None]
    _, vectors = np.linalg.eigh(rows.T @ rows)
    H = np.linalg.inv(Tb) @ vectors[:, 0].reshape(3, 3) @ Ta
    result: Floats = H / H[2, 2]
    return result


def map_homography(H: Floats, points: Floats) -> Floats:
    """Map points (..., 2) by a homography."""
    w = points[..., 0] * H[2, 0] + points[..., 1] * H[2, 1] + H[2, 2]
    return np.stack(
        [
            (points[..., 0] * H[0, 0] + points[..., 1] * H[0, 1] + H[0, 2]) / w,
            (points[..., 0] * H[1, 0] + points[..., 1] * H[1, 1] + H[1, 2]) / w,
        ],
        axis=-1,
    )


def plane_pose(K: Floats, H: Floats) -> tuple[Floats, Floats]:
    """Pose R (3, 3), t (3,) of the plane z = 0 that a pinhole K sees through the homography H (Zhang 2000)."""
    B = np.linalg.inv(K) @ H
    B /= (np.linalg.norm(B[:, 0]) + np.linalg.norm(B[:, 1])) / 2
    if B[2, 2] < 0:  # the board lies in front of the device
        B = -B
    U, _, V = np.linalg.svd(np.stack([B[:, 0], B[:, 1], np.cross(B[:, 0], B[:, 1])], axis=1))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return R, B[:, 2]


def _normalised(points: Floats) -> tuple[Floats, Floats]:
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean())), 1e-12)
    T = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1.0]])
    return (points - centre) * scale, T
