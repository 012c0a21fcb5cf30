"""Compiled loops that say of each camera pixel where on the grid it lies: cell, height, slope and footprint.

Written as plain loops over one array at constant distances, or over few arrays: so the compiler makes vector
instructions of them.
"""

from __future__ import annotations

import numba as nb
import numpy as np

__all__ = ["CODE", "FINE", "OFFSET", "STEEPEST", "lay", "to_site"]

FINE = 8192.0  # slopes are kept in steps of 1 / FINE
OFFSET = 254.0  # offsets from a cell's centre in steps of 1 / OFFSET cell
CODE = 64.0  # half sides of footprints in steps of 1 / CODE of the usual one
STEEPEST = 3.0  # two points of one cell further apart in height than this many cells are two surfaces
BLOCK = 256  # pixels that are worked on at once
WIDE = BLOCK + 4  # and two to either side


@nb.njit(cache=True, nogil=True, error_model="numpy")
def to_site(planes, keep, M, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Turn the points of rows `first` to `last` to the site frame, in place; NaN where not kept."""
    nan = np.float32(np.nan)
    m00, m01, m02, m03 = M[0, 0], M[0, 1], M[0, 2], M[0, 3]
    m10, m11, m12, m13 = M[1, 0], M[1, 1], M[1, 2], M[1, 3]
    m20, m21, m22, m23 = M[2, 0], M[2, 1], M[2, 2], M[2, 3]
    for i in range(first, last):
        xs, ys, zs, kept = planes[0, i], planes[1, i], planes[2, i], keep[i]
        for j in range(xs.size):
            x, y, z = float(xs[j]), float(ys[j]), float(zs[j])
            xs[j] = np.float32(m00 * x + m01 * y + m02 * z + m03)
            ys[j] = np.float32(m10 * x + m11 * y + m12 * z + m13)
            zs[j] = np.float32(m20 * x + m21 * y + m22 * z + m23) if kept[j] else nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def lay(planes, first, last, place, shape, usual, cell, above, sigma, local, slope, reach):  # type: ignore[no-untyped-def]  # a kernel
    """Say of each pixel of rows `first` to `last` of a band in the site frame where it lies.

    The slope is that of the plane through the differences to the pixel's neighbours on the same surface, along the row
    and down the column of the image; to one side where the other side is another surface. The same differences give the
    footprint: the pixel's share of the surface as the grid sees it, a rectangle of the right area.

    Parameters
    ----------
    planes : ndarray of float32, shape (4, row, column)
        x, y, z in the site frame, z NaN where not measured, and sigma.
    place : (float, float, float)
        x0, y0 and pitch of the grid.
    shape : (int, int)
    usual : (float, float)
        Half sides of a usual footprint along x and y, cells.
    cell : ndarray of int32, shape (last - first, column)
        Out: number of the cell, -1 where none.
    above, sigma : ndarray of float32, shape (last - first, column)
        Out: sigma is negative at a border, where one of the eight next pixels is not on the same surface.
    local : ndarray of int8, shape (last - first, column, 4)
        Out: offset from the cell's centre along x and y (1/`OFFSET` cell), half sides of the footprint (1/`CODE` usual
        ones, less 128).
    slope : ndarray of int16, shape (last - first, column, 2)
    reach : ndarray of int32, shape (last - first, 2)
        Out: first and last row of the grid that a pixel of the line lies in.
    """
    W = planes.shape[2]
    block = np.empty(17 * WIDE, np.float32)
    for i in range(first, last):
        lowest, highest = np.int64(shape[0]), np.int64(-1)
        for start in range(0, W, BLOCK):
            count = min(BLOCK, W - start)
            for side in range(3):
                for axis in range(3):
                    _copy(planes[axis], i - 1 + side, start - 2, block, (3 * side + axis) * WIDE)
            _differ(block, count, place, usual)
            _note(
                block, planes[3, i, start : start + count], shape, cell[i - first, start : start + count],
                above[i - first, start : start + count], sigma[i - first, start : start + count],
                local[i - first, start : start + count], slope[i - first, start : start + count],
            )  # fmt: skip
            for k in range(count):
                if cell[i - first, start + k] >= 0:
                    row = np.int64(block[12 * WIDE + k])
                    lowest, highest = min(lowest, row), max(highest, row)
        reach[i - first, 0], reach[i - first, 1] = lowest, highest


@nb.njit(cache=True, nogil=True)
def _copy(plane, row, start, block, at):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Copy `WIDE` values of a row, NaN beyond the plane's ends."""
    out = block[at : at + WIDE]
    if not 0 <= row < len(plane):
        out[:] = np.nan
        return
    line = plane[row]
    low, high = max(0, -start), min(out.size, line.size - start)
    out[:low], out[high:] = np.nan, np.nan
    part, source = out[low:high], line[start + low : start + high]
    for k in range(source.size):
        part[k] = source[k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _differ(block, count, place, usual):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """From the lines around (slots 0 to 8 of `block`) to what is noted of each pixel.

    Slots 11 to 16: column, row, offsets, slopes; 0 and 1: sides of the footprint in usual ones; 2: neighbours.
    """
    per, x0, y0 = 1 / place[2], place[0], place[1]
    usual_x, usual_y = np.float32(2 * usual[0] * place[2]), np.float32(2 * usual[1] * place[2])
    steep = np.float32(STEEPEST * STEEPEST)
    one, zero, most = np.float32(1), np.float32(0), np.float32(STEEPEST)
    for k in range(count):
        m = k + 2
        x, y, z = block[3 * WIDE + m], block[4 * WIDE + m], block[5 * WIDE + m]
        along, across = (float(x) - x0) * per, (float(y) - y0) * per
        column, row = np.floor(along + 0.5), np.floor(across + 0.5)
        # before and after along the line, then across it: on the same surface or not; NaN is not
        ux, uy, uz = block[3 * WIDE + m - 1] - x, block[4 * WIDE + m - 1] - y, block[5 * WIDE + m - 1] - z
        vx, vy, vz = block[3 * WIDE + m + 1] - x, block[4 * WIDE + m + 1] - y, block[5 * WIDE + m + 1] - z
        u, v = uz * uz <= steep * (ux * ux + uy * uy), vz * vz <= steep * (vx * vx + vy * vy)
        ax, ay = (vx if v else zero) - (ux if u else zero), (vy if v else zero) - (uy if u else zero)
        az = (vz if v else zero) - (uz if u else zero)
        na = (one if u else zero) + (one if v else zero)
        ux, uy, uz = block[m] - x, block[WIDE + m] - y, block[2 * WIDE + m] - z
        vx, vy, vz = block[6 * WIDE + m] - x, block[7 * WIDE + m] - y, block[8 * WIDE + m] - z
        u, v = uz * uz <= steep * (ux * ux + uy * uy), vz * vz <= steep * (vx * vx + vy * vy)
        bx, by = (vx if v else zero) - (ux if u else zero), (vy if v else zero) - (uy if u else zero)
        bz = (vz if v else zero) - (uz if u else zero)
        nb_ = (one if u else zero) + (one if v else zero)
        aa, bb, turn = ax * ax + ay * ay, bx * bx + by * by, ax * by - ay * bx
        plane = turn * turn > np.float32(0.01) * aa * bb
        # neighbours in one direction only: nothing is known across it
        only_x, only_y, only_z = (ax, ay, az) if aa > zero else (bx, by, bz)
        length = aa if aa > zero else bb
        below = turn if plane else (length if length > zero else one)
        gx = (az * by - bz * ay if plane else only_z * only_x) / below
        gy = (bz * ax - az * bx if plane else only_z * only_y) / below
        # the line may run along y: a map that was turned
        side_x = max(abs(ax) / na, abs(bx) / max(nb_, one)) if aa > zero else usual_x
        side_y = abs(turn) / (na * nb_ * side_x) if plane and side_x > zero else usual_y
        block[11 * WIDE + k], block[12 * WIDE + k] = np.float32(column), np.float32(row)
        block[13 * WIDE + k], block[14 * WIDE + k] = np.float32(along - column), np.float32(across - row)
        block[15 * WIDE + k], block[16 * WIDE + k] = min(max(gx, -most), most), min(max(gy, -most), most)
        block[k], block[WIDE + k] = side_x / usual_x, side_y / usual_y
        level = most * (usual_x + usual_y)
        whole = (abs(block[2 * WIDE + m - 1] - z) <= level) & (abs(block[2 * WIDE + m + 1] - z) <= level)
        whole &= (abs(block[8 * WIDE + m - 1] - z) <= level) & (abs(block[8 * WIDE + m + 1] - z) <= level)
        block[2 * WIDE + k] = na + nb_ if whole else zero


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _note(block, spread, shape, cell, above, sigma, local, slope):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    rows, columns = np.float32(shape[0]), np.float32(shape[1])
    half, least, most = np.float32(0.5), np.float32(-128), np.float32(127)
    for k in range(cell.size):
        column, row = block[11 * WIDE + k], block[12 * WIDE + k]
        z = block[5 * WIDE + k + 2]
        inside = (z == z) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        cell[k] = np.int32(row) * np.int32(shape[1]) + np.int32(column) if inside else np.int32(-1)
    for k in range(cell.size):
        above[k] = block[5 * WIDE + k + 2]
        sigma[k] = spread[k] if block[2 * WIDE + k] == np.float32(4) else -spread[k]
    for k in range(cell.size):
        local[k, 0] = np.int8(np.rint(np.float32(OFFSET) * block[13 * WIDE + k]))
        local[k, 1] = np.int8(np.rint(np.float32(OFFSET) * block[14 * WIDE + k]))
        local[k, 2] = np.int8(min(np.floor(np.float32(CODE) * block[k] + half) + least, most))
        local[k, 3] = np.int8(min(np.floor(np.float32(CODE) * block[WIDE + k] + half) + least, most))
    for k in range(cell.size):
        slope[k, 0] = np.int16(np.rint(np.float32(FINE) * block[15 * WIDE + k]))
        slope[k, 1] = np.int16(np.rint(np.float32(FINE) * block[16 * WIDE + k]))
