"""Local means and medians that ignore missing cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

from ..slabs import in_slabs
from .ranks import at_rank, median, ordered

__all__ = ["local_mean", "local_median"]


@njit(cache=True, nogil=True, error_model="numpy")
def _means(values, use, all_count, reach, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types
    rows, columns = values.shape
    total, count = np.zeros(columns + 2 * reach, np.float32), np.zeros(columns + 2 * reach, np.float32)
    sums, counts = np.empty(columns, np.float32), np.empty(columns, np.float32)
    least = np.float32(0.25) * np.float32(2 * reach + 1) ** 2
    one, none = np.float32(1), np.float32(0)
    for i in range(first, last):
        inner_total, inner_count = total[reach : reach + columns], count[reach : reach + columns]
        inner_total[:] = 0
        inner_count[:] = 0
        for r in range(max(0, i - reach), min(rows, i + reach + 1)):
            row = values[r]
            if all_count:
                for j in range(columns):
                    good = abs(row[j]) < np.inf
                    inner_total[j] += row[j] if good else none
                    inner_count[j] += one if good else none
            else:
                may = use[r]
                for j in range(columns):
                    good = may[j] & (abs(row[j]) < np.inf)
                    inner_total[j] += row[j] if good else none
                    inner_count[j] += one if good else none
        sums[:] = 0
        counts[:] = 0
        for k in range(2 * reach + 1):
            some_total, some_count = total[k:], count[k:]
            for j in range(columns):
                sums[j] += some_total[j]
                counts[j] += some_count[j]
        line = out[i]
        for j in range(columns):
            line[j] = sums[j] / counts[j] if counts[j] >= least else np.float32(np.nan)


def local_mean(
    values: npt.NDArray[np.float32], cells: int, *, use: npt.NDArray[np.bool_] | None = None
) -> npt.NDArray[np.float32]:
    """Mean of the finite cells in a square window.

    Parameters
    ----------
    values : ndarray of float32, shape (rows, columns)
    cells : int
        Side of the window, odd.
    use : ndarray of bool, shape (rows, columns), optional
        Cells that may count; all finite ones if left out.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        NaN where less than a quarter of the window is measured.
    """
    mean = np.empty(values.shape, dtype=np.float32)
    may = np.zeros((1, 1), dtype=np.bool_) if use is None else use
    in_slabs(
        len(values), lambda first, last: _means(values, may, use is None, cells // 2, mean, first, last), least=256
    )
    return mean


def local_median(values: npt.NDArray[np.float32], cells: int) -> npt.NDArray[np.float32]:
    """Median of a wide window, roughly: of block medians, blocks an eighth of the window wide, between them linear.

    Parameters
    ----------
    values : ndarray of float32, shape (rows, columns)
    cells : int
        Side of the window.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        Finite wherever anything is: blocks where nothing was measured take the median of all.
    """
    block = max(1, cells // 8)
    rows, columns = (-(-n // block) for n in values.shape)
    middle = np.empty((rows, columns), dtype=np.float32)
    in_slabs(rows, lambda first, last: _of_blocks(values, block, middle, first, last), least=4)
    empty = np.isnan(middle)
    if empty.any():
        middle[empty] = np.nan_to_num(np.float32(median(values)))
    middle = ndimage.median_filter(middle, size=max(1, min(9, rows, columns)), mode="nearest")
    (above, down), (before, aside) = (_nodes(n, block, of) for n, of in zip(values.shape, middle.shape, strict=True))
    wide = np.empty(values.shape, dtype=np.float32)
    in_slabs(len(wide), lambda first, last: _bilinear(middle, above, down, before, aside, wide, first, last), least=256)
    return wide


@njit(cache=True, nogil=True)
def _of_blocks(values, block, middle, first, last):  # type: ignore[no-untyped-def]  # as above
    """The lower of the two middle values of each block, where it has an even number; NaN where it has none."""
    rows, columns = values.shape
    keys = np.empty(block * block, np.int32)
    for r in range(first, last):
        for c in range(middle.shape[1]):
            count = 0
            for i in range(r * block, min(rows, (r + 1) * block)):
                for j in range(c * block, min(columns, (c + 1) * block)):
                    if abs(values[i, j]) < np.inf:
                        keys[count] = ordered(np.float32(values[i, j]).view(np.int32))
                        count += 1
            middle[r, c] = np.nan
            if count:
                middle[r, c] = np.int32(ordered(at_rank(keys, count, (count - 1) // 2))).view(np.float32)


def _nodes(cells: int, block: int, nodes: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Of each cell along an axis, the block whose middle lies before it, and how far it is on its way to the next."""
    at = np.clip((np.arange(cells) + 0.5) / block - 0.5, 0, nodes - 1)
    low = np.minimum(at.astype(np.intp), max(0, nodes - 2))
    return low, (at - low).astype(np.float32)


@njit(cache=True, nogil=True)
def _bilinear(coarse, above, down, before, aside, out, first, last):  # type: ignore[no-untyped-def]  # as above
    one = np.float32(1)
    for i in range(first, last):
        high = min(above[i] + 1, coarse.shape[0] - 1)
        line = coarse[above[i]] * (one - down[i]) + coarse[high] * down[i]
        for j in range(out.shape[1]):
            after = min(before[j] + 1, coarse.shape[1] - 1)
            out[i, j] = line[before[j]] * (one - aside[j]) + line[after] * aside[j]
