"""Local means that ignore missing cells, and robust spreads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["MAD_TO_SIGMA", "local_mean", "local_median", "robust_sigma"]

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, for a normal distribution."""


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
    good = np.isfinite(values) if use is None else np.isfinite(values) & use
    weight = ndimage.uniform_filter(good.astype(np.float32), cells, mode="constant")
    total = ndimage.uniform_filter(np.where(good, values, np.float32(0)), cells, mode="constant")
    mean = np.full(values.shape, np.nan, dtype=np.float32)
    np.divide(total, weight, out=mean, where=weight >= 0.25)
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


def robust_sigma(values: npt.NDArray[np.floating]) -> float:
    """1.4826 times the median absolute deviation from the median of the finite values; NaN if there is none."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return float("nan")
    return float(MAD_TO_SIGMA * np.median(np.abs(finite - np.median(finite))))
