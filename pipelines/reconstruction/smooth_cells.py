"""Sigma of cells on smooth surfaces: no larger than their heights show that it is."""

from __future__ import annotations

from math import ceil, pi, sqrt

import numba as nb
import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs

__all__ = ["reach_of", "tell_smooth"]

F32 = npt.NDArray[np.float32]

SIDE = 32  # cells: side of the tiles in which it is told
ROWS = 4  # one row in so many tells
FEW = 64  # second differences that tell
APART = 2.0  # widths of a stripe: positions that have no edge in common
LEAST_REACH = 8  # cells: what is slower than that is no error of single edges
NORMAL = sqrt(pi / 2)  # standard deviations per mean absolute value


def reach_of(stripe_px: float, usual: tuple[float, float]) -> int:
    """Cells over which second differences are taken: at least two stripes, whose errors have nothing in common.

    Parameters
    ----------
    stripe_px : float
        Camera pixels per projector pixel.
    usual : (float, float)
        Half sides of a pixel's footprint, cells.
    """
    return max(LEAST_REACH, ceil(APART * stripe_px * 2 * max(usual)))


def tell_smooth(height: F32, sigma: F32, reach: int) -> None:
    """Lower sigma, in place, where second differences of heights show that cells err less than it says.

    How far the points of a cell share their errors differs: noise is independent from line to line of the image, what
    relief and texture do is not, and sigma takes the worse. A second difference of heights holds six times the
    variance of an independent error, and all relief: so it is an upper bound, which only smooth surfaces come near.
    In tiles, the mean ratio of second differences to what sigma makes of them, the larger along x and along y; of a
    tile and its eight neighbours the largest counts. Errors that are the same over `reach` cells do not show.

    Parameters
    ----------
    height, sigma : ndarray of float32, shape (row, column)
        mm; NaN where not measured.
    reach : int
        Cells between the heights of a second difference.
    """
    rows, columns = height.shape
    down, across = -(-rows // SIDE), -(-columns // SIDE)
    ratio = np.zeros((down + 2, across + 2), np.float32)

    def told(first: int, last: int) -> None:
        _ratios(height, sigma, reach, first, last, ratio)

    in_slabs(down, told, least=1)
    around = np.zeros((down, across), np.float32)
    for i in range(3):
        for j in range(3):
            np.maximum(around, ratio[i : i + down, j : j + across], out=around)
    around[around == 0] = 1
    if around.min() < 1:
        in_slabs(rows, lambda first, last: _lower(sigma, around, first, last))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _ratios(height, sigma, reach, first, last, ratio):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill the rows `first` to `last` of tiles; 0 where too little is measured."""
    rows, columns = height.shape
    size = np.empty(columns, np.float32)
    for tile in range(first, last):
        sums = np.zeros((2, 2, ratio.shape[1]), np.float32)  # along x, along y; total, count
        for i in range(tile * SIDE, min((tile + 1) * SIDE, rows), ROWS):
            size[:] = np.nan
            inner = columns - 2 * reach
            if inner > 0:
                _differ(height[i], height[i, reach:], height[i, 2 * reach :], sigma[i], sigma[i, reach:],
                        sigma[i, 2 * reach :], size[reach : reach + inner])  # fmt: skip
                _add(size, sums[0])
            if reach <= i < rows - reach:
                a, b = i - reach, i + reach
                _differ(height[a], height[i], height[b], sigma[a], sigma[i], sigma[b], size)
                _add(size, sums[1])
        for t in range(1, ratio.shape[1] - 1):
            worst = np.float32(0)
            for way in range(2):
                if sums[way, 1, t] >= FEW:
                    worst = max(worst, np.float32(NORMAL) * sums[way, 0, t] / sums[way, 1, t])
            ratio[tile + 1, t] = min(worst, np.float32(1))


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="never")
def _differ(before, here, after, own_before, own, own_after, size):  # type: ignore[no-untyped-def]  # numba infers
    """Second differences over what sigma makes of them."""
    four = np.float32(4)
    for j in range(size.size):
        variance = own_before[j] * own_before[j] + four * own[j] * own[j] + own_after[j] * own_after[j]
        size[j] = abs(before[j] - (here[j] + here[j]) + after[j]) / np.sqrt(variance)


@nb.njit(cache=True, nogil=True)
def _add(size, sums):  # type: ignore[no-untyped-def]  # numba infers
    """Add up by tiles what is known."""
    for t in range(sums.shape[1] - 2):
        total, count = np.float32(0), np.float32(0)
        for value in size[t * SIDE : (t + 1) * SIDE]:
            if value == value:
                total += value
                count += np.float32(1)
        sums[0, t + 1] += total
        sums[1, t + 1] += count


@nb.njit(cache=True, nogil=True)
def _lower(sigma, ratio, first, last):  # type: ignore[no-untyped-def]  # numba infers
    for i in range(first, last):
        line, share = sigma[i], ratio[i // SIDE]
        for t in range(share.size):
            part, by = line[t * SIDE : (t + 1) * SIDE], share[t]
            for j in range(part.size):
                part[j] *= by
