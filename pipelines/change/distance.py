"""Distance of each marked cell to the nearest one that is not marked: exact, in time that is linear in the cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["inner_distance"]


@njit(cache=True, nogil=True)
def _along_columns(mask, gap, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    """Rows to the nearest unmarked cell of the same column; rows + columns where there is none. Columns of a slab."""
    rows, columns = mask.shape
    far = rows + columns
    for j in range(first, last):
        gap[0, j] = far if mask[0, j] else 0
    for i in range(1, rows):
        for j in range(first, last):
            gap[i, j] = min(gap[i - 1, j] + 1, far) if mask[i, j] else 0
    for i in range(rows - 2, -1, -1):
        for j in range(first, last):
            if gap[i + 1, j] + 1 < gap[i, j]:
                gap[i, j] = gap[i + 1, j] + 1


@njit(cache=True, nogil=True)
def _along_rows(gap, distance, first, last):  # type: ignore[no-untyped-def]  # as above
    """Lower envelope of the parabolas that stand on each row's gaps."""
    columns = gap.shape[1]
    start = np.empty(columns, np.int64)
    owner = np.empty(columns, np.int64)
    height = np.empty(columns, np.int64)
    for i in range(first, last):
        for j in range(columns):
            height[j] = np.int64(gap[i, j]) ** 2
        q = 0
        start[0] = owner[0] = 0
        for u in range(1, columns):
            while q >= 0 and (start[q] - owner[q]) ** 2 + height[owner[q]] > (start[q] - u) ** 2 + height[u]:
                q -= 1
            if q < 0:
                q = 0
                owner[0] = u
            else:
                o = owner[q]
                w = 1 + (u * u - o * o + height[u] - height[o]) // (2 * (u - o))
                if w < columns:
                    q += 1
                    owner[q] = u
                    start[q] = w
        for u in range(columns - 1, -1, -1):
            distance[i, u] = np.sqrt((u - owner[q]) ** 2 + height[owner[q]])
            if u == start[q]:
                q -= 1


def inner_distance(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Euclidean distance of each marked cell to the nearest unmarked one, cells.

    Meijster, Roerdink and Hesselink (2000): along columns first, then the lower envelope along rows. The squares are
    whole numbers, so that the distances are exact.

    Parameters
    ----------
    mask : ndarray of bool, shape (rows, columns)

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        0 where not marked; rows + columns where every cell is marked.
    """
    rows, columns = mask.shape
    gap = np.empty(mask.shape, dtype=np.int32)
    distance = np.zeros(mask.shape, dtype=np.float64)
    if mask.size:
        in_slabs(columns, lambda first, last: _along_columns(mask, gap, first, last))
        in_slabs(rows, lambda first, last: _along_rows(gap, distance, first, last))
    return distance
