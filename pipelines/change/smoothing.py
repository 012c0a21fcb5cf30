"""Local means that ignore missing cells, and robust spreads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

__all__ = ["MAD_TO_SIGMA", "local_mean", "robust_sigma"]

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


def robust_sigma(values: npt.NDArray[np.floating]) -> float:
    """1.4826 times the median absolute deviation from the median of the finite values; NaN if there is none."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return float("nan")
    return float(MAD_TO_SIGMA * np.median(np.abs(finite - np.median(finite))))
