"""Compiled loops of the soft decoder of stripes: the blur of a tile, the most likely place of a pixel."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from .stripe_model import DOUBT, WIDTH

__all__ = ["StripePlaces", "StripeView", "locate_pixels", "reject_washed", "tile_power"]

F32 = npt.NDArray[np.float32]

STRIDE = 2  # every other sample is enough to find the best
FAR = 1e30
BLANK = 4  # so many patterns at once that are neither black nor white are a boundary of all, or light from elsewhere
PLAIN = 0.1  # mean square of the swings of a pattern that blur leaves plain to see
CUT_OFF = 0.02  # variance of swings where white is saturated: they are too large, by how much is not known
LOOSE = {"reassoc", "contract", "arcp", "nsz"}  # sums may be reordered: what vector instructions need


class StripeView(NamedTuple):
    """One axis of a capture of stripes, as the kernels take it.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    white, black : int
        Frames.
    plus, minus : ndarray of int64, shape (bits,)
        Frames of the patterns, coarsest first, and of their inverses (-1: none).
    shift, gain : ndarray of float32, shape (bits,)
        What flicker added to the swing of each bit, and times how much it has to be taken.
    blur : ndarray of uint8, shape (tile row, tile column)
        Which blur of the model.
    tile : int
        Side, camera px.
    swing, loose, power, first, candidate, per_px
        Of the `SwingModel`.
    loosest : ndarray of float32, shape (blur,)
        Largest of `loose`.
    unlike : ndarray of float32, shape (blur, sample)
        `stripe_model.apart`.
    near : int
        Samples: two places no farther apart are one, and the spread between them is part of sigma.
    lit, noise, floor : float
        Least white minus black, standard deviation of pattern minus inverse, counts; error of the model, of the swing.
    margin, worst : float
        Least difference of cost from the best far place; largest cost.
    """

    stack: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    white: int
    black: int
    plus: npt.NDArray[np.int64]
    minus: npt.NDArray[np.int64]
    shift: F32
    gain: F32
    blur: npt.NDArray[np.uint8]
    tile: int
    swing: F32
    loose: F32
    loosest: F32
    power: F32
    first: npt.NDArray[np.int32]
    candidate: npt.NDArray[np.int32]
    unlike: F32
    per_px: int
    near: int
    lit: float
    noise: float
    floor: float
    margin: float
    worst: float


class StripePlaces(NamedTuple):
    """What is found of some rows of an image, arrays of shape (row, column).

    Parameters
    ----------
    place, sigma, cost : ndarray of float32
        NaN where not found, `cost` where unlit.
    coarser : ndarray of uint8
        How many of the finest patterns the noise hides.
    blank : ndarray of bool
        Whether the place is one at which `BLANK` and more patterns are neither black nor white.
    """

    place: F32
    sigma: F32
    cost: F32
    coarser: npt.NDArray[np.uint8]
    blank: npt.NDArray[np.bool_]

    @staticmethod
    def room(shape: tuple[int, int]) -> StripePlaces:
        """Arrays to be filled."""
        place, sigma, cost = np.empty((3, *shape), np.float32)
        return StripePlaces(place, sigma, cost, np.zeros(shape, np.uint8), np.empty(shape, np.bool_))

    def rows(self, first: int, last: int) -> StripePlaces:
        """Those of a stretch of rows."""
        part = slice(first, last)
        return StripePlaces(self.place[part], self.sigma[part], self.cost[part], self.coarser[part], self.blank[part])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def tile_power(stack, white, black, plus, minus, tile, lit, loss, power, weight):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sum over the lit pixels of each tile what blur leaves of the stripes.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    plus, minus : ndarray of int64, shape (bits,)
    tile : int
        Side, camera px.
    lit, loss : float
        Least white minus black, counts; variance of pattern minus inverse, which is taken off.
    power, weight : ndarray of float64, shape (tile row, tile column, bits) and (tile row, tile column)
        Filled: squares of pattern minus inverse, and of white minus black.
    """
    H, W = stack.shape[1:]
    bits = plus.size
    for a in range(weight.shape[0]):
        for b in range(weight.shape[1]):
            weight[a, b] = 0
            power[a, b] = 0
    for i in range(H):
        a = i // tile
        for j in range(W):
            w, k = float(stack[white, i, j]), float(stack[black, i, j])
            if w - k < lit:
                continue
            b = j // tile
            weight[a, b] += (w - k) * (w - k) - loss
            for bit in range(bits):
                p = float(stack[plus[bit], i, j])
                swing = p - float(stack[minus[bit], i, j]) if minus[bit] >= 0 else 2 * p - w - k
                power[a, b, bit] += swing * swing - loss


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE)
def _distance(seen, swing, level, sample):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Squared distance of what is seen from what a sample of the model expects.

    The whole table is handed on: a row of it would be a new array, whose references are counted, at the cost of five
    distances.
    """
    total, at = np.float32(0), np.uintp(sample)
    for k in range(WIDTH):
        d = seen[k] - swing[np.uintp(level), at, np.uintp(k)]
        total += d * d
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE)
def _cost(seen, swing, loose, level, sample, q, more):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The same in variances: of noise, of white minus black, of the model's own error, of the blur."""
    total, at = np.float32(0), np.uintp(sample)
    for k in range(WIDTH):
        e = swing[np.uintp(level), at, np.uintp(k)]
        d = seen[k] - e
        total += d * d / (more + q * (np.float32(1) + e * e) + loose[np.uintp(level), at, np.uintp(k)])
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _scan(seen, word, near, swing, level, first, candidate, per_px, distances, samples):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The sample most like what is seen among the candidates of a word, and the most like it of those not near it."""
    begin = first[level, word]
    count = first[level, word + 1] - begin
    best, at = np.float32(FAR), -1
    for c in range(count):
        start = candidate[begin + c] * per_px
        least, where = np.float32(FAR), start
        for sample in range(start + STRIDE // 2, start + per_px, STRIDE):
            here = _distance(seen, swing, level, sample)
            if here < least:
                least, where = here, sample
        distances[c], samples[c] = least, where
        if least < best:
            best, at = least, where
    rival, other = np.float32(FAR), -1
    for c in range(count):
        if distances[c] < rival and abs(samples[c] - at) > near:
            rival, other = distances[c], samples[c]
    return at, other


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _around(seen, middle, near, swing, level, distances):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Compare every other sample near one: the sample most like what is seen, the first compared, how many."""
    last = swing.shape[1] - 1
    low = max(middle - near, 0)
    count = (min(middle + near, last) - low) // STRIDE + 1
    best, at = np.float32(FAR), low
    for c in range(count):
        here = _distance(seen, swing, level, low + c * STRIDE)
        distances[c] = here
        if here < best:
            best, at = here, low + c * STRIDE
    middle = at
    for sample in (middle - 1, middle + 1):
        if 0 <= sample <= last:
            here = _distance(seen, swing, level, sample)
            if here < best:
                best, at = here, sample
    return best, at, low, count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def locate_pixels(view, rows, found):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Find where on the projector each pixel of some rows looks.

    The samples of the model around the place of the neighbour are compared first. If one of them fits, and no place far
    from it can (`unlike`), it is the place; else every projector pixel that may read as the pixel's word is compared,
    and the best is the place if none far from it comes near.

    Parameters
    ----------
    view : StripeView
    rows : ndarray of int64
        Rows to visit.
    found : StripePlaces
        Filled.
    """
    stack, white, black, plus, minus = view.stack, view.white, view.black, view.plus, view.minus
    shift, gain, blur, tile = view.shift, view.gain, view.blur, view.tile
    swing, loose, loosest, power = view.swing, view.loose, view.loosest, view.power
    first, candidate, unlike, per_px, near = view.first, view.candidate, view.unlike, view.per_px, view.near
    lit, noise, floor, margin, worst = view.lit, view.noise, view.floor, view.margin, view.worst
    place, sigma, cost, coarser, blank = found.place, found.sigma, found.cost, found.coarser, found.blank
    bits = plus.size
    W = stack.shape[2]
    full = np.iinfo(stack.dtype).max
    seen = np.zeros(WIDTH, np.float32)
    room = 2 * near + 2
    for level in range(len(first)):
        for candidates in range(first.shape[1] - 1):
            room = max(room, first[level, candidates + 1] - first[level, candidates])
    distances, samples = np.empty(room, np.float32), np.empty(room, np.int32)
    above = np.full(W, -1, np.int32)
    last = swing.shape[1] - 1
    nan = np.float32(np.nan)
    for n in range(rows.size):
        i = rows[n]
        guess = -1
        for j in range(W):
            place[n, j], sigma[n, j], cost[n, j], blank[n, j] = nan, nan, nan, False
            w, k = np.float32(stack[white, i, j]), np.float32(stack[black, i, j])
            light = w - k
            if light < lit:
                guess = -1
                above[j] = -1
                continue
            share = np.float32(1) / light
            word = 0
            for bit in range(bits):
                p = np.float32(stack[plus[bit], i, j])
                other = np.float32(stack[minus[bit], i, j]) if minus[bit] >= 0 else w + k - p
                s = ((p - other) * share - shift[bit]) * gain[bit]
                seen[bit] = s
                word = (word << 1) | (s > 0)
            q = np.float32(noise * share)
            q = q * q
            more = np.float32(floor * floor)
            if stack[white, i, j] == full:
                more += np.float32(CUT_OFF)
            level = blur[i // tile, j // tile]
            if guess < 0:
                guess = above[j]
            off, best, at, low, count, sure = np.float32(FAR), np.float32(FAR), -1, 0, 0, False
            if guess >= 0:
                off, at, low, count = _around(seen, guess, near, swing, level, distances)
                best = _cost(seen, swing, loose, level, at, q, more)
                gap = unlike[level, at] - np.sqrt(off)
                sure = gap > 0 and gap * gap > (margin + best) * (more + 2 * q + loosest[level])
            if not (sure and best < 0.5 * worst):
                at, rival = _scan(seen, word, near, swing, level, first, candidate, per_px, distances, samples)
                if at < 0:
                    guess = -1
                    above[j] = -1
                    cost[n, j] = FAR
                    continue
                off, at, low, count = _around(seen, at, near, swing, level, distances)
                best = _cost(seen, swing, loose, level, at, q, more)
                sure = rival < 0 or _cost(seen, swing, loose, level, rival, q, more) - best > margin
            cost[n, j] = best
            sure = sure and best <= worst
            guess = at if sure else -1
            above[j] = guess
            if not sure:
                continue
            # Gauss and Newton from the best sample
            before, after = max(at - 1, 0), min(at + 1, last)
            curvature, slope = np.float32(1e-9), np.float32(0)
            for bit in range(bits):
                rise = (swing[level, after, bit] - swing[level, before, bit]) * np.float32(0.5)
                e = swing[level, at, bit]
                weight = np.float32(1) / (more + q * (np.float32(1) + e * e) + loose[level, at, bit])
                curvature += rise * rise * weight
                slope += rise * (seen[bit] - e) * weight
            found = at + min(max(slope / curvature, np.float32(-1)), np.float32(1))
            spread = np.float32(1) / np.sqrt(curvature)
            # where other places nearby are as likely: their mean and spread
            total, mean, square = np.float32(0), np.float32(0), np.float32(0)
            scale = np.float32(1) / (more + q)
            for c in range(count):
                more_costly = (distances[c] - off) * scale
                if more_costly < np.float32(16):
                    weight = np.exp(np.float32(-0.5) * more_costly)
                    away = np.float32(low + c * STRIDE - at)
                    total += weight
                    mean += weight * away
                    square += weight * away * away
            if total > 0:
                mean /= total
                wide = np.sqrt(max(square / total - mean * mean, np.float32(0)))
                if spread > STRIDE or (wide > STRIDE and wide > np.float32(0.8) * spread):
                    found = at + mean
                    spread = np.sqrt(wide * wide + np.float32(STRIDE * STRIDE / 12))
            hidden = 0
            while hidden < bits - 1 and power[level, bits - 1 - hidden] < q:
                hidden += 1
            coarser[n, j] = hidden
            grey = 0
            for bit in range(bits):
                grey += abs(swing[level, at, bit]) < DOUBT and power[level, bit] > PLAIN
            blank[n, j] = grey >= BLANK
            place[n, j] = (found + np.float32(0.5)) / per_px - np.float32(0.5)
            sigma[n, j] = min(spread, np.float32(near)) / per_px


@nb.njit(cache=True, nogil=True, error_model="numpy")
def reject_washed(place, blank, away, same_px, first, last, washed):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Tell the pixels that read as a boundary of many patterns because light from elsewhere has washed them all out.

    On a surface the neighbours at a distance are at other places, those along the boundary aside; in a washed out patch
    they read as the same one, beyond its rim aside.

    Parameters
    ----------
    place : ndarray of float32, shape (row, column)
    blank : ndarray of bool, shape (row, column)
        Of `locate_pixels`.
    away : int
        Camera px in which a surface passes the boundary.
    same_px : float
    first, last : int
        Rows to do.
    washed : ndarray of bool, shape (row, column)
        Filled.
    """
    H, W = place.shape
    for i in range(first, last):
        for j in range(W):
            washed[i, j] = False
            if not blank[i, j]:
                continue
            same, other = 0, 0
            for a, b in ((-away, 0), (away, 0), (0, -away), (0, away)):
                if 0 <= i + a < H and 0 <= j + b < W:
                    beside = place[i + a, j + b]
                    if abs(beside - place[i, j]) < same_px:
                        same += 1
                    elif beside == beside:
                        other += 1
            washed[i, j] = same >= 3 or (same > 0 and other == 0)
