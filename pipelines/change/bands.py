"""Height and texture band-passed over the measured cells alone: both Gaussians, both channels, in one walk."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..scan import Scan
from ..slabs import in_slabs

__all__ = ["COARSE_CELLS", "FINE_CELLS", "band_passed"]

FINE_CELLS = 1.0
"""Sigma of the Gaussian that takes out the finest noise, cells: bilinear resampling then hardly blurs."""
COARSE_CELLS = 8.0
"""Sigma of the Gaussian whose result is subtracted: settlement, tilt and lighting are gone after it."""
TRUNCATED = 3.0
"""Gaussians end at so many sigmas."""
LEAST_SHARE = np.float32(1e-3)

Floats = npt.NDArray[np.float32]


def _half(sigma: float) -> Floats:
    """Weights of a Gaussian at 0, 1, 2, ... cells, an odd number of them: the last may be 0."""
    reach = int(TRUNCATED * sigma + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    half = (weights / weights.sum())[reach:]
    return np.append(half, np.zeros(reach % 2)).astype(np.float32)


@njit(cache=True, nogil=True, inline="always")
def _mirrored(i, n):  # type: ignore[no-untyped-def]  # numba infers the types
    """Index of a row beyond the border: the map goes on as in a mirror that stands on the border."""
    i %= 2 * n
    return i if i < n else 2 * n - 1 - i


@njit(cache=True, nogil=True, fastmath={"contract"})
def _down(values, i, weights, out):  # type: ignore[no-untyped-def]  # as above
    """One row of the map smoothed along columns; two rows to either side at a time, so that sums stay in registers."""
    rows = values.shape[0]
    w = weights[0]
    middle = values[i]
    for j in range(out.size):
        out[j] = w * middle[j]
    for k in range(1, weights.size, 2):
        a, b = values[_mirrored(i - k, rows)], values[_mirrored(i + k, rows)]
        c, d = values[_mirrored(i - k - 1, rows)], values[_mirrored(i + k + 1, rows)]
        w, x = weights[k], weights[k + 1]
        for j in range(out.size):
            out[j] += w * (a[j] + b[j]) + x * (c[j] + d[j])


@njit(cache=True, nogil=True, fastmath={"contract"})
def _along(row, wide, weights, out):  # type: ignore[no-untyped-def]  # as above
    """One row smoothed along itself; `wide` is room for it with both margins."""
    columns = row.size
    reach = weights.size - 1
    wide[reach : reach + columns] = row
    for k in range(reach):
        wide[reach - 1 - k] = row[_mirrored(k, columns)]
        wide[reach + columns + k] = row[_mirrored(columns + k, columns)]
    w = weights[0]
    for j in range(columns):
        out[j] = w * row[j]
    for k in range(1, weights.size, 2):
        a, b = wide[reach - k :], wide[reach + k :]
        c, d = wide[reach - k - 1 :], wide[reach + k + 1 :]
        w, x = weights[k], weights[k + 1]
        for j in range(columns):
            out[j] += w * (a[j] + b[j]) + x * (c[j] + d[j])


@njit(cache=True, nogil=True)
def _rows(  # type: ignore[no-untyped-def]  # as above
    height, texture, share, fine, coarse, out_height, out_texture, first, last
):
    columns = height.shape[1]
    down = np.empty(columns, np.float32)
    wide = np.empty(columns + 2 * coarse.size, np.float32)
    near = np.empty((3, columns), np.float32)
    far = np.empty((3, columns), np.float32)
    for i in range(first, last):
        for k, values in enumerate((height, texture, share)):
            _down(values, i, fine, down)
            _along(down, wide, fine, near[k])
            _down(values, i, coarse, down)
            _along(down, wide, coarse, far[k])
        for j in range(columns):
            one, two = max(near[2, j], LEAST_SHARE), max(far[2, j], LEAST_SHARE)
            known = share[i, j] > 0
            out_height[i, j] = near[0, j] / one - far[0, j] / two if known else np.nan
            out_texture[i, j] = near[1, j] / one - far[1, j] / two if known else np.nan


def band_passed(scan: Scan, first: int = 0, last: int | None = None) -> tuple[Floats, Floats]:
    """Height and texture, each smoothed by a Gaussian of 1 cell less it smoothed by one of 8 cells.

    Gaussians end at 3 sigmas; the map is mirrored at its borders; cells that were not measured do not count.

    Parameters
    ----------
    scan : Scan
    first, last : int, optional
        Of these rows alone; of all if left out.

    Returns
    -------
    height, texture : ndarray of float32, shape (last - first, columns)
        NaN where not measured.
    """
    fine, coarse = _half(FINE_CELLS), _half(COARSE_CELLS)
    last = scan.grid.rows if last is None else last
    top = max(0, first - coarse.size)
    cut = slice(top, last + coarse.size)
    known = np.isfinite(scan.height[cut])
    share = known.astype(np.float32)
    # in single precision a height far from 0 would lose what is fine
    heights = scan.height[cut]
    offset = heights[known].mean(dtype=np.float64).astype(np.float32) if known.any() else np.float32(0)
    height = np.where(known, heights - offset, np.float32(0))
    texture = scan.texture[cut] * share
    out = np.empty_like(height), np.empty_like(height)
    given = height, texture, share, fine, coarse
    in_slabs(last - first, lambda low, high: _rows(*given, *out, first - top + low, first - top + high))
    inner = slice(first - top, last - top)
    return out[0][inner], out[1][inner]
