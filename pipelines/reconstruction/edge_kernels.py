"""Compiled inner loops of `refine`: find the edges of cells along lines of the image, and fill what lies between two.

Lines are the image's rows, or its columns; both are visited as memory lies, row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from .kernels import NO_CELL

__all__ = ["REACH", "Pictures", "along_columns", "along_rows", "levels_of"]

REACH = 96  # camera px: between edges further apart nothing is known to be linear
# How far a pixel is off, of the bend of the map over one cell to either side: sqrt(1/120) of it where the surface
# bends (the mean of a parabola's distance from its chord), half of it where an edge is misplaced (then the errors of
# four edges make the bend, and those of the inner two the pixel's). Which it is cannot be told: their geometric mean.
BEND = 0.21
SKIPPED = 2  # half cells that the camera may skip between neighbours: one cell


class Pictures(NamedTuple):
    """What the crossings of one axis are read from, as the kernels take it.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    white, black : int
        Frames.
    plus, minus : ndarray of int32, shape (cell + 1, bit)
        Frames of the patterns that flip where each cell begins (-1: no more), and of their inverses (-1: none).
    tilt : ndarray of float32, shape (cell + 1, bit)
        By how much, in units of `contrast`, the light of these frames moves pattern minus inverse.
    edge : ndarray of float32, shape (cell + 1,)
        As of `AxisCells`.
    centre, width : ndarray of float32, shape (half step,)
        As of `AxisCells`.
    unsure : ndarray of float32, shape (256,)
        Variance of a whole cell, in cells squared, by contrast.
    noise : float32
        Standard deviation of pattern minus inverse, counts.
    flat : float32
        Variance that the noise does not explain, projector px squared.
    """

    stack: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    white: int
    black: int
    plus: npt.NDArray[np.int32]
    minus: npt.NDArray[np.int32]
    tilt: npt.NDArray[np.float32]
    edge: npt.NDArray[np.float32]
    centre: npt.NDArray[np.float32]
    width: npt.NDArray[np.float32]
    unsure: npt.NDArray[np.float32]
    noise: np.float32
    flat: np.float32


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _swing(stack, white, black, plus, minus, tilt, contrast, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Pattern minus inverse of a pixel, as under even light."""
    light = tilt * np.float32(contrast[i, j])
    p = np.float32(stack[plus, i, j])
    if minus >= 0:
        return p - np.float32(stack[minus, i, j]) - light
    return p + p - np.float32(stack[white, i, j]) - np.float32(stack[black, i, j]) - light


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _crossings(stack, white, black, plus, minus, tilt, contrast, begin, i, j, di, dj):  # type: ignore[no-untyped-def]  # numba infers
    """Where the bits that flip at the cell edge `begin` cross zero, and the slope's inverse; NaN where none does.

    Pixel (i, j) is 0 and the one before it along (di, dj) is -1. Bits are decided without regard to the light, so the
    crossing may lie one pixel further on either side.
    """
    total, inverse, count = np.float32(0), np.float32(0), np.float32(0)
    for n in range(plus.shape[1]):
        p, q, t = plus[begin, n], minus[begin, n], tilt[begin, n]
        if p < 0:
            break
        a = _swing(stack, white, black, p, q, t, contrast, i - di, j - dj)
        b = _swing(stack, white, black, p, q, t, contrast, i, j)
        offset = np.float32(-1)
        if (a > 0) == (b > 0):
            if abs(a) < abs(b):
                if i < 2 * di or j < 2 * dj:
                    continue
                a, b = _swing(stack, white, black, p, q, t, contrast, i - 2 * di, j - 2 * dj), a
                offset = np.float32(-2)
            else:
                if i + di >= contrast.shape[0] or j + dj >= contrast.shape[1]:
                    continue
                a, b = b, _swing(stack, white, black, p, q, t, contrast, i + di, j + dj)
                offset = np.float32(0)
            if (a > 0) == (b > 0):
                continue
        slope = np.float32(1) / (a - b)
        total += offset + a * slope
        inverse += abs(slope)
        count += np.float32(1)
    if count == 0:
        return np.float32(np.nan), np.float32(0)
    return total / count, inverse / count


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _edges_between(before, here):  # type: ignore[no-untyped-def]  # numba infers
    """Edges of the cells of two neighbours that face each other; equal unless the camera skips a cell, -1 if others."""
    k, n = np.int64(before), np.int64(here)
    if k == NO_CELL or n == NO_CELL:
        return -1, -1
    sign = 1 if n > k else -1
    far, near = k + sign * (k & -k), n - sign * (n & -n)
    gap = sign * (near - far)
    if gap < 0 or gap > SKIPPED:
        return -1, -1
    return far >> 1, near >> 1


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _wider(step):  # type: ignore[no-untyped-def]  # numba infers
    """Square of how many of the finest cells a cell is wide."""
    wide = np.int64(step) & -np.int64(step)
    return np.float32(wide * wide)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _changes(before, here, found):  # type: ignore[no-untyped-def]  # numba infers
    """Where two lines differ: fills `found`, gives how many. Without a branch, which could not be foreseen."""
    count = 0
    for n in range(here.size):
        found[count] = n
        count += before[n] != here[n]
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _cross_all(pictures, before, here, contrast, found, count, i, first, down, far, near, position, inverse):  # type: ignore[no-untyped-def]  # numba infers
    """Where the bits cross zero between neighbours that differ, all of a line at once.

    Apart from what is filled in between: so the processor waits for many places of many frames at the same time.

    Parameters
    ----------
    before, here : ndarray of uint16, shape (n,)
        Half steps of the pixels of a line and of the ones before.
    found : ndarray of int32, shape (count,)
        Which of them differ.
    i, first : int
        Where in the image the first of `here` lies.
    down : int
        1 if the ones before lie above, 0 if they lie to the left.
    far, near : ndarray of int32, shape (count,)
        Out: `_edges_between`.
    position, inverse : ndarray of float32, shape (count,)
        Out: `_crossings` at the far edge.
    """
    stack, white, black, plus, minus, tilt = pictures[:6]
    single = plus.shape[1] == 1
    y, back = np.uintp(i), np.uintp(i - down)
    for c in range(count):
        n = np.uintp(found[c])
        begin, other = _edges_between(before[n], here[n])
        far[c], near[c] = begin, other
        if begin < 0:
            continue
        # nearly always one bit flips and crosses zero right here. Written out, as a call that hands on arrays costs as
        # much as ten edges; unsigned, as a negative index would count from the end, and to look for one costs more than
        # the reading
        at, x = np.uintp(begin), np.uintp(first + np.intp(n))
        p, q, t = plus[at, 0], minus[at, 0], tilt[at, 0]
        if single and q >= 0:
            f, g, left = np.uintp(p), np.uintp(q), np.uintp(x - np.uintp(1 - down))
            a = np.float32(np.int32(stack[f, back, left]) - np.int32(stack[g, back, left]))
            b = np.float32(np.int32(stack[f, y, x]) - np.int32(stack[g, y, x]))
            a, b = a - t * np.float32(contrast[back, left]), b - t * np.float32(contrast[y, x])
            if (a > 0) != (b > 0):
                slope = np.float32(1) / (a - b)
                position[c], inverse[c] = a * slope - np.float32(1), abs(slope)
                continue
        position[c], inverse[c] = _crossings(
            stack, white, black, plus, minus, tilt, contrast, begin, i, np.intp(x), down, 1 - down
        )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def along_rows(pictures, steps, contrast, first, last, cells, fine, spread):  # type: ignore[no-untyped-def]  # numba infers
    """Fill rows `first` to `last` of `fine` and `spread` where an axis grows along the image's rows.

    Pixels without an edge on both sides get the middle of their cell. `cells` is the camera px over which the bend of
    the map is taken.
    """
    stack, white, black, plus, minus, tilt, edge, middle, wide, unsure, noise, flat = pictures
    W = steps.shape[1]
    found, far, near = np.empty(W + 1, np.int32), np.empty(W + 1, np.int32), np.empty(W + 1, np.int32)
    position, inverse = np.empty(W + 1, np.float32), np.empty(W + 1, np.float32)
    variance = np.empty(W, np.float32)
    one = np.float32(1)
    for i in range(first, last):
        step, place, light = steps[i], fine[i], contrast[i]
        count = _changes(step[:-1], step[1:], found)
        _cross_all(pictures, step[:-1], step[1:], contrast, found, count, i, 1, 0, far, near, position, inverse)
        far[count] = -1
        start, known = 0, False
        behind, value, error = np.float32(0), np.float32(0), np.float32(0)
        for c in range(count + 1):
            j = found[c] + 1 if c < count else W
            here, begin = step[j - 1], far[c]
            filled = False
            if begin >= 0:
                ahead = np.float32(j) + position[c]
                length, rise = ahead - behind, edge[begin] - value
                if known and length > 0 and j - start <= REACH and rise != 0:
                    filled = True
                    per = one / length
                    e0, e1 = error * rise * per, noise * inverse[c] * rise * per
                    rough = flat * _wider(here)
                    for m in range(start, j):
                        share = min(max((np.float32(m) - behind) * per, np.float32(0)), one)
                        place[np.uintp(m)] = value + share * rise
                        variance[np.uintp(m)] = ((one - share) * e0) ** 2 + (share * e1) ** 2 + rough
            if not filled:
                centre, width = middle[here], wide[here] * wide[here]
                for m in range(start, j):
                    place[m] = centre
                    variance[m] = width * unsure[light[m]]
            if c == count:
                break
            known = False
            if begin >= 0:
                at, slope = position[c], inverse[c]
                if near[c] != begin:  # the camera skips a cell: the edge behind the next run is another one
                    at, slope = _crossings(stack, white, black, plus, minus, tilt, contrast, near[c], i, j, 0, 1)
                known = at == at
                behind, value, error = np.float32(j) + at, edge[near[c]], noise * slope
            start = j
        _root(variance, spread[i])
        _add_bend(
            place[: W - 2 * cells], place[cells : W - cells], place[2 * cells :], variance[cells:], spread[i, cells:]
        )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def along_columns(pictures, steps, contrast, first, last, cells, fine, spread):  # type: ignore[no-untyped-def]  # numba infers
    """As `along_rows` for columns `first` to `last`, where an axis grows down the image."""
    stack, white, black, plus, minus, tilt, edge, middle, wide, unsure, noise, flat = pictures
    H = steps.shape[0]
    size = last - first
    found, far, near = np.empty(size + 1, np.int32), np.empty(size, np.int32), np.empty(size, np.int32)
    position, inverse = np.empty(size, np.float32), np.empty(size, np.float32)
    start, known = np.zeros(size, np.int32), np.zeros(size, np.bool_)
    behind, value, error = np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32)
    everywhere = np.arange(size).astype(np.int32)
    one = np.float32(1)
    for i in range(1, H + 1):
        above, below = steps[i - 1, first:last], steps[min(i, H - 1), first:last]
        count = _changes(above, below, found) if i < H else size
        if i < H:
            _cross_all(pictures, above, below, contrast, found, count, i, first, 1, far, near, position, inverse)
        else:
            far[:] = -1
        for c in range(count):
            n = np.uintp(found[c]) if i < H else np.uintp(everywhere[c])
            here, j, begin = above[n], np.uintp(first) + n, far[c]
            filled = False
            if begin >= 0:
                ahead = np.float32(i) + position[c]
                length, rise = ahead - behind[n], edge[begin] - value[n]
                if known[n] and length > 0 and i - start[n] <= REACH and rise != 0:
                    filled = True
                    per = one / length
                    e0, e1 = error[n] * rise * per, noise * inverse[c] * rise * per
                    b, v, rough = behind[n], value[n], flat * _wider(here)
                    for m in range(start[n], i):
                        share = min(max((np.float32(m) - b) * per, np.float32(0)), one)
                        fine[np.uintp(m), j] = v + share * rise
                        spread[np.uintp(m), j] = ((one - share) * e0) ** 2 + (share * e1) ** 2 + rough
            if not filled:
                centre, width = middle[here], wide[here] * wide[here]
                for m in range(start[n], i):
                    fine[np.uintp(m), j] = centre
                    spread[np.uintp(m), j] = width * unsure[contrast[np.uintp(m), j]]
            known[n] = False
            if begin >= 0:
                at, slope = position[c], inverse[c]
                if near[c] != begin:
                    at, slope = _crossings(
                        stack, white, black, plus, minus, tilt, contrast, near[c], i, np.intp(j), 1, 0
                    )
                known[n] = at == at
                behind[n], value[n], error[n] = np.float32(i) + at, edge[near[c]], noise * slope
            start[n] = i
    for i in range(H):
        here = spread[i, first:last]
        if cells <= i < H - cells:
            _add_bend(fine[i - cells, first:last], fine[i, first:last], fine[i + cells, first:last], here, here)
        else:
            _root(here, here)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _root(variance, error):  # type: ignore[no-untyped-def]  # numba infers
    for n in range(error.size):
        error[n] = np.sqrt(variance[n])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_bend(before, here, after, variance, error):  # type: ignore[no-untyped-def]  # numba infers
    """Roots of the variances and of what the bend of a line of positions adds to them."""
    share, one, none = np.float32(BEND * BEND), np.float32(1), np.float32(0)
    for n in range(before.size):
        bend = before[n] - np.float32(2) * here[n] + after[n]
        # beyond a cell it is no bend but an edge of the surface; NaN is neither
        error[n] = np.sqrt(variance[n] + (share * bend * bend if abs(bend) < one else none))


@nb.njit(cache=True, nogil=True)
def levels_of(steps, level):  # type: ignore[no-untyped-def]  # numba infers
    """Raise `level` to that of each half step (zeros at the end of its digits; 255 where there is none)."""
    for n in range(steps.size):
        step = steps[n]
        own = np.uint8(0)
        for zeros in range(1, 4):
            own += np.uint8(1) if step & np.uint16((1 << zeros) - 1) == 0 else np.uint8(0)
        level[n] = max(level[n], own if step != NO_CELL else np.uint8(255))
