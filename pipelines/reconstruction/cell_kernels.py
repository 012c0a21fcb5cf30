"""Compiled loop of gridding that makes of the sums of a cell its height, and how sure it is.

The sums lie in planes, one for each of what is summed: so the loop runs through memory in order and without a branch,
and the compiler makes vector instructions of it.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .apart import read, write
from .lay_kernels import FINE, OFFSET

__all__ = ["HALF", "RIM", "conclude"]

HALF = np.float32(0.5)  # of a cell's area must be covered
RIM = 64  # added to the level of a cell until it is mended, if a point of it lies at a border

# what is summed up of the points of a cell, a plane each
WEIGHT, HEIGHT, ASIDE, ALONG, SLOPE_X, SLOPE_Y, SQUARE, COUNT, LIGHT, FIRST, LOW, HIGH, INNER = range(13)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def conclude(total, cover, deepest, rim, pitch, sharing, wide, height, sigma, texture, level):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Height, sigma, texture and level of the cells of a band from their sums.

    Heights are moved to the cell's centre along its slope. Of the relief in a cell, noise explains a part, and the
    cell's slope another. What lies in the part of a cell that is not seen is as far from its mean as what is seen.
    Where all of it is seen, each point stands for the middle of its share: the mean of n is off by 1 / sqrt(12 n) of
    what no slope explains. What lines share of the points' variance, and beside it, goes down by `left` only.

    Parameters
    ----------
    total : ndarray of float32, shape (13, cell)
        Sums, or of a cell without a point of its own (`COUNT` 0) what it was lent: area, height, variance and light.
    cover : ndarray of float32, shape (cell,)
    deepest, rim : ndarray of uint8, shape (cell,)
    pitch : float
    sharing : (float, float, float, float)
        As `surface.Sharing`.
    wide : bool
    height, sigma, texture, level : ndarray, shape (cell,)
        Filled; sigma is negative where less than half is covered.
    """
    weights, heights, asides, alongs, slopes_x = (
        total[WEIGHT],
        total[HEIGHT],
        total[ASIDE],
        total[ALONG],
        total[SLOPE_X],
    )
    slopes_y, squares, counts = total[SLOPE_Y], total[SQUARE], total[COUNT]
    lights, firsts, inners = total[LIGHT], total[FIRST], total[INNER]
    apart, within = np.float32(sharing[0]), np.float32(sharing[1])
    beside, left = np.float32(sharing[2]), np.float32(sharing[3])
    unit, side = np.float32(pitch / (OFFSET * FINE)), np.float32(pitch)
    one, zero, nan, sampled = np.float32(1), np.float32(0), np.float32(np.nan), np.float32(1 / 12)
    own_cover = zero if wide else one  # inner pixels of a fine grid are in `cover` already
    for n in range(height.size):
        weight, count = read(weights, n), read(counts, n)
        aside, slope_x, slope_y = read(asides, n), read(slopes_x, n), read(slopes_y, n)
        some, lent = weight > zero, count == zero
        share = one / weight
        mean = read(heights, n) * share
        moved = aside * slope_x + read(alongs, n) * slope_y
        centred = mean - moved * (unit * share * share)
        worth = one + (np.sqrt(count) - one) / apart
        part = one / (worth * worth)
        own = share * count
        steep = (slope_x * slope_x + slope_y * slope_y) * (share * share / np.float32(FINE * FINE))
        mean_off = mean - read(firsts, n)
        relief = max(read(squares, n) * share - mean_off * mean_off - own, zero)
        bent = max(relief - steep * side * side / np.float32(12), zero)
        inner = read(inners, n)
        unseen = max(one - inner, zero)
        decoded = own * part + min(own, within) * max(left - part, zero) + beside * left
        variance = decoded + relief * unseen * unseen + bent * sampled / count
        borrowed = aside * share + beside
        spread = np.sqrt(borrowed if lent else variance)
        covered = lent | (read(cover, n) + own_cover * inner >= HALF)
        signed = spread if covered else -spread
        light = read(lights, n)
        bright, dim = light * share, light / count
        shown = np.int32((bright if lent else dim) if some else zero)
        write(height, n, (mean if lent else centred) if some else nan)
        write(sigma, n, signed if some else nan)
        write(texture, n, np.uint8(shown))
    top = np.uint8(LEVEL_NONE)
    for n in range(level.size):
        own_level = np.uint8(read(deepest, n) + read(rim, n))
        write(level, n, own_level if read(weights, n) > zero else top)
