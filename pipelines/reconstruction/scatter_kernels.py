"""Compiled inner loops of `refine`: what the scatter and the bend of the found positions add to their uncertainty."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

__all__ = ["TILE", "settle"]

# Square of how far a pixel is off, of the bend of the map over one cell to either side: a parabola from its chord.
BEND = 1 / 120
TILE = 16  # camera px: scatter is averaged over tiles of this side, and their neighbours along the rows
MOST_LAG = 4  # camera px: tiles are not much wider
LINES = 4  # one line in so many tells the scatter
FAR = 4  # times the mean second difference: 3.2 standard deviations
FEW = 32  # second differences that tell the scatter of three tiles
# of the absolute second difference of three independent values: its mean's square is 6 * 2 / pi variances
SCATTER = math.pi / 12


@nb.njit(cache=True, nogil=True, error_model="numpy")
def settle(fine, spread, down, along, shared, first, last):  # type: ignore[no-untyped-def]  # numba infers
    """Turn variances into standard uncertainties, in rows `first` to `last`: what noise does not explain is added.

    One of `down` and `along` is the distance, camera px, over which the bend of the lines of positions is taken, the
    other is 0. Neighbouring lines were found from other pixels: whatever misplaces them (noise, texture, relief finer
    than a cell) shows in second differences across the lines, of which an independent error has a sixth in variance.
    So has relief: a chord over a cell misses a rough surface by 0.15 of the second difference over half a cell.
    Negative variances are whole: of pixels without edges. `shared` is the variance that no difference across the lines
    shows (`subpixel`), projector px squared.
    """
    H, W = fine.shape
    across = lags_across(down, along)
    scatter = np.zeros(W, np.float32)
    for top in range(first, last, TILE):
        bottom = min(top + TILE, last)
        _scatter(fine, spread, top, bottom, across[0], across[1], scatter)
        scatter += shared
        for i in range(top, bottom):
            low, high = along, W - along
            if not down <= i < H - down or high < low:
                low, high = W, W
            _root(scatter[:low], spread[i, :low])
            if high > low:
                before, after = fine[i - down, low - along : high - along], fine[i + down, low + along : high + along]
                _add_bend(before, fine[i, low:high], after, scatter[low:high], spread[i, low:high])
            _root(scatter[high:], spread[i, high:])


@nb.njit(cache=True, nogil=True)
def lags_across(down, along):  # type: ignore[no-untyped-def]  # numba infers
    """Half the distance, camera px down and along, over which second differences across the lines are taken."""
    lag = min(max(1, (down + along + 1) // 2), MOST_LAG)
    return (lag, 0) if along else (0, lag)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _root(scatter, error):  # type: ignore[no-untyped-def]  # numba infers
    for n in range(error.size):
        error[n] = np.sqrt(abs(error[n]) + (scatter[n] if error[n] > 0 else np.float32(0)))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_bend(before, here, after, scatter, error):  # type: ignore[no-untyped-def]  # numba infers
    share, one, none = np.float32(BEND), np.float32(1), np.float32(0)
    for n in range(error.size):
        bend = before[n] - np.float32(2) * here[n] + after[n]
        # beyond a cell it is no bend but an edge of the surface; NaN is neither
        more = scatter[n] + (share * bend * bend if abs(bend) < one else none)
        error[n] = np.sqrt(abs(error[n]) + (more if error[n] > 0 else none))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _scatter(fine, spread, top, bottom, down, along, scatter):  # type: ignore[no-untyped-def]  # numba infers
    """Variance, per column of a band of tiles, by which positions scatter across lines more than their noise explains.

    Some lines will do. Twice: what is far beyond the mean of the first time is an edge of the surface.
    """
    size = fine.shape[1]
    inner = max(size - 2 * along, 0)
    limit = np.ones(size, np.float32)  # beyond a cell it is one for sure
    total, noise, count = np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32)
    tiles = (size + TILE - 1) // TILE
    sums = np.zeros((3, tiles + 2), np.float32)
    for turn in range(2):
        total[:], noise[:], count[:], sums[:] = 0, 0, 0, 0
        for i in range(top + down, bottom - down, LINES):
            _second(
                fine[i - down, :inner],
                fine[i, along : along + inner],
                fine[i + down, 2 * along : 2 * along + inner],
                spread[i - down, :inner],
                spread[i, along : along + inner],
                spread[i + down, 2 * along : 2 * along + inner],
                limit, total, noise, count,
            )  # fmt: skip
        for t in range(tiles):
            first, last = t * TILE, min((t + 1) * TILE, size)
            sums[0, t + 1] = _sum_of(total[first:last])
            sums[1, t + 1] = _sum_of(noise[first:last])
            sums[2, t + 1] = _sum_of(count[first:last])
        band = _sum_of(sums[0]), _sum_of(sums[1]), _sum_of(sums[2])
        for t in range(tiles):
            first, last = t * TILE, min((t + 1) * TILE, size)
            mean, own = _usual(sums, t, band)
            if turn == 0:
                limit[first:last] = _limit(mean)
            else:
                scatter[first:last] = _unexplained(mean, own)


@nb.njit(cache=True, nogil=True)
def _sum_of(values):  # type: ignore[no-untyped-def]  # numba infers
    """Sum in single precision, one after the other: the same on every device."""
    total = np.float32(0)
    for n in range(values.size):
        total += values[n]
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _usual(sums, t, band):  # type: ignore[no-untyped-def]  # numba infers
    """Mean second difference, and variance by noise, of tile `t` and half its neighbours; of the `band` if few."""
    a, b, c = sums[0], sums[1], sums[2]  # a tile more at either end: tile t is at t + 1
    seen = c[t] + c[t + 1] + c[t + 1] + c[t + 2]
    if seen >= FEW:
        return (a[t] + a[t + 1] + a[t + 1] + a[t + 2]) / seen, (b[t] + b[t + 1] + b[t + 1] + b[t + 2]) / seen
    every = max(band[2], np.float32(1))
    return band[0] / every, band[1] / every


@nb.njit(cache=True, nogil=True)
def _limit(mean):  # type: ignore[no-untyped-def]  # numba infers
    """What a second difference may be at most; beyond it is an edge of the surface."""
    return np.float32(min(FAR * mean, np.float32(1)))


@nb.njit(cache=True, nogil=True)
def _unexplained(mean, own):  # type: ignore[no-untyped-def]  # numba infers
    """Variance of a position that second differences show, and noise does not explain."""
    return max(np.float32(SCATTER) * mean * mean - own * np.float32(1 / 6), np.float32(0))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _second(before, here, after, own_before, own_here, own_after, limit, total, noise, count):  # type: ignore[no-untyped-def]  # numba infers
    """Add up absolute second differences below the limits, and the variances that noise alone would give them."""
    one, none, four = np.float32(1), np.float32(0), np.float32(4)
    for n in range(here.size):
        bend = abs(before[n] - here[n] - here[n] + after[n])
        good = (bend <= limit[n]) & (own_before[n] > none) & (own_here[n] > none) & (own_after[n] > none)
        total[n] += bend if good else none
        noise[n] += own_before[n] + four * own_here[n] + own_after[n] if good else none
        count[n] += one if good else none
