"""Local means and medians that ignore missing cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

from ..slabs import in_slabs

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
    padded = np.full((rows * block, columns * block), np.nan, dtype=np.float32)
    padded[: values.shape[0], : values.shape[1]] = values
    tiles = padded.reshape(rows, block, columns, block).swapaxes(1, 2).reshape(rows, columns, -1)
    # missing cells sort last, so the middle of those measured is at half their number
    count = np.isfinite(tiles).sum(axis=2)
    ordered = np.sort(tiles, axis=2)
    middle = np.take_along_axis(ordered, np.maximum(count // 2 - (count % 2 == 0), 0)[..., None], axis=2)[..., 0]
    everywhere = np.float32(np.nanmedian(values)) if count.any() else np.float32(0)
    middle = np.where(count > 0, middle, everywhere)
    middle = ndimage.median_filter(middle, size=max(1, min(9, rows, columns)), mode="nearest")
    at_row = (np.arange(values.shape[0]) + 0.5) / block - 0.5
    at_column = (np.arange(values.shape[1]) + 0.5) / block - 0.5
    wide: npt.NDArray[np.float32] = _bilinear(middle, np.clip(at_row, 0, rows - 1), np.clip(at_column, 0, columns - 1))
    return wide


def _bilinear(
    coarse: npt.NDArray[np.float32], at_row: npt.NDArray[np.float64], at_column: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Values between the nodes of a coarse map, on the product of two axes."""

    def along(values: npt.NDArray[np.float32], at: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        low = np.minimum(at.astype(np.intp), max(0, values.shape[0] - 2))
        high = np.minimum(low + 1, values.shape[0] - 1)
        share = (at - low).astype(np.float32)[:, None]
        mixed: npt.NDArray[np.float32] = values[low] * (1 - share) + values[high] * share
        return mixed

    return along(along(coarse, at_row).T, at_column).T
