"""Compiled loops of gridding: the sums of each cell, and how much of it is covered."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .lay_kernels import CODE, FINE, OFFSET, STEEPEST

__all__ = ["RIM", "STEEPEST", "drop_beyond", "fill"]

HALF = np.float32(0.5)  # of a cell's area must be covered
RIM = 64  # added to the level of a cell until it is mended, if a point of it lies at a border

# what is summed up of the points of a cell
WEIGHT, HEIGHT, ASIDE, ALONG, SLOPE_X, SLOPE_Y, SQUARE, COUNT, LIGHT, FIRST, LOW, HIGH, INNER = range(13)


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
    laid, texture_in, level_in, usual, pitch, shared, height, sigma, texture, level, first, last
):
    """Sum up the points of the cells of a band of rows.

    A pixel within a surface covers its own cell with all of its area, which its neighbours repay; one at a border
    covers what its footprint covers. Cells with points that are covered by less than half get a negative sigma: `mend`
    looks whether they lie at a border. Covered cells without a point get the planes of the pixels that cover them.
    """
    cell, above, sigma_in, local, slope, reach = laid
    columns = height.shape[1]
    start, size = first * columns, (last - first) * columns
    total = np.zeros((size, 13), np.float32)
    deepest, rim = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    for n in range(size):
        total[n, LOW], total[n, HIGH] = np.inf, -np.inf
    wide = max(usual[0], usual[1]) > 1
    spill = np.int64(np.ceil(4 * usual[1]))  # rows that the largest footprint reaches beyond its own
    cover = np.zeros((last - first, columns), np.float32)
    usual_area = np.float32(4 * usual[0] * usual[1] / (CODE * CODE))
    for i in range(len(cell)):
        if reach[i, 0] < last + spill and reach[i, 1] >= first - spill:
            for j in range(cell.shape[1]):
                n = cell[i, j] - start
                if not -spill * columns <= n < size + spill * columns or cell[i, j] < 0:
                    continue
                inner = sigma_in[i, j] > 0
                if wide or not inner:
                    _cover(cover, cell[i, j] // columns - first, cell[i, j] % columns, local[i, j], usual)
                if 0 <= n < size:
                    sums = total[n]
                    _add(sums, above[i, j], local[i, j], slope[i, j], sigma_in[i, j], texture_in[i, j])
                    sums[LOW], sums[HIGH] = min(sums[LOW], above[i, j]), max(sums[HIGH], above[i, j])
                    if inner:
                        sides = (np.int32(local[i, j, 2]) + 128) * (np.int32(local[i, j, 3]) + 128)
                        sums[INNER] += usual_area * np.float32(sides)
                    else:
                        rim[n] = RIM
                    if level_in[i, j] > deepest[n] and level_in[i, j] != LEVEL_NONE:  # else one axis was enough
                        deepest[n] = level_in[i, j]
    gap = np.float32(STEEPEST * pitch)
    two, empty = 0, 0
    for n in range(size):
        two += total[n, HIGH] - total[n, LOW] > gap
        empty += total[n, COUNT] == 0 and cover[n // columns, n % columns] >= HALF
    if two > 0:
        _choose(laid, texture_in, gap, total, start, columns)
    if empty > 0:
        _lend(
            laid, texture_in, level_in, usual, pitch, gap, spill, wide, total, cover, deepest, rim, first, last, columns
        )
    apart = np.float32(shared)
    nan, unit = np.float32(np.nan), np.float32(pitch / (OFFSET * FINE))
    one, zero, sampled = np.float32(1), np.float32(0), np.float32(1 / 12)
    for row in range(first, last):
        for column in range(columns):
            n = (row - first) * columns + column
            sums, count = total[n], total[n, COUNT]
            if not sums[WEIGHT] > 0:
                height[row, column], sigma[row, column] = nan, nan
                texture[row, column], level[row, column] = 0, LEVEL_NONE
                continue
            share = one / sums[WEIGHT]
            level[row, column] = deepest[n] + rim[n]
            if count == 0:  # lent
                height[row, column], sigma[row, column] = sums[HEIGHT] * share, np.sqrt(sums[ASIDE] * share)
                texture[row, column] = np.uint8(sums[LIGHT] * share)
                continue
            moved = sums[ASIDE] * sums[SLOPE_X] + sums[ALONG] * sums[SLOPE_Y]
            height[row, column] = sums[HEIGHT] * share - moved * (unit * share * share)
            worth = one + (np.sqrt(count) - one) / apart
            own = share * count
            seen, bent = _relief(sums, own, np.float32(pitch))
            unseen = max(one - sums[INNER], zero)
            spread = np.sqrt(own / (worth * worth) + seen * unseen * unseen + bent * sampled / count)
            area = cover[row - first, column] + (zero if wide else sums[INNER])
            sigma[row, column] = spread if area >= HALF else -spread
            texture[row, column] = np.uint8(sums[LIGHT] / count)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _relief(sums, noise, pitch):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Variance of the heights in a cell that noise does not explain, and what of it the cell's slope does not either.

    What lies in the part of a cell that is not seen is as far from its mean as what is seen. Where all of it is seen,
    each point stands for the middle of its share: the mean of n is off by 1 / sqrt(12 n) of what no slope explains.
    """
    share = np.float32(1) / sums[WEIGHT]
    mean = sums[HEIGHT] * share - sums[FIRST]
    slope = (sums[SLOPE_X] * sums[SLOPE_X] + sums[SLOPE_Y] * sums[SLOPE_Y]) * (share * share / np.float32(FINE * FINE))
    seen = max(sums[SQUARE] * share - mean * mean - noise, np.float32(0))
    return seen, max(seen - slope * pitch * pitch / np.float32(12), np.float32(0))


