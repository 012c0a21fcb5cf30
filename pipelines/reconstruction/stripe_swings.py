"""Compiled loops that read the swings of stripes off the frames: of a block of pixels, and their power in tiles.

A line of the image after the other, a pattern after the other: so memory is read as it lies, all pixels at once.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .stripe_model import WIDTH

__all__ = ["BLOCK", "read_swings", "tile_power"]

BLOCK = 256  # pixels that are read at once: their swings stay in the cache


@nb.njit(cache=True, nogil=True, error_model="numpy")
def read_swings(stack, white, black, plus, minus, shift, gain, i, start, lanes, seen, light):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Read the pixels of a part of row `i`, from column `start` on.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    white, black : int
    plus, minus : ndarray of int64, shape (bits,)
    shift, gain : ndarray of float32, shape (bits,)
        As of `StripeView`.
    lanes : ndarray of float32, shape (WIDTH + 1, BLOCK)
        Room; bits beyond the last are 0.
    seen : ndarray of float32, shape (BLOCK, WIDTH)
        Filled: pattern minus inverse over white minus black, without flicker.
    light : ndarray of float32, shape (n,)
        Filled: white minus black. Its length says how many pixels are read.
    """
    size = light.size
    w, k = stack[white, i, start : start + size], stack[black, i, start : start + size]
    share = lanes[WIDTH]
    for j in range(size):
        light[j] = np.float32(w[j]) - np.float32(k[j])
        share[j] = np.float32(1) / light[j]
    for bit in range(plus.size):
        off, times, lane = shift[bit], gain[bit], lanes[bit]
        p = stack[plus[bit], i, start : start + size]
        if minus[bit] >= 0:
            q = stack[minus[bit], i, start : start + size]
            for j in range(size):
                lane[j] = ((np.float32(p[j]) - np.float32(q[j])) * share[j] - off) * times
        else:
            for j in range(size):
                twice = np.float32(p[j]) - (np.float32(w[j]) + np.float32(k[j]) - np.float32(p[j]))
                lane[j] = (twice * share[j] - off) * times
    for j in range(size):
        for bit in range(WIDTH):
            seen[j, bit] = lanes[bit, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def tile_power(stack, white, black, plus, minus, tile, lit, loss, power, weight, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
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
    first, last : int
        Rows of tiles to do.
    """
    H, W = stack.shape[1:]
    bits = plus.size
    least = np.float32(lit)
    full, count = np.empty(W, np.float32), np.empty(W, np.float32)
    squares = np.empty((bits + 1, W), np.float32)
    for a in range(first, last):
        squares[:] = 0
        count[:] = 0
        for i in range(a * tile, min((a + 1) * tile, H)):
            w, k = stack[white, i], stack[black, i]
            _light(w, k, least, full, count, squares[bits])
            for bit in range(bits):
                if minus[bit] >= 0:
                    _add_pair(stack[plus[bit], i], stack[minus[bit], i], full, squares[bit])
                else:
                    _add_single(stack[plus[bit], i], w, k, full, squares[bit])
        for b in range(weight.shape[1]):
            begin, end = b * tile, min((b + 1) * tile, W)
            number = loss * count[begin:end].sum()
            weight[a, b] = squares[bits, begin:end].sum() - number
            for bit in range(bits):
                power[a, b, bit] = squares[bit, begin:end].sum() - number


@nb.njit(cache=True, nogil=True)
def _light(w, k, least, full, count, squares):  # type: ignore[no-untyped-def]  # numba infers
    """1 where lit, else 0; add up how many, and the squares of white minus black."""
    for j in range(full.size):
        light = np.float32(w[j]) - np.float32(k[j])
        one = np.float32(light >= least)
        full[j] = one
        count[j] += one
        squares[j] += one * light * light


@nb.njit(cache=True, nogil=True)
def _add_pair(p, q, full, squares):  # type: ignore[no-untyped-def]  # numba infers
    for j in range(full.size):
        swing = np.float32(p[j]) - np.float32(q[j])
        squares[j] += full[j] * swing * swing


@nb.njit(cache=True, nogil=True)
def _add_single(p, w, k, full, squares):  # type: ignore[no-untyped-def]  # numba infers
    for j in range(full.size):
        swing = np.float32(2) * np.float32(p[j]) - np.float32(w[j]) - np.float32(k[j])
        squares[j] += full[j] * swing * swing
