"""Compiled loops that mend a filled grid: cells at a border that are hardly covered, cells between points, holes."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .apart import read, write
from .cell_kernels import RIM

__all__ = ["amid", "dense", "enclosed", "mend"]

BLOCK = 256  # cells that are looked at at once
HOLE = 6  # of the eight cells around a hole are measured


@nb.njit(cache=True, nogil=True)
def mend(height, sigma, texture, level, rims, gap, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Drop cells at a border that are covered by less than half; fill cells that lie between points of one surface.

    An empty cell does so if it is a single hole, or if the cells beside it hold points all of whose neighbours in the
    image are on the same surface: then no pixel is missing between them, but the pitch is finer than the pixels.

    `rims` holds rows `first` - 1 and `last` of the four arrays as `fill` left them: others may mend them meanwhile.
    """
    columns = height.shape[1]
    size = 3 * columns  # rows before, here and after as `fill` left them, in turn
    heights, sigmas = np.empty(size, np.float32), np.empty(size, np.float32)
    lights, levels = np.empty(size, np.uint8), np.empty(size, np.uint8)
    odd = np.empty(columns, np.uint8)  # of each cell: 1 where it needs a closer look, 2 where it is mended
    beside = np.empty(8, np.int64)  # where the neighbours lie; the n-th and the last but n are opposite
    for row in range(first - 1, last + 1):
        here = row % 3 * columns
        if row < first or row == last:
            side = 0 if row < first else 1
            _keep(heights, sigmas, lights, levels, here, rims[0][side], rims[1][side], rims[2][side], rims[3][side])
        else:
            _keep(heights, sigmas, lights, levels, here, height[row], sigma[row], texture[row], level[row])
        k = row - 1
        if k < first:
            continue
        before, middle, after = (k - 1) % 3 * columns, k % 3 * columns, here
        out = height[k], sigma[k], texture[k], level[k]
        _look(sigmas[middle : middle + columns], levels[middle : middle + columns], level[k], odd)
        for at in range(0, columns - 2, BLOCK):
            end = min(at + BLOCK + 2, columns)
            if _any_empty(sigmas[middle + at + 1 : middle + end - 1]):
                _mend_block(
                    heights, sigmas, lights, levels, before + at, middle + at, after + at, gap,
                    height[k, at:end], sigma[k, at:end], texture[k, at:end], level[k, at:end], odd[at:end],
                )  # fmt: skip
        for n in range(3):
            beside[n], beside[7 - n] = before - 1 + n, after + 1 - n
        beside[3], beside[4] = middle - 1, middle + 1
        for column in range(columns):
            if odd[column] == 1:
                _mend_cell(heights, sigmas, lights, levels, beside, middle, column, gap, out)


