"""Triangulation where a lens is affine: its rays are parallel, and it has no place that distances count from.

The same equations, weights and checks as in `triangulate`. A camera's ray starts beside its neighbours and runs along
z; an affine projector's column is a plane of space, ``a . X + b = column``: its matrix has the third row 0 0 0 1.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from ..slabs import in_slabs
from .height_doubt import with_doubt
from .pixel_maps import Decoded, PointMap
from .ray_tables import LEAST_PARALLAX, MARGIN_PX, SLACK_PX, ray_tables
from .rig_model import Calibration
from .shared_error import shared_mm2
from .sight import projector_rows

__all__ = ["triangulate_parallel"]

TURNS = 4  # a missing axis is taken from where the ray falls: so often


def triangulate_parallel(decoded: Decoded, calibration: Calibration) -> PointMap:
    """Give each decoded camera pixel its point in space, seen by at least one affine lens.

    Parameters
    ----------
    decoded : Decoded
    calibration : Calibration
        Of the same image size.

    Returns
    -------
    PointMap
        As `triangulate` gives it. For an affine camera z counts from where its axis meets the reference plane, and
        may be negative: nearer than that.

    Raises
    ------
    ValueError
        If the images' size is not the one that was calibrated.
    """
    tables = ray_tables(decoded, calibration)
    rows, columns = decoded.column.shape
    xyz, projector = np.empty((rows, columns, 3), np.float32), np.empty((rows, columns, 2), np.float32)
    sigma_z, level = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.uint8)
    P = calibration.projector
    R, t = projector_rows(calibration)
    K, skew = P.K, P.K[0, 1]
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *P.dist, skew])
    parallel = calibration.camera.parallel, P.parallel
    least = LEAST_PARALLAX if np.isfinite(decoded.column).any() and np.isfinite(decoded.row).any() else 0.0

    def slab(first: int, last: int) -> None:
        _kernel(
            decoded.column[first:last].reshape(-1),
            decoded.row[first:last].reshape(-1),
            decoded.sigma_column[first:last].reshape(-1),
            decoded.sigma_row[first:last].reshape(-1),
            decoded.level[first:last].reshape(-1),
            tables.rays[first:last].reshape(-1, 2),
            tables.lit,
            R,
            t,
            lens,
            parallel[0],
            parallel[1],
            least,
            xyz[first:last].reshape(-1, 3),
            sigma_z[first:last].reshape(-1),
            projector[first:last].reshape(-1, 2),
            level[first:last].reshape(-1),
        )

    in_slabs(rows, slab)
    shared = shared_mm2(decoded.shared, calibration)
    return with_doubt(PointMap(xyz, sigma_z, projector, level, decoded.texture, shared), calibration)


@nb.njit(cache=True, nogil=True, inline="always")
def _lookup(table, column, row):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Bilinear look-up; positions beyond the margin are held at its edge."""
    c = min(max(column + MARGIN_PX, 0.0), table.shape[1] - 1.001)
    r = min(max(row + MARGIN_PX, 0.0), table.shape[0] - 1.001)
    i, j = int(r), int(c)
    a, b = r - i, c - j
    w00, w01, w10, w11 = (1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b
    x = w00 * table[i, j, 0] + w01 * table[i, j + 1, 0] + w10 * table[i + 1, j, 0] + w11 * table[i + 1, j + 1, 0]
    y = w00 * table[i, j, 1] + w01 * table[i, j + 1, 1] + w10 * table[i + 1, j, 1] + w11 * table[i + 1, j + 1, 1]
    return x, y


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _kernel(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, level_in, rays, lit, R, t, lens, parallel_camera, parallel_projector,
    least, xyz, sigma_z, projector, level,
):  # fmt: skip
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    k1, k2, p1, p2, k3, skew = lens[4], lens[5], lens[6], lens[7], lens[8], lens[9]
    nan = np.float32(np.nan)
    middle_column, middle_row = 0.5 * (lit.shape[1] - 2 * MARGIN_PX), 0.5 * (lit.shape[0] - 2 * MARGIN_PX)
    for n in range(column.shape[0]):
        c, r = float(column[n]), float(row[n])
        has_c, has_r = c == c, r == r  # NaN is not itself
        depth, spread = np.nan, np.nan
        if has_c or has_r:
            u, v = float(rays[n, 0]), float(rays[n, 1])
            # in the projector's frame the ray is t + depth d, a parallel one from beside the origin
            if parallel_camera:
                dx, dy, dz = R[0, 2], R[1, 2], R[2, 2]
                tx = R[0, 0] * u + R[0, 1] * v + t[0]
                ty = R[1, 0] * u + R[1, 1] * v + t[1]
                tz = R[2, 0] * u + R[2, 1] * v + t[2]
            else:
                dx = R[0, 0] * u + R[0, 1] * v + R[0, 2]
                dy = R[1, 0] * u + R[1, 1] * v + R[1, 2]
                dz = R[2, 0] * u + R[2, 1] * v + R[2, 2]
                tx, ty, tz = t[0], t[1], t[2]
            sc, sr = float(sigma_column[n]), float(sigma_row[n])
            guess_c = c if has_c else middle_column
            guess_r = r if has_r else middle_row
            for _turn in range(1 if has_c and has_r else TURNS):
                if not (guess_c == guess_c and guess_r == guess_r):  # the ray falls nowhere
                    depth = np.nan
                    break
                x, y = _lookup(lit, guess_c, guess_r)
                ax, bx = fx * (dx - x * dz), fx * (tx - x * tz)
                ay, by = fy * (dy - y * dz), fy * (ty - y * tz)
                wx, wy = (sr * sr if has_r else 1.0), (sc * sc if has_c else 1.0)
                wx, wy = (wx if has_c else 0.0), (wy if has_r else 0.0)
                known = 1.0 / (wx * ax * ax + wy * ay * ay)
                depth = -(wx * ax * bx + wy * ay * by) * known
                z = depth * dz + tz
                if has_c and has_r:
                    break
                px, py = (depth * dx + tx) / z, (depth * dy + ty) / z
                r2 = px * px + py * py
                radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
                qx = px * radial + 2 * p1 * px * py + p2 * (r2 + 2 * px * px)
                qy = py * radial + p1 * (r2 + 2 * py * py) + 2 * p2 * px * py
                if not has_c:
                    guess_c = fx * qx + skew * qy + cx
                if not has_r:
                    guess_r = fy * qy + cy
            if not (has_c and has_r):
                kept, missing = (ax, ay) if has_c else (ay, ax)
                if kept * kept < least * least * (kept * kept + missing * missing):
                    depth = np.nan
            z = depth * dz + tz
            spread = abs(z) * np.sqrt((sc * sc if has_c else 1.0) * (sr * sr if has_r else 1.0) * known)
            if has_c and has_r:
                ex, ey = ax * depth + bx, ay * depth + by  # times z
                slack = SLACK_PX * SLACK_PX
                limit_c, limit_r = 9 * sc * sc + slack, 9 * sr * sr + slack
                if ex * ex * limit_r + ey * ey * limit_c > limit_c * limit_r * z * z:
                    depth = np.nan
            if not ((parallel_camera or depth > 0) and (parallel_projector or z > 0)):
                depth = np.nan
        if depth == depth:
            xyz[n, 0] = u if parallel_camera else u * depth
            xyz[n, 1] = v if parallel_camera else v * depth
            xyz[n, 2] = depth
            sigma_z[n] = spread
            projector[n, 0] = c if has_c else guess_c
            projector[n, 1] = r if has_r else guess_r
            level[n] = 0 if level_in[n] == LEVEL_NONE else level_in[n]  # one axis was enough
        else:
            xyz[n, 0] = nan
            xyz[n, 1] = nan
            xyz[n, 2] = nan
            sigma_z[n] = nan
            projector[n, 0] = nan
            projector[n, 1] = nan
            level[n] = LEVEL_NONE
