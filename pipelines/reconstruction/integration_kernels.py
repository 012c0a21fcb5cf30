"""Compiled inner loops of local integration: sums over a window, and whether a place lies on a surface that goes on.

Written as plain loops along rows of the image, so that the compiler makes vector instructions of them.
"""

from __future__ import annotations

import numba as nb
import numpy as np

__all__ = ["MARGIN", "box_sums", "judge", "off_centre"]

FLAT_PX = 0.75  # projector px by which a surface may bend over the window's side, noise aside: half of it is an error
SURE = 3.0  # standard deviations
# of eight directions: at the straight rim of a surface three lead inwards and two along it
STRAIGHT = 5
LINES = ((0, 1), (1, 0), (1, 1), (1, -1))
MARGIN = 10
"""Pixels to each side of a map that `judge` looks at: twice the side of the largest window."""


@nb.njit(cache=True, nogil=True)
def box_sums(stack, black, reach, gain, zero, first, out):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sums over windows of what each frame exceeds black by, as a capture of 16 bits.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    black : int
        Frame.
    reach : int
        Windows reach so many pixels to every side; nearer to an edge of the image nothing is summed.
    gain, zero : float
        What a sum is multiplied by, and what is then added: the noise of black goes both ways.
    first : int
        Row of the image that is the first of `out`.
    out : ndarray of uint16, shape (frame, row, column)
        Filled; 0 where nothing is summed: in `reach` rows and columns at the edge of the image.
    """
    frames, H, W = stack.shape
    times, above = np.float32(gain), np.float32(zero + 0.5)
    down, dark, whole = np.zeros(W, np.int32), np.zeros(W, np.int32), np.zeros(W, np.int32)
    for i in range(out.shape[1]):
        row = first + i
        if row < reach or row >= H - reach:
            out[:, i] = 0
            continue
        _box_row(stack[black], row, reach, down, dark)
        for f in range(frames):
            _box_row(stack[f], row, reach, down, whole)
            _scale(whole, dark, times, above, out[f, i])
            out[f, i, :reach] = 0
            out[f, i, W - reach :] = 0


@nb.njit(cache=True, nogil=True, inline="never")
def _scale(whole, dark, times, above, out):  # type: ignore[no-untyped-def]  # numba infers
    low, high = np.float32(0), np.float32(65535)
    for j in range(out.size):
        out[j] = np.uint16(np.int32(min(max(np.float32(whole[j] - dark[j]) * times + above, low), high)))


@nb.njit(cache=True, nogil=True, inline="never")
def _box_row(frame, row, reach, down, whole):  # type: ignore[no-untyped-def]  # numba infers
    """Sums over the windows of a row of pixels, with `down` as room for those of columns; not set at the ends."""
    W = down.size
    a, b, c = frame[row - 1], frame[row], frame[row + 1]
    if reach == 1:
        for j in range(W):
            down[j] = np.int32(a[j]) + np.int32(b[j]) + np.int32(c[j])
        one, two, three = down[: W - 2], down[1 : W - 1], down[2:]
        middle = whole[1 : W - 1]
        for j in range(middle.size):
            middle[j] = one[j] + two[j] + three[j]
        return
    y, z = frame[row - 2], frame[row + 2]
    for j in range(W):
        down[j] = np.int32(y[j]) + np.int32(a[j]) + np.int32(b[j]) + np.int32(c[j]) + np.int32(z[j])
    one, two, three, four, five = down[: W - 4], down[1 : W - 3], down[2 : W - 2], down[3 : W - 1], down[4:]
    middle = whole[2 : W - 2]
    for j in range(middle.size):
        middle[j] = one[j] + two[j] + three[j] + four[j] + five[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def off_centre(white, black, reach, sd, out):  # type: ignore[no-untyped-def]  # numba infers
    """How far the light's centre lies from the middle of each window, px squared, less what is noise.

    Parameters
    ----------
    white, black : ndarray, shape (row, column)
        Counts.
    reach : int
    sd : float
        Noise of a pixel, counts.
    out : ndarray of float32, shape (2, row, column)
        Filled: down the image, along its rows.
    """
    H, W = white.shape
    square = 0
    for a in range(-reach, reach + 1):
        square += a * a * (2 * reach + 1)
    noise, zero, one = np.float32(2 * sd * sd * square), np.float32(0), np.float32(1)
    plain, moment = np.empty(W, np.float32), np.empty(W, np.float32)  # of columns
    total, by_row, by_column = np.empty(W, np.float32), np.empty(W, np.float32), np.empty(W, np.float32)
    out[:] = 0
    for i in range(reach, H - reach):
        plain[:], moment[:], total[:], by_row[:], by_column[:] = 0, 0, 0, 0, 0
        for a in range(-reach, reach + 1):
            w, b, arm = white[i + a], black[i + a], np.float32(a)
            for j in range(W):
                light = np.float32(w[j]) - np.float32(b[j])
                plain[j] += light
                moment[j] += arm * light
        for c in range(-reach, reach + 1):
            arm = np.float32(c)
            some, turn = plain[reach + c : W - reach + c], moment[reach + c : W - reach + c]
            for j in range(some.size):
                total[j] += some[j]
                by_row[j] += turn[j]
                by_column[j] += arm * some[j]
        down, along = out[0, i, reach : W - reach], out[1, i, reach : W - reach]
        for j in range(down.size):
            per = one / (total[j] * total[j])
            down[j] = max(by_row[j] * by_row[j] - noise, zero) * per
            along[j] = max(by_column[j] * by_column[j] - noise, zero) * per


@nb.njit(cache=True, nogil=True, error_model="numpy")
def judge(places, variances, off, reach, kept, sigmas):  # type: ignore[no-untyped-def]  # numba infers
    """Say which pixels lie on a surface that goes on across their window, and work out their sigmas.

    Going on straight from two places in a direction, a window's side apart and so of other pixels, must lead to the
    pixel, in `STRAIGHT` of eight directions and on all axes. A window that spans a step stands between two surfaces:
    along a line across it the map bends, or rises by more over the window than beyond it.

    Parameters
    ----------
    places, variances : ndarray of float32, shape (axis, row + 2 MARGIN, column + 2 MARGIN)
        Of all pixels, NaN where there is none.
    off : ndarray of float32, shape (2, row, column)
        Of `off_centre`.
    reach : int
    kept : ndarray of bool, shape (row, column)
        Filled.
    sigmas : ndarray of float32, shape (axis, row, column)
        Filled: noise, how far the light's centre in the window is off by the slope of the map, and the bend of the map
        over the window.
    """
    H, W = kept.shape
    side = 2 * reach + 1
    straight, torn, on = np.empty(W, np.uint8), np.empty(W, np.bool_), np.empty(W, np.bool_)
    flat, nine = np.float32(FLAT_PX), np.float32(SURE * SURE)
    for i in range(H):
        straight[:], torn[:] = 0, False
        m = i + MARGIN
        for line in range(4):
            y, x = LINES[line][0] * side, LINES[line][1] * side
            for sign in (-1, 1):
                on[:] = True
                for n in range(len(places)):
                    _leads_here(places[n], variances[n], m, sign * y, sign * x, flat, nine, on)
                for j in range(W):
                    straight[j] += on[j]
            for n in range(len(places)):
                _tears(places[n], variances[n], m, y, x, flat, nine, torn)
        for j in range(W):
            kept[i, j] = (straight[j] >= STRAIGHT) & ~torn[j]
        for n in range(len(places)):
            _smears(places[n], variances[n], m, off[0, i], off[1, i], reach, sigmas[n, i])


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="never")
def _leads_here(place, variance, m, y, x, flat, nine, on):  # type: ignore[no-untyped-def]  # numba infers
    """Take `on` away where two places in a direction do not lead straight to the pixel, or are unknown."""
    W, s, t = on.size, MARGIN + x, MARGIN + 2 * x
    here, own = place[m, MARGIN : MARGIN + W], variance[m, MARGIN : MARGIN + W]
    near, near_v = place[m + y, s : s + W], variance[m + y, s : s + W]
    far, far_v = place[m + 2 * y, t : t + W], variance[m + 2 * y, t : t + W]
    four, zero = np.float32(4), np.float32(0)
    for j in range(W):
        miss = abs(here[j] - (near[j] + near[j]) + far[j])
        over = max(miss - flat, zero)
        on[j] &= (over * over <= nine * (own[j] + four * near_v[j] + far_v[j])) & (miss == miss)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="never")
def _tears(place, variance, m, y, x, flat, nine, torn):  # type: ignore[no-untyped-def]  # numba infers
    """Set `torn` where along a line the map bends across the window, or rises by more over it than beyond."""
    W, at = torn.size, MARGIN
    here, own = place[m, at : at + W], variance[m, at : at + W]
    p, vp = place[m - y, at - x : at - x + W], variance[m - y, at - x : at - x + W]
    q, vq = place[m + y, at + x : at + x + W], variance[m + y, at + x : at + x + W]
    pp, vpp = place[m - 2 * y, at - 2 * x : at - 2 * x + W], variance[m - 2 * y, at - 2 * x : at - 2 * x + W]
    qq, vqq = place[m + 2 * y, at + 2 * x : at + 2 * x + W], variance[m + 2 * y, at + 2 * x : at + 2 * x + W]
    four, half, quarter, zero = np.float32(4), np.float32(0.5), np.float32(0.25), np.float32(0)
    for j in range(W):
        bend = max(abs(p[j] - (here[j] + here[j]) + q[j]) - flat, zero)
        jump = max(abs((q[j] - p[j]) - half * (qq[j] - pp[j])) - flat, zero)
        bends = bend * bend > nine * (vp[j] + four * own[j] + vq[j])
        jumps = jump * jump > nine * (vp[j] + vq[j] + quarter * (vpp[j] + vqq[j]))
        torn[j] |= bends | jumps  # false where a place is unknown


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="never")
def _smears(place, variance, m, down, along, reach, sigma):  # type: ignore[no-untyped-def]  # numba infers
    """Sigma of a row of pixels: noise, slope times the distance of the light's centre, and the bend of the map."""
    W, at, side = sigma.size, MARGIN, 2 * reach + 1
    per, zero = np.float32(1 / (2 * side)), np.float32(0)
    share = np.float32((reach * (reach + 1) / (6.0 * side * side)) ** 2)  # a parabola's mean over the window
    here, own = place[m, at : at + W], variance[m, at : at + W]
    four = np.float32(4)
    for j in range(W):
        sigma[j] = own[j]
    for line in range(2):
        y, x = (side, 0) if line == 0 else (0, side)
        off = down if line == 0 else along
        p, vp = place[m - y, at - x : at - x + W], variance[m - y, at - x : at - x + W]
        q, vq = place[m + y, at + x : at + x + W], variance[m + y, at + x : at + x + W]
        for j in range(W):
            slope, bend = (q[j] - p[j]) * per, p[j] - (here[j] + here[j]) + q[j]
            more = slope * slope * off[j] + max(bend * bend - (vp[j] + four * own[j] + vq[j]), zero) * share
            sigma[j] += more if more == more else zero
    for j in range(W):
        sigma[j] = np.sqrt(sigma[j])