@nb.njit(cache=True, nogil=True)
def _look(sigmas, levels, level, odd):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Take the mark of the border off the level of cells that stay as they are; say which are hardly covered."""
    inner = np.uint8(RIM - 1)
    for n in range(level.size):
        low, spread = read(levels, n), read(sigmas, n)
        lower = np.uint8(low & inner)
        write(level, n, lower if spread > 0 else low)
        write(odd, n, np.uint8(spread < 0))


@nb.njit(cache=True, nogil=True)
def _any_empty(sigmas):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    count = 0
    for n in range(sigmas.size):
        count += sigmas[n] != sigmas[n]
    return count > 0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _mend_block(heights, sigmas, lights, levels, before, middle, after, gap, height, sigma, texture, level, odd):  # type: ignore[no-untyped-def]  # a kernel
    """Fill the inner cells of a part of a row that lie between points of one surface; `odd` says which.

    Without a branch, so that the compiler uses vector instructions.
    """
    inner, filled = np.uint8(RIM - 1), np.uint8(2)
    zero, two, four = np.float32(0), np.float32(2), np.int32(4)
    # more loops than one: what is written the compiler compares each with each, and gives up at five arrays
    for n in range(height.size - 2):
        b, m, a = before + n, middle + n, after + n
        u1, v1 = read(levels, b), read(levels, a + 2)
        u2, v2 = read(levels, b + 1), read(levels, a + 1)
        u3, v3 = read(levels, b + 2), read(levels, a)
        u4, v4 = read(levels, m), read(levels, m + 2)
        s1 = _alike(read(heights, b), read(heights, a + 2), u1, v1, gap)
        s2 = _alike(read(heights, b + 1), read(heights, a + 1), u2, v2, gap)
        s3 = _alike(read(heights, b + 2), read(heights, a), u3, v3, gap)
        s4 = _alike(read(heights, m), read(heights, m + 2), u4, v4, gap)
        low, spread = read(levels, m + 1), read(sigmas, m + 1)
        between = dense(u1, v1) | dense(u2, v2) | dense(u3, v3) | dense(u4, v4)
        found = _known(u1, v1) + _known(u2, v2) + _known(u3, v3) + _known(u4, v4)
        unclear = (spread < zero) | ((spread != spread) & (not between) & (found >= four))
        mended = (spread != spread) & between & (s1 | s2 | s3 | s4)
        h1, h2, h3, h4 = _higher(u1, v1, s1), _higher(u2, v2, s2), _higher(u3, v3, s3), _higher(u4, v4, s4)
        highest, lower = max(max(h1, h2), max(h3, h4)), np.uint8(low & inner) if spread > zero else low
        write(level, n + 1, highest if mended else lower)
        write(odd, n + 1, filled if mended else np.uint8(unclear))
    for n in range(height.size - 2):
        b, m, a = before + n, middle + n, after + n
        p1, q1, u1, v1 = read(heights, b), read(heights, a + 2), read(levels, b), read(levels, a + 2)
        s1 = _alike(p1, q1, u1, v1, gap)
        t1, c1 = p1 + q1 if s1 else zero, two if s1 else zero
        w1 = max(abs(read(sigmas, b)), abs(read(sigmas, a + 2))) if s1 else zero
        g1 = np.float32(read(lights, b)) + np.float32(read(lights, a + 2)) if s1 else zero
        p2, q2, u2, v2 = read(heights, b + 1), read(heights, a + 1), read(levels, b + 1), read(levels, a + 1)
        s2 = _alike(p2, q2, u2, v2, gap)
        t2, c2 = p2 + q2 if s2 else zero, two if s2 else zero
        w2 = max(abs(read(sigmas, b + 1)), abs(read(sigmas, a + 1))) if s2 else zero
        g2 = np.float32(read(lights, b + 1)) + np.float32(read(lights, a + 1)) if s2 else zero
        p3, q3, u3, v3 = read(heights, b + 2), read(heights, a), read(levels, b + 2), read(levels, a)
        s3 = _alike(p3, q3, u3, v3, gap)
        t3, c3 = p3 + q3 if s3 else zero, two if s3 else zero
        w3 = max(abs(read(sigmas, b + 2)), abs(read(sigmas, a))) if s3 else zero
        g3 = np.float32(read(lights, b + 2)) + np.float32(read(lights, a)) if s3 else zero
        p4, q4, u4, v4 = read(heights, m), read(heights, m + 2), read(levels, m), read(levels, m + 2)
        s4 = _alike(p4, q4, u4, v4, gap)
        t4, c4 = p4 + q4 if s4 else zero, two if s4 else zero
        w4 = max(abs(read(sigmas, m)), abs(read(sigmas, m + 2))) if s4 else zero
        g4 = np.float32(read(lights, m)) + np.float32(read(lights, m + 2)) if s4 else zero
        own, spread, light_here = read(heights, m + 1), read(sigmas, m + 1), read(lights, m + 1)
        count, worst = c1 + c2 + c3 + c4, max(max(w1, w2), max(w3, w4))
        mean, light = (t1 + t2 + t3 + t4) / count, (g1 + g2 + g3 + g4) / count
        mended = read(odd, n + 1) == filled
        shown = np.int32(light if mended else zero)
        write(height, n + 1, mean if mended else own)
        write(sigma, n + 1, worst if mended else spread)
        write(texture, n + 1, np.uint8(shown) if mended else light_here)


@nb.njit(cache=True, nogil=True, inline="always")
def _alike(p, q, u, v, gap):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether two neighbours are of one surface, and one of them has no point at a border; false where one is NaN."""
    return (abs(p - q) <= gap) & (min(u, v) < np.uint8(RIM))


