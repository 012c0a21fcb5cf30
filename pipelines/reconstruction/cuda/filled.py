"""Cells on the card: the points of each cell in the order of the image, summed up as the CPU does; then mended."""

from __future__ import annotations

import numpy as np
from numba import cuda, float32, int64

from ...grid import Grid
from ...scan import LEVEL_NONE
from ..cell_kernels import (
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
)
from ..grid_kernels import STEEPEST, add_point, cells_met, half_side, overlap
from ..lay_kernels import CODE, FINE, OFFSET
from ..mend_kernels import amid, dense, enclosed
from ..surface import Sharing
from .card import OnCard, clear, empty, kernel, launch
from .laid import LaidOnCard

__all__ = ["fill_cells"]

CHUNK = 64  # cells whose lists are given room at once
PARTS = 13  # sums of a cell


def fill_cells(
    laid: LaidOnCard, texture: OnCard, level: OnCard, grid: Grid, usual: tuple[float, float], sharing: Sharing
) -> tuple[OnCard, OnCard, OnCard, OnCard]:
    """As `surface.fill_cells`.

    A thread per cell needs to know its pixels: those that lie in it, and those that cover a part of it. Both are
    counted, given room, noted by whichever thread comes first, and put in the order of the image, in which the CPU
    meets them: sums of single precision depend on it.
    """
    size, cells = laid.cell.size, grid.rows * grid.columns
    wide = max(usual) > 1
    own, cover = _lists(laid, size, cells, grid, usual, wide)
    rows = grid.rows + 2  # nothing is measured beyond the grid
    height, sigma = (empty((rows, grid.columns), np.float32) for _ in range(2))
    light, deepest = (empty((rows, grid.columns), np.uint8) for _ in range(2))
    launch(
        _fill, rows * grid.columns, *own, *cover,
        *_flat(laid, size), texture.reshape(size), level.reshape(size), usual, grid.pitch_mm, tuple(sharing), wide,
        height, sigma, light, deepest,
    )  # fmt: skip
    out = (
        empty(grid.shape, np.float32), empty(grid.shape, np.float32),
        empty(grid.shape, np.uint8), empty(grid.shape, np.uint8),
    )  # fmt: skip
    padded = rows * grid.columns
    launch(
        _mend, cells, height.reshape(padded), sigma.reshape(padded), light.reshape(padded), deepest.reshape(padded),
        np.float32(STEEPEST * grid.pitch_mm), *out,
    )  # fmt: skip
    return out


def _flat(laid: LaidOnCard, size: int) -> tuple[OnCard, ...]:
    return (
        laid.cell.reshape(size), laid.above.reshape(size), laid.sigma.reshape(size),
        laid.local.reshape(size, 4), laid.slope.reshape(size, 2),
    )  # fmt: skip


