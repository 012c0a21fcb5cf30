"""Compiled inner loops of `refine`: find the edges of cells along lines of the image, and fill what lies between two.

Lines are the image's rows, or its columns; both are visited as memory lies, row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from .edge_formula import edge_between
from .kernels import NO_CELL

__all__ = ["REACH", "Pictures", "along_columns", "along_rows", "crossings", "edges_between", "levels_of"]

REACH = 96  # camera px: between edges further apart nothing is known to be linear
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
    wave : ndarray of float32, shape (cell + 1, bit, 2)
        Camera px over which the wave of the stripes of these frames turns by a radian, and the tangent of half its turn
        over one px; 0 where they are wide enough for single edges.
    edge : ndarray of float32, shape (cell + 1,)
        As of `AxisCells`.
    centre, width : ndarray of float32, shape (half step,)
        As of `AxisCells`.
    unsure : ndarray of float32, shape (256,)
        Variance of a whole cell, in cells squared, by contrast.
    noise : float32
        Variance of pattern minus inverse, in units of `contrast` squared.
    scale : float32
        Units of `contrast` per count.
    """

    stack: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    white: int
    black: int
    plus: npt.NDArray[np.int32]
    minus: npt.NDArray[np.int32]
    tilt: npt.NDArray[np.float32]
    wave: npt.NDArray[np.float32]
    edge: npt.NDArray[np.float32]
    centre: npt.NDArray[np.float32]
    width: npt.NDArray[np.float32]
    unsure: npt.NDArray[np.float32]
    noise: np.float32
    scale: np.float32


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _swing(stack, white, black, plus, minus, tilt, contrast, scale, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Pattern minus inverse of a pixel, as under even light."""
    light = tilt * np.float32(contrast[i, j])
    p = np.float32(stack[plus, i, j])
    if minus >= 0:
        return scale * (p - np.float32(stack[minus, i, j])) - light
    return scale * (p + p - np.float32(stack[white, i, j]) - np.float32(stack[black, i, j])) - light


@nb.njit(cache=True, nogil=True, error_model="numpy")
def crossings(stack, white, black, plus, minus, tilt, wave, contrast, scale, noise, begin, i, j, di, dj):  # type: ignore[no-untyped-def]  # numba infers
    """Where the bits that flip at the cell edge `begin` cross zero, and the slope's inverse; NaN where none does.

    Pixel (i, j) is 0 and the one before it along (di, dj) is -1. Bits are decided without regard to the light, so the
    crossing may lie one pixel further on either side.
    """
    total, variance, count = np.float32(0), np.float32(0), np.float32(0)
    for n in range(plus.shape[1]):
        p, q, t = plus[begin, n], minus[begin, n], tilt[begin, n]
        if p < 0:
            break
        y, x = i, j
        a = _swing(stack, white, black, p, q, t, contrast, scale, i - di, j - dj)
        b = _swing(stack, white, black, p, q, t, contrast, scale, i, j)
        if (a > 0) == (b > 0):
            if abs(a) < abs(b):
                if i < 2 * di or j < 2 * dj:
                    continue
                y, x = i - di, j - dj
                a, b = _swing(stack, white, black, p, q, t, contrast, scale, i - 2 * di, j - 2 * dj), a
            else:
                if i + di >= contrast.shape[0] or j + dj >= contrast.shape[1]:
                    continue
                y, x = i + di, j + dj
                a, b = b, _swing(stack, white, black, p, q, t, contrast, scale, i + di, j + dj)
            if (a > 0) == (b > 0):
                continue
        full_a, full_b = np.float32(contrast[y - di, x - dj]), np.float32(contrast[y, x])
        part, own = edge_between(a, b, full_a, full_b, noise, wave[begin, n, 0], wave[begin, n, 1])
        total += np.float32((y - i) + (x - j) - 1) + part
        variance += own
        count += np.float32(1)
    if count == 0:
        return np.float32(np.nan), np.float32(0)
    return total / count, variance / count


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def edges_between(before, here):  # type: ignore[no-untyped-def]  # numba infers
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _changes(before, here, found):  # type: ignore[no-untyped-def]  # numba infers
    """Where two lines differ: fills `found`, gives how many. Without a branch, which could not be foreseen."""
    count = 0
    for n in range(here.size):
        found[count] = n
        count += before[n] != here[n]
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _cross_all(pictures, before, here, contrast, found, count, i, first, down, far, near, position, own):  # type: ignore[no-untyped-def]  # numba infers
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
        Out: `edges_between`.
    position, own : ndarray of float32, shape (count,)
        Out: `crossings` at the far edge.
    """
    stack, white, black, plus, minus, tilt, wave, _, _, _, _, noise, scale = pictures
    single = plus.shape[1] == 1
    y, back = np.uintp(i), np.uintp(i - down)
    for c in range(count):
        n = np.uintp(found[c])
        begin, other = edges_between(before[n], here[n])
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
            full_a, full_b = np.float32(contrast[back, left]), np.float32(contrast[y, x])
            a = scale * np.float32(np.int32(stack[f, back, left]) - np.int32(stack[g, back, left])) - t * full_a
            b = scale * np.float32(np.int32(stack[f, y, x]) - np.int32(stack[g, y, x])) - t * full_b
            if (a > 0) != (b > 0):
                part, own[c] = edge_between(a, b, full_a, full_b, noise, wave[at, 0, 0], wave[at, 0, 1])
                position[c] = part - np.float32(1)
                continue
        position[c], own[c] = crossings(
            stack, white, black, plus, minus, tilt, wave, contrast, scale, noise, begin, i, np.intp(x), down, 1 - down
        )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def along_rows(pictures, steps, contrast, first, last, fine, spread):  # type: ignore[no-untyped-def]  # numba infers
    """Fill rows `first` to `last` of `fine` and `spread` where an axis grows along the image's rows.

    Pixels without an edge on both sides get the middle of their cell. `spread` takes variances, negative where there
    was no edge on both sides; `settle` makes standard uncertainties of them.
    """
    stack, white, black, plus, minus, tilt, wave, edge, middle, wide, unsure, noise, scale = pictures
    W = steps.shape[1]
    found, far, near = np.empty(W + 1, np.int32), np.empty(W + 1, np.int32), np.empty(W + 1, np.int32)
    position, own = np.empty(W + 1, np.float32), np.empty(W + 1, np.float32)
    one = np.float32(1)
    for i in range(first, last):
        step, place, light, variance = steps[i], fine[i], contrast[i], spread[i]
        count = _changes(step[:-1], step[1:], found)
        _cross_all(pictures, step[:-1], step[1:], contrast, found, count, i, 1, 0, far, near, position, own)
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
                    whole = rise * per * rise * per
                    e0, e1 = error * whole, own[c] * whole
                    for m in range(start, j):
                        share = min(max((np.float32(m) - behind) * per, np.float32(0)), one)
                        place[np.uintp(m)] = value + share * rise
                        variance[np.uintp(m)] = (one - share) * (one - share) * e0 + share * share * e1
            if not filled:
                centre, width = middle[here], wide[here] * wide[here]
                for m in range(start, j):
                    place[m] = centre
                    variance[m] = -width * unsure[light[m]]
            if c == count:
                break
            known = False
            if begin >= 0:
                at, each = position[c], own[c]
                if near[c] != begin:  # the camera skips a cell: the edge behind the next run is another one
                    at, each = crossings(
                        stack, white, black, plus, minus, tilt, wave, contrast, scale, noise, near[c], i, j, 0, 1
                    )
                known = at == at
                behind, value, error = np.float32(j) + at, edge[near[c]], each
            start = j


@nb.njit(cache=True, nogil=True, error_model="numpy")
def along_columns(pictures, steps, contrast, first, last, fine, spread):  # type: ignore[no-untyped-def]  # numba infers
    """As `along_rows` for columns `first` to `last`, where an axis grows down the image."""
    stack, white, black, plus, minus, tilt, wave, edge, middle, wide, unsure, noise, scale = pictures
    H = steps.shape[0]
    size = last - first
    found, far, near = np.empty(size + 1, np.int32), np.empty(size, np.int32), np.empty(size, np.int32)
    position, own = np.empty(size, np.float32), np.empty(size, np.float32)
    start, known = np.zeros(size, np.int32), np.zeros(size, np.bool_)
    behind, value, error = np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32)
    everywhere = np.arange(size).astype(np.int32)
    one = np.float32(1)
    for i in range(1, H + 1):
        above, below = steps[i - 1, first:last], steps[min(i, H - 1), first:last]
        count = _changes(above, below, found) if i < H else size
        if i < H:
            _cross_all(pictures, above, below, contrast, found, count, i, first, 1, far, near, position, own)
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
                    whole = rise * per * rise * per
                    e0, e1 = error[n] * whole, own[c] * whole
                    b, v = behind[n], value[n]
                    for m in range(start[n], i):
                        share = min(max((np.float32(m) - b) * per, np.float32(0)), one)
                        fine[np.uintp(m), j] = v + share * rise
                        spread[np.uintp(m), j] = (one - share) * (one - share) * e0 + share * share * e1
            if not filled:
                centre, width = middle[here], wide[here] * wide[here]
                for m in range(start[n], i):
                    fine[np.uintp(m), j] = centre
                    spread[np.uintp(m), j] = -width * unsure[contrast[np.uintp(m), j]]
            known[n] = False
            if begin >= 0:
                at, each = position[c], own[c]
                if near[c] != begin:
                    at, each = crossings(
                        stack,
                        white,
                        black,
                        plus,
                        minus,
                        tilt,
                        wave,
                        contrast,
                        scale,
                        noise,
                        near[c],
                        i,
                        np.intp(j),
                        1,
                        0,
                    )
                known[n] = at == at
                behind[n], value[n], error[n] = np.float32(i) + at, edge[near[c]], each
            start[n] = i


@nb.njit(cache=True, nogil=True)
def levels_of(steps, level):  # type: ignore[no-untyped-def]  # numba infers
    """Raise `level` to that of each half step (zeros at the end of its digits; 255 where there is none)."""
    for n in range(steps.size):
        step = steps[n]
        own = np.uint8(0)
        for zeros in range(1, 4):
            own += np.uint8(1) if step & np.uint16((1 << zeros) - 1) == 0 else np.uint8(0)
        level[n] = max(level[n], own if step != NO_CELL else np.uint8(255))
