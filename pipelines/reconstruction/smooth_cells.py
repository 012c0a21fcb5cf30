"""Sigma of cells on smooth surfaces: no larger than their heights show that it is."""

from __future__ import annotations

from math import ceil, pi, sqrt

import numba as nb
import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs

__all__ = ["ladder", "reach_of", "tell_smooth"]

F32 = npt.NDArray[np.float32]

SIDE = 32  # cells: side of the tiles in which it is told
ROWS, MORE = (
    4,
    3,
)  # one row in so many tells; of distances that are looked at in nine tiles together one in MORE of these
FEW = 64  # second differences that tell
APART = 2.0  # widths of a stripe: positions that have no edge in common
NEXT = 2.4  # from one distance of second differences to the next smaller one: what repeats over one shows at another
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


def ladder(reach: int) -> list[int]:
    """Distances, cells, of which no period of two cells and more divides all.

    An error of period p shows in second differences over L with 16/6 sin^4(pi L / p) times the variance that an
    independent one would have. Over L it is at least 0.65 of that from p = 1.4 L to 3.9 L: the next is `NEXT` shorter.
    """
    found = [reach]
    while found[-1] > 1:
        found.append(max(1, round(found[-1] / NEXT)))
    return found


def tell_smooth(height: F32, sigma: F32, reach: int) -> None:
    """Lower sigma, in place, where second differences of heights show that cells err less than it says.

    How far the points of a cell share their errors differs: noise is independent from line to line of the image, what
    relief and texture do is not, and sigma takes the worse. A second difference of heights holds six times the
    variance of an independent error, and all relief: so it is an upper bound, which only smooth surfaces come near.
    In tiles, the mean ratio of second differences to what sigma makes of them, the larger along x and along y; of a
    tile and its eight neighbours the largest counts. Errors that are the same over `reach` cells do not show. Nor would
    those that repeat over it, as stripes do: so shorter distances are looked at too (`ladder`), in all nine tiles
    together, and the largest of all counts.

    Parameters
    ----------
    height, sigma : ndarray of float32, shape (row, column)
        mm; NaN where not measured.
    reach : int
        Cells between the heights of a second difference, at most.
    """
    lags = np.array(ladder(reach))
    rows, columns = height.shape
    down, across = -(-rows // SIDE), -(-columns // SIDE)
    sums = np.zeros((2 * len(lags), 2, down + 2, across + 2), np.float32)
    in_slabs(down, lambda first, last: _sum_up(height, sigma, lags, first, last, sums), least=1)
    nine = [np.s_[..., i : i + down, j : j + across] for i in range(3) for j in range(3)]
    far, near = sums[:2], sums[2:]
    around = np.max([_ratio(far[tile]) for tile in nine], axis=0)
    for ratio in (around, _ratio(np.sum([near[tile] for tile in nine], axis=0))):
        np.maximum(ratio.max(axis=0), around[0], out=around[0])
    share = np.where(around[0] > 0, np.minimum(around[0], 1), 1).astype(np.float32)
    if share.min() < 1:
        in_slabs(rows, lambda first, last: _lower(sigma, share, first, last))


def _ratio(sums: F32) -> F32:
    """Ratios of second differences to sigma, from their (way, total or count, ...); 0 where too little is known."""
    total, count = sums[:, 0], sums[:, 1]
    return np.asarray(np.where(count >= FEW, NORMAL * total / np.maximum(count, 1), 0), np.float32)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sum_up(height, sigma, lags, first, last, sums):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill the rows `first` to `last` of tiles, (lag along x or along y, total or count, row, column), a rim aside."""
    rows, columns = height.shape
    size = np.empty(columns, np.float32)
    for tile in range(first, last):
        for k in range(lags.size):
            lag = lags[k]
            along, across = sums[2 * k, :, tile + 1], sums[2 * k + 1, :, tile + 1]
            step = ROWS if k == 0 else MORE * ROWS
            for i in range(tile * SIDE, min((tile + 1) * SIDE, rows), step):
                size[:] = np.nan
                inner = columns - 2 * lag
                if inner > 0:
                    _differ(height[i], height[i, lag:], height[i, 2 * lag :], sigma[i], sigma[i, lag:],
                            sigma[i, 2 * lag :], size[lag : lag + inner])  # fmt: skip
                    _add(size, along)
                if lag <= i < rows - lag:
                    a, b = i - lag, i + lag
                    _differ(height[a], height[i], height[b], sigma[a], sigma[i], sigma[b], size)
                    _add(size, across)


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
