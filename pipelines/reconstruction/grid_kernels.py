"""Compiled loops of gridding: the sums of each cell, and how much of it is covered."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .cell_kernels import (
    ALONG,
    ASIDE,
    COUNT,
    FIRST,
    HALF,
    HEIGHT,
    HIGH,
    INNER,
    LIGHT,
    LOW,
    RIM,
    SLOPE_X,
    SLOPE_Y,
    SQUARE,
    WEIGHT,
    conclude,
)
from .lay_kernels import CODE, FINE, OFFSET, STEEPEST

__all__ = ["RIM", "STEEPEST", "add_point", "cells_met", "drop_beyond", "fill", "half_side", "overlap"]


@nb.njit(cache=True, nogil=True)
def drop_beyond(farthest, M, place, columns, cell, above, local):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Forget points whose distance along the camera's axis is above `farthest`."""
    x0, y0, pitch = place
    for i in range(len(cell)):
        for j in range(cell.shape[1]):
            if cell[i, j] >= 0:
                x = x0 + (cell[i, j] % columns + local[i, j, 0] / OFFSET) * pitch - M[0, 3]
                y = y0 + (cell[i, j] // columns + local[i, j, 1] / OFFSET) * pitch - M[1, 3]
                if M[0, 2] * x + M[1, 2] * y + M[2, 2] * (above[i, j] - M[2, 3]) > farthest:
                    cell[i, j] = -1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fill(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    laid, texture_in, level_in, usual, pitch, sharing, height, sigma, texture, level, first, last
):
    """Sum up the points of the cells of a band of rows.

    A pixel within a surface covers its own cell with all of its area, which its neighbours repay; one at a border
    covers what its footprint covers, and marks its cell as one of a border. Cells with points that are covered by less
    than half get a negative sigma: `mend` looks whether they lie at a border. Covered cells without a point get the
    planes of the pixels that cover them.
    """
    cell, above, sigma_in, local, slope, reach = laid
    columns = height.shape[1]
    start, size = first * columns, (last - first) * columns
    total = np.zeros((13, size), np.float32)
    deepest, rim = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    wide = max(usual[0], usual[1]) > 1
    spill = np.int64(np.ceil(4 * usual[1]))  # rows that the largest footprint reaches beyond its own
    cover = np.zeros((last - first, columns), np.float32)
    for i in range(len(cell)):
        if reach[i, 0] < last + spill and reach[i, 1] >= first - spill:
            _sum_line(
                cell[i], above[i], sigma_in[i], local[i], slope[i], texture_in[i], level_in[i], usual, wide,
                start, spill, total, cover, deepest, rim,
            )  # fmt: skip
    gap = np.float32(STEEPEST * pitch)
    if _any_apart(total[LOW], total[HIGH], gap):
        _choose(laid, texture_in, gap, total, start, columns)
    if _any_empty(total[COUNT], cover.reshape(-1)):
        _lend(
            laid, texture_in, level_in, usual, pitch, gap, spill, wide, total, cover, deepest, rim, first, last, columns
        )
    conclude(
        total, cover.reshape(-1), deepest, rim, pitch, sharing, wide, height[first:last].reshape(-1),
        sigma[first:last].reshape(-1), texture[first:last].reshape(-1), level[first:last].reshape(-1),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sum_line(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    cell, above, sigma_in, local, slope, texture_in, level_in, usual, wide, start, spill, total, cover, deepest, rim
):
    """Add the pixels of a line of the image to the cells of a band, of which `start` is the first."""
    rows, columns = cover.shape
    size, beside = rows * columns, spill * columns
    area = np.float32(4 * usual[0] * usual[1] / (CODE * CODE))
    none, zero = np.uint8(0), np.float32(0)
    for j in range(cell.size):
        n = np.int64(cell[j]) - start
        if cell[j] < 0 or not -beside <= n < size + beside:
            continue
        inner = sigma_in[j] > 0
        if wide or not inner:
            _cover(cover, cell[j] // columns - start // columns, cell[j] % columns, local[j], usual)
        if 0 <= n < size:
            k = np.uintp(n)  # unsigned: to look for a negative index costs more than the sum
            alone, low, high = total[COUNT, k] == 0, total[LOW, k], total[HIGH, k]
            total[LOW, k] = above[j] if alone | (above[j] < low) else low
            total[HIGH, k] = above[j] if alone | (above[j] > high) else high
            add_point(total, k, above[j], local, slope, j, sigma_in[j], texture_in[j])
            sides = np.float32((np.int32(local[j, 2]) + 128) * (np.int32(local[j, 3]) + 128))
            total[INNER, k] += area * sides if inner else zero
            rim[k] = rim[k] if inner else np.uint8(RIM)
            deepest[k] = max(deepest[k], none if level_in[j] == LEVEL_NONE else level_in[j])  # none: one axis sufficed


@nb.njit(cache=True, nogil=True)
def _any_apart(low, high, gap):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    count = 0
    for n in range(low.size):
        count += high[n] - low[n] > gap
    return count > 0


@nb.njit(cache=True, nogil=True)
def _any_empty(points, cover):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    count = 0
    for n in range(points.size):
        count += (points[n] == 0) & (cover[n] >= HALF)
    return count > 0


@nb.njit(cache=True, nogil=True, inline="always")
def half_side(code, usual):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Half the side of a footprint, cells."""
    return (np.float32(code) + np.float32(128)) * np.float32(usual / CODE)


@nb.njit(cache=True, nogil=True)
def _cover(cover, row, column, local, usual):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add to `cover` the area of a footprint."""
    hx, hy = half_side(local[2], usual[0]), half_side(local[3], usual[1])
    x, y = local[0] / np.float32(OFFSET), local[1] / np.float32(OFFSET)
    for i in range(*cells_met(row, y, hy, len(cover))):
        high = overlap(row + y, hy, i)
        for j in range(*cells_met(column, x, hx, cover.shape[1])):
            cover[i, j] += high * overlap(column + x, hx, j)


@nb.njit(cache=True, nogil=True, inline="always")
def cells_met(at, off, half, count):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """First cell that a side of a footprint meets, and the one after the last."""
    low = at + np.int64(np.floor(off - half + HALF))
    high = at + np.int64(np.floor(off + half + HALF))
    return max(low, 0), min(high + 1, count)


@nb.njit(cache=True, nogil=True, inline="always")
def overlap(middle, half, n):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Length that middle +- half has within cell n, which is 1 long."""
    return max(min(middle + half, n + 0.5) - max(middle - half, n - 0.5), 0.0)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_point(total, n, above, local, slope, j, sigma, light):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add pixel j of a line to the sums of cell n."""
    w = np.float32(1) / (sigma * sigma)
    # squares are summed from the first height: heights are long numbers, their differences short ones
    begin = above if total[COUNT, n] == 0 else total[FIRST, n]
    off = above - begin
    total[FIRST, n] = begin
    total[WEIGHT, n] += w
    total[HEIGHT, n] += w * above
    total[SQUARE, n] += w * off * off
    total[ASIDE, n] += w * np.float32(local[j, 0])
    total[ALONG, n] += w * np.float32(local[j, 1])
    total[SLOPE_X, n] += w * np.float32(slope[j, 0])
    total[SLOPE_Y, n] += w * np.float32(slope[j, 1])
    total[COUNT, n] += np.float32(1)
    total[LIGHT, n] += np.float32(light)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _choose(laid, texture_in, gap, total, start, columns):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sum up anew the cells that hold two surfaces: only the one with more points, the upper one in a tie."""
    cell, above, sigma_in, local, slope, reach = laid
    size = total.shape[1]
    first, last = start // columns, (start + size) // columns
    upper = np.zeros(size, np.int32)  # points of the upper surface less those of the lower
    for turn in range(2):
        for i in range(len(cell)):
            if reach[i, 0] < last and reach[i, 1] >= first:
                for j in range(cell.shape[1]):
                    n = cell[i, j] - start
                    if 0 <= n < size and total[HIGH, n] - total[LOW, n] > gap:
                        high = 2 * above[i, j] > total[LOW, n] + total[HIGH, n]
                        if turn == 0:
                            upper[n] += 1 if high else -1
                        elif high == (upper[n] >= 0):
                            add_point(total, n, above[i, j], local[i], slope[i], j, sigma_in[i, j], texture_in[i, j])
        if turn == 0:
            for n in range(size):
                if total[HIGH, n] - total[LOW, n] > gap:
                    total[:LOW, n] = 0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _lend(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    laid, texture_in, level_in, usual, pitch, gap, spill, wide, total, cover, deepest, rim, first, last, columns
):
    """Give covered cells without points the mean of the planes that cover them, weighted by area, of one surface.

    Only pixels at a border lend, but where pixels are wider than two cells all do. In place of the sums: area, height,
    variance (`ASIDE`) and light.
    """
    cell, above, sigma_in, local, slope, reach = laid
    for i in range(len(cell)):
        if reach[i, 0] < last + spill and reach[i, 1] >= first - spill:
            for j in range(cell.shape[1]):
                if cell[i, j] < 0 or not (wide or sigma_in[i, j] < 0):
                    continue
                row = cell[i, j] // columns - first
                if not -spill <= row < last - first + spill:
                    continue
                column = cell[i, j] % columns
                hx, hy = half_side(local[i, j, 2], usual[0]), half_side(local[i, j, 3], usual[1])
                x, y = local[i, j, 0] / np.float32(OFFSET), local[i, j, 1] / np.float32(OFFSET)
                for a in range(*cells_met(row, y, hy, last - first)):
                    for b in range(*cells_met(column, x, hx, columns)):
                        n = a * columns + b
                        if total[COUNT, n] > 0 or cover[a, b] < HALF:
                            continue
                        area = np.float32(overlap(row + y, hy, a) * overlap(column + x, hx, b))
                        if not area > 0:
                            continue
                        right, up = np.float32(b - column - x), np.float32(a - row - y)
                        rise = slope[i, j, 0] * right + slope[i, j, 1] * up
                        here = above[i, j] + np.float32(pitch / FINE) * rise
                        if total[WEIGHT, n] > 0 and abs(total[HEIGHT, n] / total[WEIGHT, n] - here) > gap:
                            if total[WEIGHT, n] >= area:
                                continue
                            total[:LOW, n], deepest[n] = 0, 0
                        if not wide:
                            rim[n] = RIM
                        total[WEIGHT, n] += area
                        total[HEIGHT, n] += area * here
                        total[ASIDE, n] += area * sigma_in[i, j] * sigma_in[i, j]
                        total[LIGHT, n] += area * np.float32(texture_in[i, j])
                        if level_in[i, j] != LEVEL_NONE:
                            deepest[n] = max(deepest[n], level_in[i, j])
