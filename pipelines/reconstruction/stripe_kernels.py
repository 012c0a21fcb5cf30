"""Compiled loops of the soft decoder of stripes: the blur of a tile, the most likely place of a pixel, its neighbours."""

from __future__ import annotations

import numba as nb
import numpy as np

from .stripe_model import WIDTH

__all__ = ["locate_pixels", "support", "tile_power"]

ROOM = 256  # coarse samples that may be compared for one pixel: 4 each of 64 projector pixels
NOT_MEASURED = 255
LOOSE = frozenset({"reassoc", "contract", "arcp", "nsz"})  # sums may be reordered: what vector instructions need


@nb.njit(cache=True, nogil=True, error_model="numpy")
def tile_power(stack, white, black, plus, minus, bits, tile, lit, loss, power, weight):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
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


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=LOOSE, inline="always")
def _cost(seen, model, q, more):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Squared distance of what is seen from what a sample of the model expects, in variances."""
    total = np.float32(0)
    for k in range(WIDTH):
        e = model[0, k]
        d = seen[k] - e
        total += d * d / (more + q * (np.float32(1) + e * e) + model[1, k])
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def locate_pixels(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack,
    white,
    black,
    plus,
    minus,
    bits,
    shift,
    gain,
    blur,
    tile,
    swing,
    first,
    candidate,
    per_px,
    lit,
    noise,
    floor,
    far,
    margin,
    worst,
    rows,
    place,
    sigma,
    cost,
):
    """Find where on the projector each pixel of some rows looks.

    Every projector pixel that may read as the pixel's word is compared with it at samples of the model; the best is the
    place, if none farther off than `far` comes near it.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    plus, minus : ndarray of int64, shape (bits,)
    shift, gain : ndarray of float32, shape (bits,)
        What flicker added to the swing of each bit, and times how much.
    blur : ndarray of uint8, shape (tile row, tile column)
        Which blur of the model.
    swing, first, candidate, per_px
        Of the `SwingModel`.
    lit, noise, floor : float
        Least white minus black, standard deviation of pattern minus inverse, counts; error of the model, of the swing.
    far : float
        px: two places nearer than this are one, and the spread between them is part of sigma.
    margin, worst : float
        Least difference of cost from the best far place; largest cost.
    rows : ndarray of int64
        Rows to visit.
    place, sigma, cost : ndarray of float32, shape (len(rows), column)
        Filled; NaN, except of `cost` (-1 where unlit).
    """
    W = stack.shape[2]
    full = np.iinfo(stack.dtype).max
    seen = np.zeros(WIDTH, np.float32)
    costs = np.empty(ROOM, np.float32)
    samples = np.empty(ROOM, np.int32)
    stride = 2
    inverse = np.float32(1.0 / per_px)
    last = swing.shape[1] - 1
    nan = np.float32(np.nan)
    more0 = np.float32(floor * floor)
    for n in range(rows.size):
        i = rows[n]
        for j in range(W):
            place[n, j] = nan
            sigma[n, j] = nan
            cost[n, j] = -1
            w, k = np.float32(stack[white, i, j]), np.float32(stack[black, i, j])
            light = w - k
            if light < lit:
                continue
            share = np.float32(1) / light
            word = 0
            for bit in range(bits):
                p = np.float32(stack[plus[bit], i, j])
                if minus[bit] >= 0:
                    s = (p - np.float32(stack[minus[bit], i, j])) * share
                else:
                    s = (p + p - w - k) * share
                s = (s - shift[bit]) * gain[bit]
                seen[bit] = s
                word = (word << 1) | (s > 0)
            q = np.float32(noise * share)
            q = q * q
            more = more0
            if stack[white, i, j] == full:
                more = more + np.float32(0.02)  # white was cut off: the swings are too large, by how much is not known
            level = blur[i // tile, j // tile]
            model = swing[level]
            count = 0
            best = np.float32(1e30)
            at = 0
            for c in range(first[level, word], first[level, word + 1]):
                start = candidate[c] * per_px
                if count + 4 > ROOM:
                    break
                for sample in range(start + stride // 2, start + per_px, stride):
                    here = _cost(seen, model[sample], q, more)
                    costs[count] = here
                    samples[count] = sample
                    count += 1
                    if here < best:
                        best = here
                        at = sample
            cost[n, j] = best
            if count == 0:
                continue
            # down to the lowest cost between the samples
            middle = at
            while True:
                lower = _cost(seen, model[at - 1], q, more) if at > 0 else np.float32(1e30)
                if lower < best:
                    best = lower
                    at -= 1
                    continue
                upper = _cost(seen, model[at + 1], q, more) if at < last else np.float32(1e30)
                if upper < best:
                    best = upper
                    at += 1
                    continue
                break
            cost[n, j] = best
            if best > worst:
                continue
            # the spread of what is as likely nearby; the best of what is far
            reach = far * per_px
            total, mean, square = 0.0, 0.0, 0.0
            rival = np.float32(1e30)
            for m in range(count):
                away = samples[m] - middle
                if abs(away) > reach:
                    rival = min(rival, costs[m])
                else:
                    weight = np.exp(-0.5 * max(costs[m] - best, np.float32(0)))
                    total += weight
                    mean += weight * away
                    square += weight * away * away
            if rival - best < margin:
                continue
            # Gauss and Newton from the best sample
            before, here, after = model[max(at - 1, 0)], model[at], model[min(at + 1, last)]
            curvature, slope = np.float32(0), np.float32(0)
            for bit in range(bits):
                rise = (after[0, bit] - before[0, bit]) * np.float32(0.5)
                e = here[0, bit]
                variance = more + q * (np.float32(1) + e * e) + here[1, bit]
                curvature += rise * rise / variance
                slope += rise * (seen[bit] - e) / variance
            spread = 1.0 / np.sqrt(max(curvature, np.float32(1e-12)))  # samples
            if total > 0:
                mean /= total
                wide = np.sqrt(max(square / total - mean * mean, 0.0))
            else:
                mean, wide = 0.0, 0.0
            if wide > stride and wide > spread * 0.8:
                found = middle + mean
                spread = wide
            else:
                found = at + min(max(slope / max(curvature, np.float32(1e-12)), -1.0), 1.0)
                spread = min(spread, reach)
            place[n, j] = (found + 0.5) * inverse - 0.5
            sigma[n, j] = spread * inverse


@nb.njit(cache=True, nogil=True, error_model="numpy")
def support(place, near, least, keep):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Tell which pixels have at least `least` of their eight neighbours within `near` px."""
    H, W = place.shape
    for i in range(H):
        for j in range(W):
            here = place[i, j]
            keep[i, j] = False
            if not here == here:
                continue
            found = 0
            for a in range(max(i - 1, 0), min(i + 2, H)):
                for b in range(max(j - 1, 0), min(j + 2, W)):
                    if abs(place[a, b] - here) <= near:
                        found += 1
            keep[i, j] = found > least