def _lists(
    laid: LaidOnCard, size: int, cells: int, grid: Grid, usual: tuple[float, float], wide: bool
) -> tuple[tuple[OnCard, OnCard, OnCard], tuple[OnCard, OnCard, OnCard]]:
    """For own and for covering pixels: where each cell's list begins and ends, and the lists."""
    flat = _flat(laid, size)
    ends = clear(cells, np.int32), clear(cells, np.int32)
    launch(_count, size, flat[0], flat[2], flat[3], usual, grid.shape, wide, *ends)
    tops, begins = clear(2, np.int32), (empty(cells, np.int32), empty(cells, np.int32))
    for n in range(2):
        launch(_allot, -(-cells // CHUNK), ends[n], begins[n], tops, n)
    lists = [empty(max(1, int(top)), np.int32) for top in tops.copy_to_host()]
    launch(_note, size, flat[0], flat[2], flat[3], usual, grid.shape, wide, *ends, *lists)
    for n in range(2):
        launch(_sort, cells, begins[n], ends[n], lists[n])
    return (begins[0], ends[0], lists[0]), (begins[1], ends[1], lists[1])


@kernel
def _count(cell, sigma, local, usual, shape, wide, own, cover):  # type: ignore[no-untyped-def]  # a kernel
    for p in range(cuda.grid(1), cell.size, cuda.gridsize(1)):
        at = cell[p]
        if at < 0:
            continue
        cuda.atomic.add(own, at, 1)
        if wide or not sigma[p] > 0:
            hx, hy = half_side(local[p, 2], usual[0]), half_side(local[p, 3], usual[1])
            x, y = local[p, 0] / np.float32(OFFSET), local[p, 1] / np.float32(OFFSET)
            top, bottom = cells_met(at // shape[1], y, hy, shape[0])
            left, right = cells_met(at % shape[1], x, hx, shape[1])
            for i in range(top, bottom):
                for j in range(left, right):
                    cuda.atomic.add(cover, i * shape[1] + j, 1)


@kernel
def _allot(ends, begins, tops, which):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Give each cell room for as many as were counted; `ends` are set to where it begins, and move as it is filled."""
    for chunk in range(cuda.grid(1), (ends.size + CHUNK - 1) // CHUNK, cuda.gridsize(1)):
        first, last = chunk * CHUNK, min((chunk + 1) * CHUNK, ends.size)
        total = 0
        for n in range(first, last):
            total += ends[n]
        place = cuda.atomic.add(tops, which, total)
        for n in range(first, last):
            count = ends[n]
            begins[n] = place
            ends[n] = place
            place += count


@kernel
def _note(cell, sigma, local, usual, shape, wide, own, cover, owned, covering):  # type: ignore[no-untyped-def]  # a kernel
    for p in range(cuda.grid(1), cell.size, cuda.gridsize(1)):
        at = cell[p]
        if at < 0:
            continue
        owned[cuda.atomic.add(own, at, 1)] = p
        if wide or not sigma[p] > 0:
            hx, hy = half_side(local[p, 2], usual[0]), half_side(local[p, 3], usual[1])
            x, y = local[p, 0] / np.float32(OFFSET), local[p, 1] / np.float32(OFFSET)
            top, bottom = cells_met(at // shape[1], y, hy, shape[0])
            left, right = cells_met(at % shape[1], x, hx, shape[1])
            for i in range(top, bottom):
                for j in range(left, right):
                    covering[cuda.atomic.add(cover, i * shape[1] + j, 1)] = p


@kernel
def _sort(begins, ends, pixels):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sort each list (Shell's way: most have one pixel or two, those of a coarse grid thousands)."""
    for n in range(cuda.grid(1), begins.size, cuda.gridsize(1)):
        first, last = begins[n], ends[n]
        gap = 1
        while 3 * gap < last - first:
            gap = 3 * gap + 1
        while gap > 0:
            for k in range(first + gap, last):
                pixel, place = pixels[k], k
                while place - gap >= first and pixels[place - gap] > pixel:
                    pixels[place] = pixels[place - gap]
                    place -= gap
                pixels[place] = pixel
            gap //= 3


@kernel
def _fill(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    begins, ends, owned, cover_begins, cover_ends, covering,
    cell, above, sigma_in, local, slope, texture_in, level_in, usual, pitch, sharing, wide,
    height, sigma, texture, level,
):  # fmt: skip
    """As `grid_kernels.fill` and `cell_kernels.conclude`, into arrays with a row more at either end."""
    rows, columns = height.shape[0] - 2, height.shape[1]
    nan, unit = np.float32(np.nan), np.float32(pitch / (OFFSET * FINE))
    one, zero, sampled = np.float32(1), np.float32(0), np.float32(1 / 12)
    usual_area = np.float32(4 * usual[0] * usual[1] / (CODE * CODE))
    gap = np.float32(STEEPEST * pitch)
    apart, within = np.float32(sharing[0]), np.float32(sharing[1])
    beside, left = np.float32(sharing[2]), np.float32(sharing[3])
    for n in range(cuda.grid(1), height.size, cuda.gridsize(1)):
        row, column = n // columns - 1, n % columns
        if not 0 <= row < rows:
            height[row + 1, column], sigma[row + 1, column] = nan, nan
            texture[row + 1, column], level[row + 1, column] = 0, LEVEL_NONE
            continue
        at = row * columns + column
        sums = cuda.local.array((PARTS, 1), float32)  # as `add_point` takes them: a column per cell
        for part in range(PARTS):
            sums[part, 0] = zero
        sums[LOW, 0], sums[HIGH, 0] = np.float32(np.inf), np.float32(-np.inf)
        deepest, rim = 0, 0
        for k in range(begins[at], ends[at]):
            p = owned[k]
            add_point(sums, 0, above[p], local, slope, p, sigma_in[p], texture_in[p])
            sums[LOW, 0], sums[HIGH, 0] = min(sums[LOW, 0], above[p]), max(sums[HIGH, 0], above[p])
            if sigma_in[p] > 0:
                sides = (np.int32(local[p, 2]) + 128) * (np.int32(local[p, 3]) + 128)
                sums[INNER, 0] += usual_area * np.float32(sides)
            else:
                rim = RIM
            if level_in[p] > deepest and level_in[p] != LEVEL_NONE:  # else one axis was enough
                deepest = level_in[p]
        area = zero
        for k in range(cover_begins[at], cover_ends[at]):
            high, broad = _share(covering[k], cell, local, usual, columns, row, column)
            area = np.float32(np.float64(area) + high * broad)  # in double precision, as it is compiled
        if sums[HIGH, 0] - sums[LOW, 0] > gap:
            _choose(sums, begins[at], ends[at], owned, above, local, slope, sigma_in, texture_in)
        if sums[COUNT, 0] == 0 and area >= HALF:
            for k in range(cover_begins[at], cover_ends[at]):
                p = covering[k]
                high, broad = _share(p, cell, local, usual, columns, row, column)
                lent = np.float32(high * broad)
                if not lent > 0:
                    continue
                x, y = local[p, 0] / np.float32(OFFSET), local[p, 1] / np.float32(OFFSET)
                right = np.float32(column - cell[p] % columns - x)
                up = np.float32(row - cell[p] // columns - y)
                here = above[p] + np.float32(pitch / FINE) * (slope[p, 0] * right + slope[p, 1] * up)
                if sums[WEIGHT, 0] > 0 and abs(sums[HEIGHT, 0] / sums[WEIGHT, 0] - here) > gap:
                    if sums[WEIGHT, 0] >= lent:
                        continue
                    for each in range(LOW):
                        sums[each, 0] = zero
                    deepest = 0
                if not wide:
                    rim = RIM
                sums[WEIGHT, 0] += lent
                sums[HEIGHT, 0] += lent * here
                sums[ASIDE, 0] += lent * sigma_in[p] * sigma_in[p]
                sums[LIGHT, 0] += lent * np.float32(texture_in[p])
                if level_in[p] != LEVEL_NONE:
                    deepest = max(deepest, level_in[p])
        if not sums[WEIGHT, 0] > 0:
            height[row + 1, column], sigma[row + 1, column] = nan, nan
            texture[row + 1, column], level[row + 1, column] = 0, LEVEL_NONE
            continue
        count, share = sums[COUNT, 0], one / sums[WEIGHT, 0]
        level[row + 1, column] = np.uint8(deepest + rim)
        if count == 0:  # lent
            height[row + 1, column] = sums[HEIGHT, 0] * share
            sigma[row + 1, column] = np.sqrt(sums[ASIDE, 0] * share + beside)
            texture[row + 1, column] = np.uint8(sums[LIGHT, 0] * share)
            continue
        moved = sums[ASIDE, 0] * sums[SLOPE_X, 0] + sums[ALONG, 0] * sums[SLOPE_Y, 0]
        height[row + 1, column] = sums[HEIGHT, 0] * share - moved * (unit * share * share)
        worth = one + (np.sqrt(count) - one) / apart
        part = one / (worth * worth)
        own = share * count
        mean = sums[HEIGHT, 0] * share - sums[FIRST, 0]
        steep = sums[SLOPE_X, 0] * sums[SLOPE_X, 0] + sums[SLOPE_Y, 0] * sums[SLOPE_Y, 0]
        steep *= share * share / np.float32(FINE * FINE)
        seen = max(sums[SQUARE, 0] * share - mean * mean - own, zero)
        bent = max(seen - steep * np.float32(pitch) * np.float32(pitch) / np.float32(12), zero)
        unseen = max(one - sums[INNER, 0], zero)
        decoded = own * part + min(own, within) * max(left - part, zero) + beside * left
        spread = np.sqrt(decoded + seen * unseen * unseen + bent * sampled / count)
        area = np.float32(area + (zero if wide else sums[INNER, 0]))
        sigma[row + 1, column] = spread if area >= HALF else -spread
        texture[row + 1, column] = np.uint8(sums[LIGHT, 0] / count)


@cuda.jit(device=True)
def _share(p, cell, local, usual, columns, row, column):  # type: ignore[no-untyped-def]  # numba infers the types
    """Lengths along y and x that the footprint of a pixel has within a cell."""
    hx, hy = half_side(local[p, 2], usual[0]), half_side(local[p, 3], usual[1])
    x, y = local[p, 0] / np.float32(OFFSET), local[p, 1] / np.float32(OFFSET)
    return overlap(cell[p] // columns + y, hy, row), overlap(cell[p] % columns + x, hx, column)


@cuda.jit(device=True)
def _choose(sums, begin, end, owned, above, local, slope, sigma, texture):  # type: ignore[no-untyped-def]  # numba infers
    """As `grid_kernels._choose`, of one cell."""
    upper = 0
    for k in range(begin, end):
        upper += 1 if 2 * above[owned[k]] > sums[LOW, 0] + sums[HIGH, 0] else -1
    for part in range(LOW):
        sums[part, 0] = np.float32(0)
    for k in range(begin, end):
        p = owned[k]
        if (2 * above[p] > sums[LOW, 0] + sums[HIGH, 0]) == (upper >= 0):
            add_point(sums, 0, above[p], local, slope, p, sigma[p], texture[p])


@cuda.jit(device=True)
def _between(levels, beside):  # type: ignore[no-untyped-def]  # numba infers the types
    """Whether no pixel is missing between two opposite neighbours."""
    found = False
    for k in range(4):
        found |= dense(levels[beside[k]], levels[beside[7 - k]])
    return found


@kernel
def _mend(heights, sigmas, lights, levels, gap, height, sigma, texture, level):  # type: ignore[no-untyped-def]  # a kernel
    """As `mend_kernels.mend`, from what was filled into new arrays."""
    columns = height.shape[1]
    for n in range(cuda.grid(1), height.size, cuda.gridsize(1)):
        row, column = n // columns, n % columns
        here = (row + 1) * columns + column  # the filled arrays have a row more before the first
        spread = sigmas[here]
        height[row, column], sigma[row, column] = heights[here], spread
        texture[row, column], level[row, column] = lights[here], levels[here]
        if spread > 0:
            level[row, column] = levels[here] & (RIM - 1)
            continue
        inside = 0 < column < columns - 1
        beside = cuda.local.array(8, int64)  # the n-th and the last but n are opposite
        for k in range(3):
            beside[k], beside[7 - k] = here - columns - 1 + k, here + columns + 1 - k
        beside[3], beside[4] = here - 1, here + 1
        if spread < 0:
            if inside and enclosed(sigmas, beside, 0):  # few points, but all around
                sigma[row, column], level[row, column] = -spread, levels[here] & (RIM - 1)
            else:
                height[row, column], sigma[row, column] = np.float32(np.nan), np.float32(np.nan)
                texture[row, column], level[row, column] = 0, LEVEL_NONE
        elif inside:
            least, opposite = RIM, True
            if not _between(levels, beside):
                if enclosed(sigmas, beside, 0):
                    least = LEVEL_NONE
                elif amid(levels, beside, 0):
                    opposite = False
                else:
                    continue
            total, worst, light, highest, count = np.float32(0), np.float32(0), 0, 0, 0
            for k in range(4 if opposite else 8):
                i = beside[k]
                j = beside[7 - k] if opposite else i  # no two lie opposite: each counts by itself
                u, v = int(levels[i]), int(levels[j])
                if abs(heights[i] - heights[j]) <= gap and min(u, v) < least:  # false where either is NaN
                    total += heights[i] + heights[j]
                    worst = max(worst, abs(sigmas[i]), abs(sigmas[j]))
                    light += int(lights[i]) + int(lights[j])
                    highest = max(highest, u % RIM, v % RIM)
                    count += 2
            if count > 0:
                height[row, column], sigma[row, column] = total / np.float32(count), worst
                texture[row, column], level[row, column] = np.uint8(light // count), np.uint8(highest)
