"""Projector positions to 3D points: camera-ray and projector tables once per calibration, one fused pass per scan."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numba as nb
import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from .height_doubt import with_doubt
from .pinhole import undistort
from .pixel_maps import Decoded, PointMap
from .rig_model import Calibration
from .slabs import in_slabs
from .triangulate_parallel import triangulate_parallel

__all__ = ["triangulate"]

MARGIN_PX = 2  # the projector's table reaches this far beyond its edge: sub-pixel positions may too
LEAST_PARALLAX = 0.5  # of both axes' together: an axis with less, left alone, says next to nothing of the depth
SLACK_PX = 1.0  # what calibration and blur may leave between two rays, in projector px, beside the decoding's sigma


@dataclass(frozen=True, slots=True, eq=False)
class _Tables:
    rays: npt.NDArray[np.float32]
    """(row, column, 2): x/z and y/z of each camera pixel, distortion taken out."""
    lit: npt.NDArray[np.float32]
    """(row, column, 2): the same of each projector pixel, from -MARGIN_PX on."""


_cache: OrderedDict[str, _Tables] = OrderedDict()
_KEPT = 3


def triangulate(decoded: Decoded, calibration: Calibration) -> PointMap:
    """Give each decoded camera pixel its point in space.

    Each decoded axis is one linear equation for the distance along the camera's ray; both together are solved by least
    squares, weighted by the sigma of each axis, so the axis along the baseline decides and the other one helps and
    checks: where the two rays pass each other by more than decoding and calibration explain, the pixel is rejected.
    A missing axis is taken from where the ray falls, by iteration. A pixel that lost the axis which carries the
    parallax is rejected: its rays are nearly parallel, and what is left puts it anywhere.

    Parameters
    ----------
    decoded : Decoded
    calibration : Calibration
        Of the same image size.

    Returns
    -------
    PointMap
        ``sigma_z`` is the decoding's sigma carried through the geometry, and what the calibration leaves open beside
        (`doubt_mm`).

    Raises
    ------
    ValueError
        If the images' size is not the one that was calibrated.
    """
    columns, rows = calibration.camera.size
    if decoded.column.shape != (rows, columns):
        raise ValueError(
            f"images of {decoded.column.shape[1]}x{decoded.column.shape[0]}, but the calibration is for "
            f"{columns}x{rows}: use the camera settings of the calibration, or calibrate again"
        )
    if calibration.camera.parallel or calibration.projector.parallel:
        return triangulate_parallel(decoded, calibration)
    tables = _tables(calibration)
    xyz = np.empty((rows, columns, 3), np.float32)
    sigma_z = np.empty((rows, columns), np.float32)
    projector = np.empty((rows, columns, 2), np.float32)
    level = np.empty((rows, columns), np.uint8)
    P = calibration.projector
    lens = np.array([P.K[0, 0], P.K[1, 1], P.K[0, 2], P.K[1, 2], *P.dist])
    least = LEAST_PARALLAX if _any_known(decoded.column) and _any_known(decoded.row) else 0.0

    def slab(first: int, last: int) -> None:
        _kernel(
            decoded.column[first:last].reshape(-1),
            decoded.row[first:last].reshape(-1),
            decoded.sigma_column[first:last].reshape(-1),
            decoded.sigma_row[first:last].reshape(-1),
            decoded.level[first:last].reshape(-1),
            tables.rays[first:last].reshape(-1, 2),
            tables.lit,
            calibration.R,
            calibration.t_mm,
            lens,
            least,
            xyz[first:last].reshape(-1, 3),
            sigma_z[first:last].reshape(-1),
            projector[first:last].reshape(-1, 2),
            level[first:last].reshape(-1),
        )

    in_slabs(rows, slab)
    return with_doubt(PointMap(xyz, sigma_z, projector, level, decoded.texture), calibration)


def _any_known(place: npt.NDArray[np.float32]) -> bool:
    return any(not np.isnan(line).all() for line in place)  # most often the first line answers


def _tables(calibration: Calibration) -> _Tables:
    key = calibration.id
    if key in _cache:
        _cache.move_to_end(key)
        return _cache[key]
    rays = _undistorted(calibration.camera.size, calibration, 0)
    made = _Tables(rays, _undistorted(calibration.projector.size, calibration, MARGIN_PX))
    _cache[key] = made
    while len(_cache) > _KEPT:
        _cache.popitem(last=False)
    return made


def _undistorted(size: tuple[int, int], calibration: Calibration, margin: int) -> npt.NDArray[np.float32]:
    lens = calibration.projector if margin else calibration.camera
    columns = np.arange(-margin, size[0] + margin, dtype=np.float64)
    table = np.empty((size[1] + 2 * margin, len(columns), 2), np.float32)
    block = max(1, 200_000 // len(columns))
    for first in range(0, len(table), block):  # in blocks: the intermediates stay in the processor's cache
        rows = np.arange(first, min(first + block, len(table))) - float(margin)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
        table[first : first + block] = undistort(lens, pixels)
    return table


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
    column, row, sigma_column, sigma_row, level_in, rays, lit, R, t, lens, least, xyz, sigma_z, projector, level
):
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    nan = np.float32(np.nan)
    middle_column, middle_row = 0.5 * (lit.shape[1] - 2 * MARGIN_PX), 0.5 * (lit.shape[0] - 2 * MARGIN_PX)
    for n in range(column.shape[0]):
        c, r = float(column[n]), float(row[n])
        has_c, has_r = c == c, r == r  # NaN is not itself
        depth, spread = np.nan, np.nan
        if has_c or has_r:
            u, v = float(rays[n, 0]), float(rays[n, 1])
            dx = R[0, 0] * u + R[0, 1] * v + R[0, 2]
            dy = R[1, 0] * u + R[1, 1] * v + R[1, 2]
            dz = R[2, 0] * u + R[2, 1] * v + R[2, 2]
            sc, sr = float(sigma_column[n]), float(sigma_row[n])
            guess_c = c if has_c else middle_column
            guess_r = r if has_r else middle_row
            for _turn in range(1 if has_c and has_r else 4):
                x, y = _lookup(lit, guess_c, guess_r)
                # (dx - x dz) s + (tx - x tz) = 0 says that the point at distance s lies in the column's plane
                ax, bx = fx * (dx - x * dz), fx * (t[0] - x * t[2])
                ay, by = fy * (dy - y * dz), fy * (t[1] - y * t[2])
                # weights 1 / variance, both times both variances: divisions are what costs here
                wx, wy = (sr * sr if has_r else 1.0), (sc * sc if has_c else 1.0)
                wx, wy = (wx if has_c else 0.0), (wy if has_r else 0.0)
                known = 1.0 / (wx * ax * ax + wy * ay * ay)
                depth = -(wx * ax * bx + wy * ay * by) * known
                z = depth * dz + t[2]
                if has_c and has_r:
                    break
                px, py = (depth * dx + t[0]) / z, (depth * dy + t[1]) / z
                r2 = px * px + py * py
                radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
                if not has_c:
                    guess_c = fx * (px * radial + 2 * p1 * px * py + p2 * (r2 + 2 * px * px)) + cx
                if not has_r:
                    guess_r = fy * (py * radial + p1 * (r2 + 2 * py * py) + 2 * p2 * px * py) + cy
            if not (has_c and has_r):
                kept, missing = (ax, ay) if has_c else (ay, ax)
                if kept * kept < least * least * (kept * kept + missing * missing):
                    depth = np.nan
            z = depth * dz + t[2]
            spread = z * np.sqrt((sc * sc if has_c else 1.0) * (sr * sr if has_r else 1.0) * known)
            if has_c and has_r:
                ex, ey = ax * depth + bx, ay * depth + by  # times z
                slack = SLACK_PX * SLACK_PX
                limit_c, limit_r = 9 * sc * sc + slack, 9 * sr * sr + slack
                if ex * ex * limit_r + ey * ey * limit_c > limit_c * limit_r * z * z:
                    depth = np.nan
            if not (depth > 0 and z > 0):
                depth = np.nan
        if depth == depth:
            xyz[n, 0] = u * depth
            xyz[n, 1] = v * depth
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
