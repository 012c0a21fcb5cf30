"""Resample a scan on the baseline's grid after a rigid motion; missing cells stay missing."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..grid import Grid
from ..scan import LEVEL_NONE, Scan
from ..slabs import in_slabs
from .motion import Motion

__all__ = ["apply_motion"]


ROUNDS = 4
"""Most rounds in which the height of a cell is sought; two do but at walls."""

# A row is worked out in loops of one kind each, places, then heights there, then their mean, so that the compiler can
# use the processor's wide registers: eight times as fast as cell by cell.


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _places(z, shape, along_u, along_v, u, v, at, right, down, inside):  # type: ignore[no-untyped-def]
    """Where in the scan (column u, row v, cells) the heights z of a row's cells lie, and the four cells around."""
    start_u, step_u, lean_u = along_u
    start_v, step_v, lean_v = along_v
    last, bottom = shape[1] - 1.0, shape[0] - 1.0
    wide = np.int32(shape[1])
    for j in range(z.size):
        x = start_u + step_u * j + lean_u * z[j]
        y = start_v + step_v * j + lean_v * z[j]
        # a shift that is a whole cell but for rounding must not ask for a neighbour it does not need
        whole_x, whole_y = np.floor(x + 0.5), np.floor(y + 0.5)
        x = whole_x if abs(x - whole_x) < 1e-6 else x
        y = whole_y if abs(y - whole_y) < 1e-6 else y
        inside[j] = (x >= 0.0) & (y >= 0.0) & (x <= last) & (y <= bottom)
        x = x if inside[j] else 0.0
        y = y if inside[j] else 0.0
        u[j], v[j] = x, y
        at[j] = np.int32(np.floor(y)) * wide + np.int32(np.floor(x))
        right[j] = np.int32(1) if x < last else np.int32(0)
        down[j] = wide if y < bottom else np.int32(0)


@njit(cache=True, nogil=True)
def _around(values, at, right, down, four):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    one, two, three, last = four[0], four[1], four[2], four[3]
    for j in range(at.size):
        k, r, d = np.uint32(at[j]), np.uint32(right[j]), np.uint32(down[j])
        one[j], two[j], three[j], last[j] = values[k], values[k + r], values[k + d], values[k + d + r]


@njit(cache=True, nogil=True, inline="always")
def _weights(u, v, h00, h01, h10, h11):  # type: ignore[no-untyped-def]  # as above
    """Bilinear weights of the measured ones of four cells, and whether the nearest is one.

    The nearest cell decides whether a place was measured: what is missing neither grows nor shrinks.
    """
    fu, fv = u - np.floor(u), v - np.floor(v)
    g00, g01, g10, g11 = abs(h00) < np.inf, abs(h01) < np.inf, abs(h10) < np.inf, abs(h11) < np.inf
    w00 = (1 - fv) * (1 - fu) if g00 else 0.0
    w01 = (1 - fv) * fu if g01 else 0.0
    w10 = fv * (1 - fu) if g10 else 0.0
    w11 = fv * fu if g11 else 0.0
    up = g00 if fu < 0.5 else g01
    low = g10 if fu < 0.5 else g11
    near = up if fv < 0.5 else low
    one = 1 / (w00 + w01 + w10 + w11)
    return w00 * one, w01 * one, w10 * one, w11 * one, near


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _heights(z, u, v, inside, four, lean, far):  # type: ignore[no-untyped-def]  # as above
    """Heights of a row's cells from the four around each, in place; gives how many moved by more than `far`."""
    lean_u, lean_v, lift, rise = lean
    one, two, three, last = four[0], four[1], four[2], four[3]
    none = np.float32(0)
    moving = 0
    for j in range(z.size):
        h00, h01, h10, h11 = one[j], two[j], three[j], last[j]
        w00, w01, w10, w11, near = _weights(u[j], v[j], h00, h01, h10, h11)
        h = w00 * (h00 if w00 > 0 else none) + w01 * (h01 if w01 > 0 else none)
        h += w10 * (h10 if w10 > 0 else none) + w11 * (h11 if w11 > 0 else none)
        now = lean_u * u[j] + lean_v * v[j] + lift * h + rise
        now = now if inside[j] & near else z[j]
        moving += 1 if abs(now - z[j]) > far else 0
        z[j] = now
    return moving


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _settle(u, v, inside, four, doubt, z, out_height, out_sigma):  # type: ignore[no-untyped-def]  # as above
    """Heights and sigmas of a row, NaN where nothing was measured.

    Sigma is carried, not averaged down: neighbouring cells share most of their error.
    """
    none = np.float32(0)
    for j in range(z.size):
        w00, w01, w10, w11, near = _weights(u[j], v[j], four[0, j], four[1, j], four[2, j], four[3, j])
        s = w00 * (doubt[0, j] if w00 > 0 else none) + w01 * (doubt[1, j] if w01 > 0 else none)
        s += w10 * (doubt[2, j] if w10 > 0 else none) + w11 * (doubt[3, j] if w11 > 0 else none)
        known = inside[j] & near
        out_height[j] = z[j] if known else np.nan
        out_sigma[j] = s if known else np.nan


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _paint(u, v, four, grey, height, out_texture):  # type: ignore[no-untyped-def]  # as above
    for j in range(height.size):
        w00, w01, w10, w11, _ = _weights(u[j], v[j], four[0, j], four[1, j], four[2, j], four[3, j])
        t = w00 * grey[0, j] + w01 * grey[1, j] + w10 * grey[2, j] + w11 * grey[3, j]
        out_texture[j] = np.uint8(t + 0.5) if abs(height[j]) < np.inf else np.uint8(0)


