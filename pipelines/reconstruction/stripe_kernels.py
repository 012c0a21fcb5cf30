"""Compiled loops of the soft decoder of stripes: the most likely place of a pixel."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

from .apart import read, write
from .stripe_model import GROUP, LANES, STRIDE, WIDTH
from .stripe_swings import BLOCK, read_swings

__all__ = ["StripePlaces", "StripeView", "locate_pixels", "reject_washed"]

F32 = npt.NDArray[np.float32]

FAR = 1e30
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
    swing, comb, loose, power, blank, first, candidate, per_px
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
    comb: F32
    loose: F32
    loosest: F32
    power: F32
    blank: npt.NDArray[np.bool_]
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
        Whether the place is one that `SwingModel.blank` names.
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


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE)
def _distance(seen, j, swing, level, sample):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Squared distance of what pixel `j` of a block saw from what a sample of the model expects.

    The whole tables are handed on: a row of one would be a new array, whose references are counted, at the cost of five
    distances.
    """
    total, at, pixel = np.float32(0), np.uintp(sample), np.uintp(j)
    for k in range(WIDTH):
        d = seen[pixel, np.uintp(k)] - swing[np.uintp(level), at, np.uintp(k)]
        total += d * d
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE)
def _fit(seen, j, swing, loose, level, sample, q, more):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The same in variances (of noise, white minus black, the model's own error, the blur): what a place costs.

    With it Gauss and Newton's step from the sample, and its standard uncertainty, samples.
    """
    lev, at, pixel = np.uintp(level), np.uintp(sample), np.uintp(j)
    before, after = np.uintp(max(sample - 1, 0)), np.uintp(min(sample + 1, swing.shape[1] - 1))
    cost, curvature, slope = np.float32(0), np.float32(1e-9), np.float32(0)
    for k in range(WIDTH):
        n = np.uintp(k)
        e = swing[lev, at, n]
        d, rise = seen[pixel, n] - e, (swing[lev, after, n] - swing[lev, before, n]) * np.float32(0.5)
        known = np.float32(1) / (more + q * (np.float32(1) + e * e) + loose[lev, at, n])
        cost += d * d * known
        curvature += rise * rise * known
        slope += rise * d * known
    return cost, slope / curvature, np.float32(1) / np.sqrt(curvature)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _scan(seen, j, word, near, swing, level, first, candidate, per_px, distances, samples):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The sample most like what is seen among the candidates of a word, and the most like it of those not near it."""
    begin = first[level, word]
    count = first[level, word + 1] - begin
    best, at = np.float32(FAR), -1
    for c in range(count):
        start = candidate[begin + c] * per_px
        least, where = np.float32(FAR), start
        for sample in range(start + STRIDE // 2, start + per_px, STRIDE):
            here = _distance(seen, j, swing, level, sample)
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


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE)
def _compare(seen, j, comb, length, begin, size, groups, distances):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Squared distances of `size` samples, the first of which is `begin` in the comb's first line of a level."""
    pixel = np.uintp(j)
    for c in range(size):
        distances[c] = 0
    for group in range(groups):
        bit, at = np.uintp(GROUP * group), begin + GROUP * group * length
        s0, s1 = seen[pixel, bit], seen[pixel, bit + np.uintp(1)]
        s2, s3 = seen[pixel, bit + np.uintp(2)], seen[pixel, bit + np.uintp(3)]
        for c in range(size):
            d0, d1 = s0 - read(comb, at + c), s1 - read(comb, at + length + c)
            d2, d3 = s2 - read(comb, at + 2 * length + c), s3 - read(comb, at + 3 * length + c)
            write(distances, c, distances[c] + d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3)


@nb.njit(cache=True, nogil=True)
def _nearest(codes, size):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The first place of the least distance: what has no sign has the order of its bits, which need no branch."""
    best = np.int64(0x7FFFFFFFFFFFFFFF)
    for c in range(size):
        best = min(best, (np.int64(codes[c]) << 32) | c)
    return best & 0xFFFFFFFF


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _around(seen, j, middle, near, swing, comb, level, groups, distances, codes):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Compare every other sample near one: the sample most like what is seen, the first compared, how many."""
    last = swing.shape[1] - 1
    low = max(middle - near, 0)
    count = ((min(middle + near, last) - low) >> 1) + 1
    size, length = (count + LANES - 1) // LANES * LANES, (last + 1) >> 1  # whole registers: odd ends cost more
    _compare(seen, j, comb, length, (level * 2 + (low & 1)) * WIDTH * length + (low >> 1), size, groups, distances)
    for c in range(count, size):
        distances[c] = FAR
    nearest = _nearest(codes, size)
    at = low + 2 * nearest
    best = distances[nearest]
    before = _distance(seen, j, swing, level, max(at - 1, 0))
    after = _distance(seen, j, swing, level, min(at + 1, last))
    aside = -1 if before <= after else 1
    odd = min(before, after)
    return min(best, odd), at + aside if odd < best else at, low, count


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _likely(distances, count, low, at, off, scale, spread):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Mean and standard deviation of the places about as likely as the best one, samples from it; -1: there is none."""
    limit, number = off + np.float32(16) / scale, 0
    for c in range(count):
        number += distances[c] < limit
    for c in range(max((at - low - 1) >> 1, 0), min(((at - low + 2) >> 1) + 1, count)):
        number -= distances[c] < limit
    if number == 0 and spread <= STRIDE:  # none is farther away than `STRIDE`: neither is their standard deviation
        return np.float32(0), np.float32(0)
    total, mean, square = np.float32(0), np.float32(0), np.float32(0)
    for c in range(count):
        more_costly = (distances[c] - off) * scale
        if more_costly < np.float32(16):
            weight = np.exp(np.float32(-0.5) * more_costly)
            away = np.float32(low + c * STRIDE - at)
            total += weight
            mean += weight * away
            square += weight * away * away
    if total == 0:
        return np.float32(0), np.float32(-1)
    mean /= total
    return mean, np.sqrt(max(square / total - mean * mean, np.float32(0)))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _room(first, near):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """How many samples, or candidates of a word, are compared at most."""
    room = 2 * near + 2 + LANES
    for level in range(len(first)):
        for word in range(first.shape[1] - 1):
            room = max(room, first[level, word + 1] - first[level, word])
    return room


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
    swing, comb, loose, loosest, power = view.swing, view.comb, view.loose, view.loosest, view.power
    first, candidate, unlike, per_px, near = view.first, view.candidate, view.unlike, view.per_px, view.near
    blur, tile, margin, worst, blanks = view.blur, view.tile, view.margin, view.worst, view.blank
    stack, white, black, lit, noise, floor = view.stack, view.white, view.black, view.lit, view.noise, view.floor
    plus, minus, shift, gain = view.plus, view.minus, view.shift, view.gain
    place, sigma, cost, coarser, blank = found.place, found.sigma, found.cost, found.coarser, found.blank
    bits, W = plus.size, stack.shape[2]
    groups, full, nan = (bits + GROUP - 1) // GROUP, np.iinfo(stack.dtype).max, np.float32(np.nan)
    room = _room(first, near)
    distances, samples = np.empty(room, np.float32), np.empty(room, np.int32)
    codes = distances.view(np.int32)
    lanes, seen = np.zeros((WIDTH + 1, BLOCK), np.float32), np.empty((BLOCK, WIDTH), np.float32)
    light = np.empty(BLOCK, np.float32)
    above = np.full(W, -1, np.int32)
    for n in range(rows.size):
        i = rows[n]
        guess = -1
        for j in range(W):
            b = j % BLOCK
            if b == 0:
                read_swings(
                    stack, white, black, plus, minus, shift, gain, i, j, lanes, seen, light[: min(BLOCK, W - j)]
                )  # fmt: skip
            place[n, j], sigma[n, j], cost[n, j], blank[n, j] = nan, nan, nan, False
            if light[b] < lit:
                guess = -1
                above[j] = -1
                continue
            q = np.float32(noise) / light[b]
            q = q * q
            more = np.float32(floor * floor)
            if stack[white, i, j] == full:
                more += np.float32(CUT_OFF)
            level = blur[i // tile, j // tile]
            if guess < 0:
                guess = above[j]
            off, best, step, spread = np.float32(FAR), np.float32(FAR), np.float32(0), np.float32(0)
            at, low, count, sure = -1, 0, 0, False
            if guess >= 0:
                off, at, low, count = _around(seen, b, guess, near, swing, comb, level, groups, distances, codes)
                best, step, spread = _fit(seen, b, swing, loose, level, at, q, more)
                gap = unlike[level, at] - np.sqrt(off)
                sure = gap > 0 and gap * gap > (margin + best) * (more + 2 * q + loosest[level])
            if not (sure and best < 0.5 * worst):
                word = 0
                for bit in range(bits):
                    word = (word << 1) | (seen[b, bit] > 0)
                at, rival = _scan(seen, b, word, near, swing, level, first, candidate, per_px, distances, samples)
                if at < 0:
                    guess = -1
                    above[j] = -1
                    cost[n, j] = FAR
                    continue
                off, at, low, count = _around(seen, b, at, near, swing, comb, level, groups, distances, codes)
                best, step, spread = _fit(seen, b, swing, loose, level, at, q, more)
                sure = rival < 0 or _fit(seen, b, swing, loose, level, rival, q, more)[0] - best > margin
            cost[n, j] = best
            sure = sure and best <= worst
            guess = at if sure else -1
            above[j] = guess
            if not sure:
                continue
            here = at + min(max(step, np.float32(-1)), np.float32(1))
            mean, wide = _likely(distances, count, low, at, off, np.float32(1) / (more + q), spread)
            # where other places nearby are as likely: their mean and spread
            if wide >= 0 and (spread > STRIDE or (wide > STRIDE and wide > np.float32(0.8) * spread)):
                here = at + mean
                spread = np.sqrt(wide * wide + np.float32(STRIDE * STRIDE / 12))
            hidden = 0
            while hidden < bits - 1 and power[level, bits - 1 - hidden] < q:
                hidden += 1
            coarser[n, j] = hidden
            blank[n, j] = blanks[level, at]
            place[n, j] = (here + np.float32(0.5)) / per_px - np.float32(0.5)
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