@nb.njit(cache=True, nogil=True, inline="always")
def dense(u, v):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether no pixel is missing between two opposite neighbours, and the pitch is just finer than the pixels.

    One has no point at a border, and the other is measured.
    """
    return (min(u, v) < np.uint8(RIM)) & (max(u, v) < np.uint8(LEVEL_NONE))


@nb.njit(cache=True, nogil=True, inline="always")
def _known(u, v):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """How many of two neighbours are measured."""
    return np.int32(u != np.uint8(LEVEL_NONE)) + np.int32(v != np.uint8(LEVEL_NONE))


@nb.njit(cache=True, nogil=True, inline="always")
def _higher(u, v, alike):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The coarser level of two neighbours of one surface."""
    inner = np.uint8(RIM - 1)
    higher = max(np.uint8(u & inner), np.uint8(v & inner))
    return higher if alike else np.uint8(0)


@nb.njit(cache=True, nogil=True)
def _mend_cell(heights, sigmas, lights, levels, beside, middle, column, gap, out):  # type: ignore[no-untyped-def]  # a kernel
    """Mend a cell that is hardly covered, or empty and not plainly between points of one surface."""
    height, sigma, texture, level = out
    spread = sigmas[middle + column]
    inside = 0 < column < height.size - 1
    if spread < 0:
        if inside and enclosed(sigmas, beside, column):  # few points, but all around
            sigma[column], level[column] = -spread, levels[middle + column] & (RIM - 1)
        else:
            height[column], sigma[column] = np.nan, np.nan
            texture[column], level[column] = 0, LEVEL_NONE
        return
    hole = enclosed(sigmas, beside, column)
    if not hole and not amid(levels, beside, column):
        return
    total, worst, light, highest, count = np.float32(0), np.float32(0), 0, 0, 0
    for n in range(4 if hole else 8):
        i = beside[n] + column
        j = beside[7 - n] + column if hole else i  # no two lie opposite: each counts by itself
        u, v = int(levels[i]), int(levels[j])
        if abs(heights[i] - heights[j]) <= gap and min(u, v) < (LEVEL_NONE if hole else RIM):  # false for NaN
            total += heights[i] + heights[j]
            worst = max(worst, abs(sigmas[i]), abs(sigmas[j]))
            light += int(lights[i]) + int(lights[j])
            highest = max(highest, u % RIM, v % RIM)
            count += 2
    if count > 0:
        height[column], sigma[column] = total / np.float32(count), worst
        texture[column], level[column] = light // count, highest


@nb.njit(cache=True, nogil=True)
def _keep(heights, sigmas, lights, levels, at, height, sigma, light, level):  # type: ignore[no-untyped-def]  # a kernel
    end = at + height.size
    one, two, three, four = heights[at:end], sigmas[at:end], lights[at:end], levels[at:end]
    for k in range(height.size):
        write(one, k, read(height, k))
        write(two, k, read(sigma, k))
    for k in range(height.size):
        write(three, k, read(light, k))
        write(four, k, read(level, k))


@nb.njit(cache=True, nogil=True, inline="always")
def enclosed(sigmas, beside, column):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether at least `HOLE` of the eight neighbours are measured, and the others lie side by side.

    Where they do not, a line of empty cells may pass: a crack.
    """
    found, ends = 0, 0
    before = sigmas[beside[3] + column]
    for n in (0, 1, 2, 4, 7, 6, 5, 3):  # once around
        value = sigmas[beside[n] + column]
        found += value == value
        ends += before == before and value != value
        before = value
    return found >= HOLE and ends <= 1


@nb.njit(cache=True, nogil=True, inline="always")
def amid(levels, beside, column):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether half of the neighbours are measured, none of them with a point at a border."""
    found, rim = 0, 0
    for n in range(8):
        found += levels[beside[n] + column] < RIM
        rim += (levels[beside[n] + column] >= RIM) & (levels[beside[n] + column] < LEVEL_NONE)
    return found >= 4 and rim == 0
