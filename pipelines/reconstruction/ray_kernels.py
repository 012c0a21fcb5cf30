"""Compiled loops of triangulation: one line of the image at a time, from projector positions to points."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .ray_tables import MARGIN_PX, SLACK_PX

__all__ = ["BLOCK", "map_points", "plane_points"]

BLOCK = 256  # pixels that are worked on at once


@nb.njit(cache=True, nogil=True, inline="always")
def _lookup(table, column, row):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Bilinear look-up; positions beyond the margin are held at its edge."""
    c = min(max(column + np.float32(MARGIN_PX), np.float32(0)), np.float32(table.shape[1] - 1.001))
    r = min(max(row + np.float32(MARGIN_PX), np.float32(0)), np.float32(table.shape[0] - 1.001))
    i, j = np.int32(r), np.int32(c)
    a, b = r - np.float32(i), c - np.float32(j)
    top_x, top_y = table[i, j, 0], table[i, j, 1]
    low_x, low_y = table[i + 1, j, 0], table[i + 1, j, 1]
    top_x += b * (table[i, j + 1, 0] - top_x)
    top_y += b * (table[i, j + 1, 1] - top_y)
    low_x += b * (table[i + 1, j + 1, 0] - low_x)
    low_y += b * (table[i + 1, j + 1, 1] - low_y)
    return top_x + a * (low_x - top_x), top_y + a * (low_y - top_y)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _points_of_line(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, rays, lit, R, t, lens, least, block, x, y, z, sigma
):
    """Give the points of one line of the image, NaN where there is none.

    A plain loop over what both axes say, which the compiler turns into vector instructions as long as it works in the
    one array `block` (8 * `BLOCK`) at constant distances; the few pixels that know one axis follow.
    """
    for first in range(0, column.size, BLOCK):
        count = min(BLOCK, column.size - first)
        last = first + count
        single = _look_up(column[first:last], row[first:last], rays[first:last], lit, block)
        _weigh(sigma_column[first:last], sigma_row[first:last], block)
        _from_both_axes(block, count, R, t, lens[0], lens[1])
        _hand_over(block, x[first:last], y[first:last], z[first:last], sigma[first:last])
        if single > 0:
            for n in range(first, first + count):
                if (column[n] == column[n]) != (row[n] == row[n]):
                    depth, spread = _from_one_axis(
                        column[n], row[n], sigma_column[n], sigma_row[n], rays[n, 0], rays[n, 1], lit, R, t, lens, least
                    )[:2]
                    x[n], y[n], z[n] = rays[n, 0] * depth, rays[n, 1] * depth, depth
                    sigma[n] = spread


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _look_up(column, row, rays, lit, block):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Begin a block with what the tables say; give the number of pixels that know one axis only."""
    nan, zero = np.float32(np.nan), np.float32(0)
    single = 0
    for k in range(column.size):
        c, r = column[k], row[k]
        has_c, has_r = c == c, r == r  # NaN is not itself
        single += has_c != has_r
        both = has_c and has_r
        a, b = _lookup(lit, c if both else zero, r if both else zero)
        block[k], block[k + BLOCK] = a if both else nan, b
        block[k + 4 * BLOCK], block[k + 5 * BLOCK] = rays[k, 0], rays[k, 1]
    return single


@nb.njit(cache=True, nogil=True)
def _weigh(sigma_column, sigma_row, block):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for k in range(sigma_row.size):
        block[k + 2 * BLOCK], block[k + 3 * BLOCK] = sigma_column[k], sigma_row[k]


@nb.njit(cache=True, nogil=True)
def _hand_over(block, x, y, z, sigma):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for k in range(z.size):
        x[k], y[k] = block[k + 4 * BLOCK] * block[k + 6 * BLOCK], block[k + 5 * BLOCK] * block[k + 6 * BLOCK]
    for k in range(z.size):
        z[k], sigma[k] = block[k + 6 * BLOCK], block[k + 7 * BLOCK]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _from_both_axes(block, count, R, t, fx, fy):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    r00, r01, r02, r10, r11, r12 = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22, t0, t1, t2 = R[2, 0], R[2, 1], R[2, 2], t[0], t[1], t[2]
    slack, nan = SLACK_PX * SLACK_PX, np.float32(np.nan)
    for k in range(count):
        a, b = float(block[k]), float(block[k + BLOCK])
        sc, sr = float(block[k + 2 * BLOCK]), float(block[k + 3 * BLOCK])
        u, v = float(block[k + 4 * BLOCK]), float(block[k + 5 * BLOCK])
        dx, dy, dz = r00 * u + r01 * v + r02, r10 * u + r11 * v + r12, r20 * u + r21 * v + r22
        # (dx - x dz) s + (tx - x tz) = 0 says that the point at distance s lies in the column's plane
        ax, bx = fx * (dx - a * dz), fx * (t0 - a * t2)
        ay, by = fy * (dy - b * dz), fy * (t1 - b * t2)
        # weights 1 / variance, both times both variances: divisions are what costs here
        wx, wy = sr * sr, sc * sc
        known = 1.0 / (wx * ax * ax + wy * ay * ay)
        depth = -(wx * ax * bx + wy * ay * by) * known
        far = depth * dz + t2
        ex, ey = ax * depth + bx, ay * depth + by  # times the distance from the projector
        limit_c, limit_r = 9 * wy + slack, 9 * wx + slack
        meet = ex * ex * limit_r + ey * ey * limit_c <= limit_c * limit_r * far * far
        good = meet & (depth > 0) & (far > 0)  # false for NaN
        spread = far * np.sqrt(wx * wy * known)
        block[k + 6 * BLOCK] = np.float32(depth) if good else nan
        block[k + 7 * BLOCK] = np.float32(spread) if good else nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _from_one_axis(c, r, sigma_c, sigma_r, u, v, lit, R, t, lens, least):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Depth, its sigma, and both positions on the projector, the missing one from where the ray falls."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    has_c = c == c
    dx = R[0, 0] * u + R[0, 1] * v + R[0, 2]
    dy = R[1, 0] * u + R[1, 1] * v + R[1, 2]
    dz = R[2, 0] * u + R[2, 1] * v + R[2, 2]
    guess_c = c if has_c else np.float32(0.5 * (lit.shape[1] - 2 * MARGIN_PX))
    guess_r = np.float32(0.5 * (lit.shape[0] - 2 * MARGIN_PX)) if has_c else r
    depth, ax, ay = np.nan, np.nan, np.nan
    for _turn in range(4):
        if not (guess_c == guess_c and guess_r == guess_r):  # the ray falls nowhere; NaN is no place in a table
            depth = np.nan
            break
        x, y = _lookup(lit, guess_c, guess_r)
        ax, bx = fx * (dx - x * dz), fx * (t[0] - x * t[2])
        ay, by = fy * (dy - y * dz), fy * (t[1] - y * t[2])
        depth = -bx / ax if has_c else -by / ay
        z = depth * dz + t[2]
        px, py = (depth * dx + t[0]) / z, (depth * dy + t[1]) / z
        r2 = px * px + py * py
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if has_c:
            guess_r = np.float32(fy * (py * radial + p1 * (r2 + 2 * py * py) + 2 * p2 * px * py) + cy)
        else:
            guess_c = np.float32(fx * (px * radial + 2 * p1 * px * py + p2 * (r2 + 2 * px * px)) + cx)
    kept, missing, s = (ax, ay, sigma_c) if has_c else (ay, ax, sigma_r)
    z = depth * dz + t[2]
    if kept * kept < least * least * (kept * kept + missing * missing) or not (depth > 0 and z > 0):
        depth = np.nan
    spread = z * s / abs(kept) if depth == depth else np.nan
    return depth, spread, guess_c, guess_r


@nb.njit(cache=True, nogil=True, error_model="numpy")
def map_points(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, rays, lit, R, t, lens, least, level_in, xyz, sigma_z, projector, level
):
    """Points of a band of lines, as `PointMap` keeps them."""
    width = column.shape[1]
    block = np.empty(8 * BLOCK, np.float32)
    x, y, z = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    nan = np.float32(np.nan)
    for i in range(len(column)):
        _points_of_line(
            column[i], row[i], sigma_column[i], sigma_row[i], rays[i], lit, R, t, lens, least, block,
            x, y, z, sigma_z[i],
        )  # fmt: skip
        for n in range(width):
            good = z[n] == z[n]
            xyz[i, n, 0], xyz[i, n, 1], xyz[i, n, 2] = x[n], y[n], z[n]
            projector[i, n, 0] = column[i, n] if good else nan
            projector[i, n, 1] = row[i, n] if good else nan
            found = np.uint8(0) if level_in[i, n] == LEVEL_NONE else level_in[i, n]  # one axis was enough
            level[i, n] = found if good else np.uint8(LEVEL_NONE)
        for n in range(width):
            if z[n] == z[n] and not (column[i, n] == column[i, n] and row[i, n] == row[i, n]):
                place = _from_one_axis(
                    column[i, n], row[i, n], sigma_column[i, n], sigma_row[i, n], rays[i, n, 0], rays[i, n, 1],
                    lit, R, t, lens, least,
                )  # fmt: skip
                projector[i, n, 0], projector[i, n, 1] = place[2], place[3]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def plane_points(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, rays, lit, R, t, lens, least, planes
):
    """Points of a band of lines, x, y, z and sigma each in a plane of `planes`, (4, row, column)."""
    block = np.empty(8 * BLOCK, np.float32)
    for i in range(len(column)):
        _points_of_line(
            column[i], row[i], sigma_column[i], sigma_row[i], rays[i], lit, R, t, lens, least, block,
            planes[0, i], planes[1, i], planes[2, i], planes[3, i],
        )  # fmt: skip