@njit(cache=True, nogil=True)
def _nearest(level, u, v, at, right, down, height, out_level):  # type: ignore[no-untyped-def]  # as above
    for j in range(height.size):
        aside = right[j] if u[j] - np.floor(u[j]) >= 0.5 else np.int32(0)
        below = down[j] if v[j] - np.floor(v[j]) >= 0.5 else np.int32(0)
        out_level[j] = level[np.uint32(at[j] + aside + below)] if abs(height[j]) < np.inf else LEVEL_NONE


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _resample(  # type: ignore[no-untyped-def]  # as above
    height, sigma, texture, level, shape, ahead, back, far, out_height, out_sigma, out_texture, out_level, first, last
):
    columns = out_height.shape[1]
    z, u, v = np.empty(columns), np.empty(columns), np.empty(columns)
    at, right, down = np.empty(columns, np.int32), np.empty(columns, np.int32), np.empty(columns, np.int32)
    inside = np.empty(columns, np.bool_)
    four, doubt = np.empty((4, columns), np.float32), np.empty((4, columns), np.float32)
    for i in range(first, last):
        # the small tilt makes the place depend on the height, which is what we look for: each round cuts the error by
        # the sine of the tilt
        z[:] = ahead[3]
        along_u = back[0, 0] + back[0, 1] * i, back[0, 2], back[0, 3]
        along_v = back[1, 0] + back[1, 1] * i, back[1, 2], back[1, 3]
        for _ in range(ROUNDS):
            _places(z, shape, along_u, along_v, u, v, at, right, down, inside)
            _around(height, at, right, down, four)
            if _heights(z, u, v, inside, four, ahead, far) == 0:
                break
        _around(sigma, at, right, down, doubt)
        _settle(u, v, inside, four, doubt, z, out_height[i], out_sigma[i])
        _around(texture, at, right, down, doubt)
        _paint(u, v, four, doubt, out_height[i], out_texture[i])
        _nearest(level, u, v, at, right, down, out_height[i], out_level[i])


def apply_motion(scan: Scan, motion: Motion, grid: Grid | None = None) -> Scan:
    """Move a scan and resample it.

    Parameters
    ----------
    scan : Scan
    motion : Motion
        What `register` found.
    grid : Grid, optional
        Where to put the cells, normally the baseline's grid; the scan's own if left out.

    Returns
    -------
    Scan
        On `grid`. Heights are interpolated bilinearly over the measured neighbours; a cell is NaN where the cell
        nearest to it is NaN, so that nothing is smeared across a crack's missing floor and what is missing neither
        grows nor shrinks. A motion by none returns the scan unchanged.
    """
    grid = scan.grid if grid is None else grid
    if grid == scan.grid and np.array_equal(motion.matrix, np.eye(4)):
        return scan
    height, sigma = (np.empty(grid.shape, np.float32) for _ in range(2))
    texture, level = (np.empty(grid.shape, np.uint8) for _ in range(2))
    inverse, source = np.linalg.inv(motion.matrix), scan.grid
    start = inverse[:2, 0] * grid.x0_mm + inverse[:2, 1] * grid.y0_mm + inverse[:2, 3]
    origin = np.array([source.x0_mm, source.y0_mm])
    # place in the scan, cells: start, and what a row, a column and a mm of height add
    back = np.stack([start - origin, inverse[:2, 1] * grid.pitch_mm, inverse[:2, 0] * grid.pitch_mm, inverse[:2, 2]])
    back = np.ascontiguousarray(back.T) / source.pitch_mm
    # height on the grid: what a column, a row and a mm of height in the scan add, and start
    lean_x, lean_y, lift, rise = (float(each) for each in motion.matrix[2])
    ahead = lean_x * source.pitch_mm, lean_y * source.pitch_mm, lift, rise + float(motion.matrix[2, :2] @ origin)
    tilt = float(np.abs(inverse[:2, 2]).sum())
    far = 1e-4 * source.pitch_mm / tilt if tilt > 0 else np.inf
    flat = (np.ascontiguousarray(values).reshape(-1) for values in (scan.height, scan.sigma, scan.texture, scan.level))
    given = *flat, source.shape, ahead, back, far, height, sigma, texture, level
    in_slabs(grid.rows, lambda first, last: _resample(*given, first, last))
    return Scan(grid, scan.time, height, sigma, texture, level, scan.calibration_id)
