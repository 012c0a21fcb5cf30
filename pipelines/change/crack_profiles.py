"""Heights along rays that leave a crack's centre line, and which samples lie on the crack mask."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["crack_profiles"]

Floats = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def _sampled(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    height, mask, row, column, normal, distance, z, inside, first, last
):
    rows, columns = height.shape
    for p in range(first, last):
        for k in range(distance.size):
            y = row[p] + normal[p, 1] * distance[k]
            x = column[p] + normal[p, 0] * distance[k]
            i, j = int(np.rint(y)), int(np.rint(x))
            if i < 0 or j < 0 or i >= rows or j >= columns:
                continue
            inside[p, k] = mask[i, j]
            if not np.isfinite(height[i, j]):
                continue
            y, x = min(max(y, 0.0), rows - 1.0), min(max(x, 0.0), columns - 1.0)
            top, left = int(y), int(x)
            total = weight = 0.0
            for di in range(2):
                for dj in range(2):
                    share = (y - top if di else 1 - (y - top)) * (x - left if dj else 1 - (x - left))
                    # a neighbour beyond the last row or column has no share
                    if share > 0 and np.isfinite(height[top + di, left + dj]):
                        total += share * height[top + di, left + dj]
                        weight += share
            z[p, k] = np.float32(total) / max(np.float32(weight), np.float32(1e-6))


def crack_profiles(
    height: npt.NDArray[np.float32],
    mask: npt.NDArray[np.bool_],
    row: Floats,
    column: Floats,
    normal: Floats,
    distance: Floats,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Sample rays: bilinear over the measured cells.

    Parameters
    ----------
    height : ndarray of float32, shape (rows, columns)
        mm; NaN where not measured.
    mask : ndarray of bool, shape (rows, columns)
    row, column : ndarray of float64, shape (points,)
        Where the rays begin, cells.
    normal : ndarray of float64, shape (points, 2)
        Their directions (x, y).
    distance : ndarray of float64, shape (samples,)
        Cells from the beginning.

    Returns
    -------
    z : ndarray of float32, shape (points, samples)
        NaN beyond the map and where the nearest cell was not measured.
    inside : ndarray of bool, shape (points, samples)
        The nearest cell is of the mask.
    """
    z = np.full((row.size, distance.size), np.nan, dtype=np.float32)
    inside = np.zeros(z.shape, dtype=np.bool_)
    direction = np.ascontiguousarray(normal)
    in_slabs(
        row.size,
        lambda first, last: _sampled(height, mask, row, column, direction, distance, z, inside, first, last),
    )
    return z, inside
