"""Compiled inner loops of local integration: read a pixel from sums over a window, place it, judge it by its surface.

A window is symmetric: a pixel counts only together with the one opposite, so that where light is even the sum stands
for the middle of the window, however ragged the dark patch is.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

__all__ = ["NOT_READ", "Code", "judge", "place_sums", "read_sums"]

NOT_READ = -1
DIRECT = 4  # as in `fallback`: of white minus black, one part in so many is the least swing of coarser patterns
FARTHEST = 9  # camera px: an edge farther away is not looked for
FLAT_PX = 0.75  # projector px by which a surface may bend over the window's side, noise aside
SURE = 3.0  # standard deviations
STRAIGHT = 5  # of eight directions that must lead to the pixel
LINES = ((0, 1), (1, 0), (1, 1), (1, -1))

Bits = npt.NDArray[np.int64]


class Code(NamedTuple):
    """One axis, as the kernels take it.

    Parameters
    ----------
    plus, minus : ndarray of int64, shape (bit,)
        Frame of each bit and of its inverse (-1: none), coarsest first.
    bits, lowest, highest : int
        How many; numbers of the cells at the ends of the axis.
    edge : ndarray of float32, shape (cell + 1,)
        As of `AxisCells`.
    flips : ndarray of int64, shape (cell + 1,)
        The bit that flips where the cell begins.
    tilt : ndarray of float32, shape (bit,)
        As of `Light`.
    """

    plus: Bits
    minus: Bits
    bits: int
    lowest: int
    highest: int
    edge: npt.NDArray[np.float32]
    flips: Bits
    tilt: npt.NDArray[np.float32]


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _counts(usable, i, j, a, b):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether a pixel of the window and the one opposite may both be summed."""
    H, W = usable.shape
    if not (0 <= i + a < H and 0 <= j + b < W and 0 <= i - a < H and 0 <= j - b < W):
        return False
    return usable[i + a, j + b] and usable[i - a, j - b]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sum(frame, usable, whole, i, j, reach):  # type: ignore[no-untyped-def]  # numba infers
    """Sum of a frame over a window."""
    total = np.int64(0)
    if whole:
        for y in range(i - reach, i + reach + 1):
            for x in range(j - reach, j + reach + 1):
                total += np.int64(frame[np.uintp(y), np.uintp(x)])
        return total
    for a in range(-reach, reach + 1):
        for b in range(-reach, reach + 1):
            if _counts(usable, i, j, a, b):
                total += np.int64(frame[i + a, j + b])
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _members(usable, i, j, reach):  # type: ignore[no-untyped-def]  # numba infers
    count = 0
    for a in range(-reach, reach + 1):
        for b in range(-reach, reach + 1):
            count += _counts(usable, i, j, a, b)
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _swing(stack, usable, whole, white, black, plus, minus, i, j, reach):  # type: ignore[no-untyped-def]  # numba infers
    """Pattern minus inverse, summed; `white` and `black` are sums already."""
    p = _sum(stack[plus], usable, whole, i, j, reach)
    if minus >= 0:
        return p - _sum(stack[minus], usable, whole, i, j, reach)
    return 2 * p - white - black


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _number(stack, usable, whole, code, level, white, black, share, floor, i, j, reach):  # type: ignore[no-untyped-def]  # numba infers
    """Number of the cell in a code without its `level` finest bits, by the rules of `fallback`; -1 in doubt."""
    light = white - black
    limit = max(share * light, floor)
    word, doubt, mixed = 0, 0, 0
    for bit in range(code.bits - level):
        swing = _swing(stack, usable, whole, white, black, code.plus[bit], code.minus[bit], i, j, reach)
        word = 2 * word + (swing > 0)
        doubt = 2 * doubt + (abs(swing) < limit)
        mixed = 2 * mixed + (DIRECT * abs(swing) < light)
        if bit < code.bits - level - 1 and (doubt & (doubt - 1)):
            return NOT_READ  # two bits in doubt already
    number = word
    for shift in (1, 2, 4, 8):
        number ^= number >> shift
    pair = (number + 1) & ~1
    edge = pair & -pair
    if doubt not in (0, 1, edge) or mixed & ~1 not in (0, edge):
        return NOT_READ
    if not (code.lowest >> level) <= number <= (code.highest >> level):
        return NOT_READ
    return number


