"""Compiled loops that mend a filled grid: cells at a border that are hardly covered, cells between points, holes."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .grid_kernels import RIM

__all__ = ["mend"]

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
        for n in range(3):
            beside[n], beside[7 - n] = before - 1 + n, after + 1 - n
        beside[3], beside[4] = middle - 1, middle + 1
        for column in range(columns):
            spread = sigmas[middle + column]
            if spread > 0:
                level[k, column] = levels[middle + column] & (RIM - 1)
                continue
            inside = 0 < column < columns - 1
            if spread < 0:
                if inside and _enclosed(sigmas, beside, column):  # few points, but all around
                    sigma[k, column], level[k, column] = -spread, levels[middle + column] & (RIM - 1)
                else:
                    height[k, column], sigma[k, column] = np.nan, np.nan
                    texture[k, column], level[k, column] = 0, LEVEL_NONE
            elif inside:
                least, opposite = RIM, True
                if not _between(levels, beside, column):
                    if _enclosed(sigmas, beside, column):
                        least = LEVEL_NONE
                    elif _amid(levels, beside, column):
                        opposite = False
                    else:
                        continue
                total, worst, light, highest, count = np.float32(0), np.float32(0), 0, 0, 0
                for n in range(4 if opposite else 8):
                    i = beside[n] + column
                    j = beside[7 - n] + column if opposite else i  # no two lie opposite: each counts by itself
                    u, v = int(levels[i]), int(levels[j])
                    if abs(heights[i] - heights[j]) <= gap and min(u, v) < least:  # false where either is NaN
                        total += heights[i] + heights[j]
                        worst = max(worst, abs(sigmas[i]), abs(sigmas[j]))
                        light += int(lights[i]) + int(lights[j])
                        highest = max(highest, u % RIM, v % RIM)
                        count += 2
                if count > 0:
                    height[k, column], sigma[k, column] = total / np.float32(count), worst
                    texture[k, column], level[k, column] = light // count, highest


@nb.njit(cache=True, nogil=True)
def _keep(heights, sigmas, lights, levels, at, height, sigma, light, level):  # type: ignore[no-untyped-def]  # a kernel
    for k in range(height.size):
        heights[at + k], sigmas[at + k] = height[k], sigma[k]
    for k in range(height.size):
        lights[at + k], levels[at + k] = light[k], level[k]


@nb.njit(cache=True, nogil=True, inline="always")
def _enclosed(sigmas, beside, column):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
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
def _between(levels, beside, column):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether no pixel is missing here, and the pitch is just finer than the pixels.

    One of two opposite neighbours has no point at a border, and the other is measured.
    """
    found = False
    for n in range(4):
        u, v = levels[beside[n] + column], levels[beside[7 - n] + column]
        found |= (min(u, v) < RIM) & (max(u, v) < LEVEL_NONE)
    return found


@nb.njit(cache=True, nogil=True, inline="always")
def _amid(levels, beside, column):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether half of the neighbours are measured, none of them with a point at a border."""
    found, rim = 0, 0
    for n in range(8):
        found += levels[beside[n] + column] < RIM
        rim += (levels[beside[n] + column] >= RIM) & (levels[beside[n] + column] < LEVEL_NONE)
    return found >= 4 and rim == 0
