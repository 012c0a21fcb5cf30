"""Compiled loops of gridding: what each point says of its cell, the sums of each cell, and single gaps."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE

__all__ = ["STEEPEST", "bridge", "fill", "lay"]

FINE = 8192.0  # slopes are kept in steps of 1 / FINE
STEEPEST = 3.0  # two points of one cell further apart in height than this many cells are two surfaces


@nb.njit(cache=True, nogil=True, error_model="numpy")
def lay(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    xyz, keep, farthest, M, place, shape, cell, above, offset, slope, reach, first, last
):
    """Say of each pixel its cell, height, offset from the cell's centre (1/254 cell) and slope (1/`FINE`).

    The slope is that of the plane through the differences to the pixel's neighbours on the same surface, along the row
    and down the column of the image; to one side where the other side is another surface.
    """
    rows, columns = shape
    x0, y0, pitch = place
    H, W = keep.shape
    nan = np.float32(np.nan)
    lines = np.full((3, W + 2, 3), nan, np.float32)  # rows i-1, i, i+1 in the site frame, NaN where not kept
    for i in range(first - 1, last + 1):
        line = lines[(i + 1) % 3]
        if 0 <= i < H:
            for j in range(W):
                x, y, z = xyz[i, j, 0], xyz[i, j, 1], xyz[i, j, 2]
                if keep[i, j] and z <= farthest:
                    line[j + 1, 0] = M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3]
                    line[j + 1, 1] = M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3]
                    line[j + 1, 2] = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3]
                else:
                    line[j + 1, 2] = nan
        else:
            line[:, 2] = nan
        k = i - 1
        if k < first:
            continue
        before, here, after = lines[k % 3], lines[(k + 1) % 3], lines[(k + 2) % 3]
        lowest, highest = rows, -1
        for j in range(1, W + 1):
            cell[k, j - 1] = -1
            x, y, z = here[j, 0], here[j, 1], here[j, 2]
            if z != z:
                continue
            along, across = (x - x0) / pitch, (y - y0) / pitch
            column, row = int(np.floor(along + np.float32(0.5))), int(np.floor(across + np.float32(0.5)))
            if not (0 <= row < rows and 0 <= column < columns):
                continue
            lowest, highest = min(lowest, row), max(highest, row)
            cell[k, j - 1] = row * columns + column
            above[k, j - 1] = z
            offset[k, j - 1, 0], offset[k, j - 1, 1] = np.rint(254 * (along - column)), np.rint(254 * (across - row))
            ax, ay, az = _difference(here, j - 1, here, j + 1, x, y, z)
            bx, by, bz = _difference(before, j, after, j, x, y, z)
            aa, bb = ax * ax + ay * ay, bx * bx + by * by
            turn = ax * by - ay * bx
            if turn * turn > np.float32(0.01) * aa * bb:
                gx, gy = (az * by - bz * ay) / turn, (bz * ax - az * bx) / turn
            elif aa > 0:  # neighbours in one direction only: nothing is known across it
                gx, gy = az * ax / aa, az * ay / aa
            elif bb > 0:
                gx, gy = bz * bx / bb, bz * by / bb
            else:
                gx, gy = np.float32(0), np.float32(0)
            gx, gy = min(max(gx, -STEEPEST), STEEPEST), min(max(gy, -STEEPEST), STEEPEST)
            slope[k, j - 1, 0], slope[k, j - 1, 1] = np.rint(FINE * gx), np.rint(FINE * gy)
        reach[k, 0], reach[k, 1] = lowest, highest


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _difference(one, j, two, k, x, y, z):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Step from one neighbour to the other, from the point itself where one is on another surface, 0 where both are."""
    ux, uy, uz = one[j, 0], one[j, 1], one[j, 2]
    vx, vy, vz = two[k, 0], two[k, 1], two[k, 2]
    steep = np.float32(STEEPEST * STEEPEST)
    if not (uz - z) * (uz - z) <= steep * ((ux - x) * (ux - x) + (uy - y) * (uy - y)):  # NaN is not
        ux, uy, uz = x, y, z
    if not (vz - z) * (vz - z) <= steep * ((vx - x) * (vx - x) + (vy - y) * (vy - y)):
        vx, vy, vz = x, y, z
    return vx - ux, vy - uy, vz - uz


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fill(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    cell,
    above,
    offset,
    slope,
    reach,
    sigma_z,
    texture_in,
    level_in,
    gap,
    pitch,
    shared,
    height,
    sigma,
    texture,
    level,
    first,
    last,
):
    """Sum up the points of the cells of a band of rows."""
    columns = height.shape[1]
    H, W = cell.shape
    start, size = first * columns, (last - first) * columns
    # weight, weighted height, offsets and slopes; then lowest and highest point
    total = np.zeros((size, 8), np.float32)
    count, bright, deepest = np.zeros(size, np.uint16), np.zeros(size, np.uint32), np.zeros(size, np.uint8)
    for n in range(size):
        total[n, 6], total[n, 7] = np.inf, -np.inf
    for i in range(H):
        if reach[i, 0] < last and reach[i, 1] >= first:
            for j in range(W):
                n = cell[i, j] - start
                if 0 <= n < size:
                    total[n, 6] = min(total[n, 6], above[i, j])
                    total[n, 7] = max(total[n, 7], above[i, j])
                    _add(total, count, bright, n, i, j, above, offset, slope, sigma_z, texture_in)
                    deepest[n] = max(deepest[n], level_in[i, j])
    two = 0
    for n in range(size):
        if total[n, 7] - total[n, 6] > gap:
            two += 1
    if two > 0:
        _choose(cell, above, offset, slope, reach, sigma_z, texture_in, gap, total, count, bright, start, columns)
    apart = np.float32(shared)
    nan, unit = np.float32(np.nan), np.float32(pitch / (254 * FINE))
    for row in range(first, last):
        for column in range(columns):
            n = row * columns + column - start
            if count[n] == 0:
                height[row, column], sigma[row, column] = nan, nan
                texture[row, column], level[row, column] = 0, LEVEL_NONE
            else:
                share = np.float32(1) / total[n, 0]
                moved = (total[n, 2] * total[n, 4] + total[n, 3] * total[n, 5]) * (unit * share * share)
                height[row, column] = total[n, 1] * share - moved
                worth = np.float32(1) + (np.sqrt(np.float32(count[n])) - np.float32(1)) / apart
                sigma[row, column] = np.sqrt(share * np.float32(count[n])) / worth
                texture[row, column] = bright[n] // count[n]
                level[row, column] = deepest[n]


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add(total, count, bright, n, i, j, above, offset, slope, sigma_z, texture_in):  # type: ignore[no-untyped-def]  # a kernel
    w = np.float32(1) / (sigma_z[i, j] * sigma_z[i, j])
    total[n, 0] += w
    total[n, 1] += w * above[i, j]
    total[n, 2] += w * np.float32(offset[i, j, 0])
    total[n, 3] += w * np.float32(offset[i, j, 1])
    total[n, 4] += w * np.float32(slope[i, j, 0])
    total[n, 5] += w * np.float32(slope[i, j, 1])
    count[n] += 1
    bright[n] += texture_in[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _choose(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    cell, above, offset, slope, reach, sigma_z, texture_in, gap, total, count, bright, start, columns
):
    """Sum up anew the cells that hold two surfaces: only the one with more points, the upper one in a tie."""
    size = len(count)
    first, last = start // columns, (start + size) // columns
    upper = np.zeros(size, np.int32)  # points of the upper surface less those of the lower
    for turn in range(2):
        for i in range(len(cell)):
            if reach[i, 0] < last and reach[i, 1] >= first:
                for j in range(cell.shape[1]):
                    n = cell[i, j] - start
                    if 0 <= n < size and total[n, 7] - total[n, 6] > gap:
                        high = 2 * above[i, j] > total[n, 6] + total[n, 7]
                        if turn == 0:
                            upper[n] += 1 if high else -1
                        elif high == (upper[n] >= 0):
                            _add(total, count, bright, n, i, j, above, offset, slope, sigma_z, texture_in)
        if turn == 0:
            for n in range(size):
                if total[n, 7] - total[n, 6] > gap:
                    total[n, :6], count[n], bright[n] = 0, 0, 0


@nb.njit(cache=True, nogil=True)
def bridge(source, height, sigma, texture, level, gap, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill single empty cells between two opposite measured ones of the same surface."""
    rows, columns = source.shape
    for row in range(first, last):
        for column in range(columns):
            height[row, column] = source[row, column]
            inner = 0 < row < rows - 1 and 0 < column < columns - 1
            if source[row, column] == source[row, column] or not inner:
                continue
            total, spread, bright, worst, n = 0.0, np.float32(0), 0, np.uint8(0), 0
            for a, b in ((0, 1), (1, 0), (1, 1), (1, -1)):
                one, two = source[row - a, column - b], source[row + a, column + b]
                if abs(one - two) <= gap:  # false where either is NaN
                    total += one + two
                    spread = max(spread, sigma[row - a, column - b], sigma[row + a, column + b])
                    bright += int(texture[row - a, column - b]) + int(texture[row + a, column + b])
                    worst = max(worst, level[row - a, column - b], level[row + a, column + b])
                    n += 2
            if n > 0:
                height[row, column] = total / n
                sigma[row, column] = spread
                texture[row, column] = bright // n
                level[row, column] = worst