@nb.njit(cache=True, nogil=True, inline="always")
def _half(code, usual):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Half the side of a footprint, cells."""
    return (np.float32(code) + np.float32(128)) * np.float32(usual / CODE)


@nb.njit(cache=True, nogil=True)
def _cover(cover, row, column, local, usual):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add to `cover` the area of a footprint."""
    hx, hy = _half(local[2], usual[0]), _half(local[3], usual[1])
    x, y = local[0] / np.float32(OFFSET), local[1] / np.float32(OFFSET)
    for i in range(*_cells(row, y, hy, len(cover))):
        high = _overlap(row + y, hy, i)
        for j in range(*_cells(column, x, hx, cover.shape[1])):
            cover[i, j] += high * _overlap(column + x, hx, j)


@nb.njit(cache=True, nogil=True, inline="always")
def _cells(at, off, half, count):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """First cell that a side of a footprint meets, and the one after the last."""
    low = at + np.int64(np.floor(off - half + HALF))
    high = at + np.int64(np.floor(off + half + HALF))
    return max(low, 0), min(high + 1, count)


@nb.njit(cache=True, nogil=True, inline="always")
def _overlap(middle, half, n):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Length that middle +- half has within cell n, which is 1 long."""
    return max(min(middle + half, n + 0.5) - max(middle - half, n - 0.5), 0.0)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add(total, above, local, slope, sigma, light):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    w = np.float32(1) / (sigma * sigma)
    total[WEIGHT] += w
    if total[COUNT] == 0:
        total[FIRST] = above  # squares are summed from here: heights are long numbers, their differences short ones
    off = above - total[FIRST]
    total[HEIGHT] += w * above
    total[SQUARE] += w * off * off
    total[ASIDE] += w * np.float32(local[0])
    total[ALONG] += w * np.float32(local[1])
    total[SLOPE_X] += w * np.float32(slope[0])
    total[SLOPE_Y] += w * np.float32(slope[1])
    total[COUNT] += np.float32(1)
    total[LIGHT] += np.float32(light)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _choose(laid, texture_in, gap, total, start, columns):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sum up anew the cells that hold two surfaces: only the one with more points, the upper one in a tie."""
    cell, above, sigma_in, local, slope, reach = laid
    size = len(total)
    first, last = start // columns, (start + size) // columns
    upper = np.zeros(size, np.int32)  # points of the upper surface less those of the lower
    for turn in range(2):
        for i in range(len(cell)):
            if reach[i, 0] < last and reach[i, 1] >= first:
                for j in range(cell.shape[1]):
                    n = cell[i, j] - start
                    if 0 <= n < size and total[n, HIGH] - total[n, LOW] > gap:
                        high = 2 * above[i, j] > total[n, LOW] + total[n, HIGH]
                        if turn == 0:
                            upper[n] += 1 if high else -1
                        elif high == (upper[n] >= 0):
                            _add(total[n], above[i, j], local[i, j], slope[i, j], sigma_in[i, j], texture_in[i, j])
        if turn == 0:
            for n in range(size):
                if total[n, HIGH] - total[n, LOW] > gap:
                    total[n, :LOW] = 0


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
                hx, hy = _half(local[i, j, 2], usual[0]), _half(local[i, j, 3], usual[1])
                x, y = local[i, j, 0] / np.float32(OFFSET), local[i, j, 1] / np.float32(OFFSET)
                for a in range(*_cells(row, y, hy, last - first)):
                    for b in range(*_cells(column, x, hx, columns)):
                        n = a * columns + b
                        if total[n, COUNT] > 0 or cover[a, b] < HALF:
                            continue
                        area = np.float32(_overlap(row + y, hy, a) * _overlap(column + x, hx, b))
                        if not area > 0:
                            continue
                        right, up = np.float32(b - column - x), np.float32(a - row - y)
                        rise = slope[i, j, 0] * right + slope[i, j, 1] * up
                        here = above[i, j] + np.float32(pitch / FINE) * rise
                        if total[n, WEIGHT] > 0 and abs(total[n, HEIGHT] / total[n, WEIGHT] - here) > gap:
                            if total[n, WEIGHT] >= area:
                                continue
                            total[n, :LOW], deepest[n] = 0, 0
                        if not wide:
                            rim[n] = RIM
                        total[n, WEIGHT] += area
                        total[n, HEIGHT] += area * here
                        total[n, ASIDE] += area * sigma_in[i, j] * sigma_in[i, j]
                        total[n, LIGHT] += area * np.float32(texture_in[i, j])
                        if level_in[i, j] != LEVEL_NONE:
                            deepest[n] = max(deepest[n], level_in[i, j])