@nb.njit(cache=True, nogil=True, error_model="numpy")
def read_sums(  # type: ignore[no-untyped-def]  # numba infers
    stack, white, black, codes, wanted, usable, reach, levels, share, sd, swing_sd, every, first, last, numbers, window
):
    """Read the pixels that no smaller window could read, in rows `first` to `last`.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    white, black : int
        Frames.
    codes : tuple of Code
        Of the axes that were projected.
    wanted, usable : ndarray of bool, shape (row, column)
        Pixels to read; pixels that may be summed.
    reach : int
        The window reaches so many pixels to every side.
    levels : ndarray of int64, shape (axis,)
        Finest bits that the window would smear.
    share : float
        Least swing of a certain bit, of white minus black.
    sd, swing_sd : float
        Noise of a pixel and of its pattern minus inverse, counts.
    every : int
        Only every so many-th row is read.
    numbers : ndarray of int32, shape (axis, row, column)
        Filled where read.
    window : ndarray of uint8, shape (row, column)
        Reach of the window that a pixel was read with, 0 if none; filled where read.
    """
    side = 2 * reach + 1
    found = np.empty(len(codes), np.int64)
    for i in range(first, last):
        if i % every:
            continue
        for j in range(wanted.shape[1]):
            if not wanted[i, j] or window[i, j]:
                continue
            count = _members(usable, i, j, reach)
            if 2 * count <= side * side:
                continue
            whole = count == side * side
            w, b = _sum(stack[white], usable, whole, i, j, reach), _sum(stack[black], usable, whole, i, j, reach)
            root = np.sqrt(count)
            if w - b < max(6 * np.sqrt(2) * sd * root, count):  # below a count on average rounding hides what there is
                continue
            good = True
            for n in range(len(codes)):
                found[n] = _number(
                    stack, usable, whole, codes[n], levels[n], w, b, share, SURE * swing_sd * root, i, j, reach
                )
                if found[n] == NOT_READ:
                    good = False
                    break
            if good:
                window[i, j] = reach
                for n in range(len(codes)):
                    numbers[n, i, j] = found[n]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _share(stack, white, black, code, bit, usable, i, j, reach):  # type: ignore[no-untyped-def]  # numba infers
    """Swing of a bit as a share of white minus black, both summed, as under even light; and that light."""
    whole = _members(usable, i, j, reach) == (2 * reach + 1) ** 2
    w, b = _sum(stack[white], usable, whole, i, j, reach), _sum(stack[black], usable, whole, i, j, reach)
    if w <= b:
        return np.nan, 0.0
    swing = _swing(stack, usable, whole, w, b, code.plus[bit], code.minus[bit], i, j, reach)
    return swing / (w - b) - code.tilt[bit], float(w - b)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _crossing(stack, white, black, code, bit, usable, i, j, down, reach, far, swing_sd):  # type: ignore[no-untyped-def]  # numba infers
    """Where a bit crosses zero next to a pixel, camera px from it along the line, and the variance; NaN where not."""
    middle, light = _share(stack, white, black, code, bit, usable, i, j, reach)
    root = swing_sd * np.sqrt(_members(usable, i, j, reach))
    best, variance = np.nan, 0.0
    for sign in (-1, 1):
        before, own = middle, light
        for step in range(1, far + 1):
            y, x = i + sign * step * down, j + sign * step * (1 - down)
            if not (0 <= y < usable.shape[0] and 0 <= x < usable.shape[1]) or not usable[y, x]:
                break
            here, full = _share(stack, white, black, code, bit, usable, y, x, reach)
            if here != here:
                break
            if (here > 0) != (before > 0):
                part = before / (before - here)
                at = sign * (step - 1 + part)
                if best != best or abs(at) < abs(best):
                    best = at
                    noise = root * (1 - part) / own + root * part / full  # neighbouring windows share most pixels
                    variance = (noise / (before - here)) ** 2
                break
            before, own = here, full
    return best, variance


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_sums(  # type: ignore[no-untyped-def]  # numba infers
    stack, white, black, code, number, usable, window, level, growth, down, swing_sd, first, last, place, variance
):
    """Place the pixels that were read on one axis within their cells, in rows `first` to `last`.

    The two edges of the cell are where the bits that flip there cross zero along the line; between them the position is
    linear. A pixel without both keeps the middle of its cell.

    Parameters
    ----------
    number : ndarray of int32, shape (row, column)
    window : ndarray of uint8, shape (row, column)
    level : ndarray of int64, shape (reach + 1,)
        Bits left out, by the window's reach.
    growth : float
        Projector px per camera px along the line.
    down : int
        1 if the axis grows down the image, 0 if along its rows.
    place, variance : ndarray of float32, shape (row, column)
        Filled where a pixel was read.
    """
    for i in range(first, last):
        for j in range(window.shape[1]):
            reach = np.int64(window[i, j])
            if reach == 0:
                continue
            low = np.int64(number[i, j]) << level[reach]
            high = min((np.int64(number[i, j]) + 1) << level[reach], code.highest + 1)
            width = code.edge[high] - code.edge[low]
            place[i, j] = 0.5 * (code.edge[low] + code.edge[high])
            variance[i, j] = width * width / 3  # read off by one where its edge is in doubt
            cell = width / max(growth, 1e-3)
            far = min(FARTHEST, int(cell) + reach + 1)
            if low <= code.lowest or high > code.highest:
                continue
            a, e0 = _crossing(stack, white, black, code, code.flips[low], usable, i, j, down, reach, far, swing_sd)
            b, e1 = _crossing(stack, white, black, code, code.flips[high], usable, i, j, down, reach, far, swing_sd)
            gap = b - a
            if not 0.4 * cell < abs(gap) < 2.5 * cell:  # NaN too
                continue
            part = -a / gap
            if not -0.5 < part < 1.5:
                continue
            place[i, j] = code.edge[low] + part * width
            variance[i, j] = ((1 - part) ** 2 * e0 + part * part * e1) * (width / gap) ** 2


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(place, i, j):  # type: ignore[no-untyped-def]  # numba infers
    return place[i, j] if 0 <= i < place.shape[0] and 0 <= j < place.shape[1] else np.float32(np.nan)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _off_centre(stack, white, black, usable, i, j, reach, a, b, sd):  # type: ignore[no-untyped-def]  # numba infers
    """How far along (a, b) the light's centre lies from the window's, px squared, less what is noise."""
    total, moment, square = 0.0, 0.0, 0.0
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            if _counts(usable, i, j, y, x):
                light = float(stack[white, i + y, j + x]) - float(stack[black, i + y, j + x])
                arm = a * y + b * x
                total += light
                moment += arm * light
                square += arm * arm
    return max(moment * moment - 2 * sd * sd * square, 0.0) / (total * total)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def judge(stack, white, black, places, variances, usable, window, sd, first, last, sigmas, kept):  # type: ignore[no-untyped-def]  # numba infers
    """Keep the pixels that lie on a surface which goes on across their window, and work out their sigmas.

    Going on straight from two places in a direction, a window's side apart and so of other pixels, must lead to the
    pixel, in `STRAIGHT` of eight directions and on all axes. A window that spans a step stands between two surfaces:
    along a line across it the map bends, or rises by more over the window than beyond it.

    Parameters
    ----------
    places, variances : ndarray of float32, shape (axis, row, column)
        Of all pixels, NaN where there is none; of those decoded before too.
    sigmas : ndarray of float32, shape (axis, row, column)
        Filled where kept: noise, how far the light's centre in the window is off by the slope of the map, and the bend
        of the map over the window.
    kept : ndarray of bool, shape (row, column)
        Filled.
    """
    axes = len(places)
    for i in range(first, last):
        for j in range(window.shape[1]):
            reach = np.int64(window[i, j])
            if reach == 0:
                continue
            side = 2 * reach + 1
            straight, torn = 0, False
            for line in range(4):
                a, b = LINES[line]
                for sign in (-1, 1):
                    y, x = sign * a * side, sign * b * side
                    on = True
                    for n in range(axes):
                        miss = places[n, i, j] - 2 * _at(places[n], i + y, j + x) + _at(places[n], i + 2 * y, j + 2 * x)
                        noise = (
                            variances[n, i, j]
                            + 4 * _at(variances[n], i + y, j + x)
                            + _at(variances[n], i + 2 * y, j + 2 * x)
                        )
                        on &= bool(abs(miss) <= FLAT_PX + SURE * np.sqrt(noise))  # not where a place is unknown
                    straight += on
                for n in range(axes):
                    y, x = a * side, b * side
                    here = places[n, i, j]
                    p, q = _at(places[n], i - y, j - x), _at(places[n], i + y, j + x)
                    vp, vq = _at(variances[n], i - y, j - x), _at(variances[n], i + y, j + x)
                    noise = SURE * np.sqrt(vp + 4 * variances[n, i, j] + vq)
                    torn |= bool(abs(p - 2 * here + q) > FLAT_PX + noise)
                    pp, qq = _at(places[n], i - 2 * y, j - 2 * x), _at(places[n], i + 2 * y, j + 2 * x)
                    vpp, vqq = _at(variances[n], i - 2 * y, j - 2 * x), _at(variances[n], i + 2 * y, j + 2 * x)
                    noise = SURE * np.sqrt(vp + vq + 0.25 * (vpp + vqq))
                    torn |= bool(abs((q - p) - 0.5 * (qq - pp)) > FLAT_PX + noise)
            if torn or straight < STRAIGHT:
                continue
            kept[i, j] = True
            for n in range(axes):
                total = variances[n, i, j]
                for line in range(2):
                    a, b = LINES[line]
                    y, x = a * side, b * side
                    p, q = _at(places[n], i - y, j - x), _at(places[n], i + y, j + x)
                    if p == p and q == q:
                        slope = (q - p) / (2 * side)
                        total += slope * slope * _off_centre(stack, white, black, usable, i, j, reach, a, b, sd)
                        bend = p - 2 * places[n, i, j] + q
                        noise = (
                            _at(variances[n], i - y, j - x) + 4 * variances[n, i, j] + _at(variances[n], i + y, j + x)
                        )
                        # a parabola's mean over the window, from its middle
                        total += max(bend * bend - noise, 0.0) * (reach * (reach + 1) / (6.0 * side * side)) ** 2
                sigmas[n, i, j] = np.sqrt(total)
