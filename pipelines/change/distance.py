"""Distance of each marked cell to the nearest one that is not, and which that is: exact, in linear time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["inner_distance", "nearest_outside"]

Mask = npt.NDArray[np.bool_]


@njit(cache=True, nogil=True)
def _along_columns(mask, gap, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    """Rows to the nearest unmarked cell of the same column; rows + columns where there is none. Columns of a slab.

    Of two as near the upper one counts, and the gap to a lower one is negative.
    """
    rows, columns = mask.shape
    far = rows + columns
    for j in range(first, last):
        gap[0, j] = far if mask[0, j] else 0
    for i in range(1, rows):
        for j in range(first, last):
            gap[i, j] = min(gap[i - 1, j] + 1, far) if mask[i, j] else 0
    for i in range(rows - 2, -1, -1):
        for j in range(first, last):
            below = 1 + abs(gap[i + 1, j])
            gap[i, j] = -below if below < gap[i, j] else gap[i, j]


@njit(cache=True, nogil=True)
def _envelope(gap, left, right, start, owner, height):  # type: ignore[no-untyped-def]  # as above
    """Lower envelope of the parabolas that stand on a stretch of a row's gaps; gives how many stretches it has."""
    for j in range(left, right):
        height[j] = np.int64(gap[j]) ** 2
    q = 0
    start[0] = owner[0] = left
    for u in range(left + 1, right):
        while q >= 0 and (start[q] - owner[q]) ** 2 + height[owner[q]] > (start[q] - u) ** 2 + height[u]:
            q -= 1
        if q < 0:
            q = 0
            start[0], owner[0] = left, u
        else:
            o = owner[q]
            # whole numbers far below 2^53: their quotient is rounded too little to reach the next whole one
            w = 1 + np.int64(np.floor((u * u - o * o + height[u] - height[o]) / (2.0 * (u - o))))
            if w < right:
                q += 1
                owner[q] = u
                start[q] = w
    return q


@njit(cache=True, nogil=True)
def _along_rows(gap, distance, row, column, asked, first, last):  # type: ignore[no-untyped-def]  # as above
    """Distances of the marked cells of a slab, or (`asked`) places of the unmarked cells nearest to them.

    Each run of marked cells by itself: nothing beyond the unmarked ones at its ends is nearer than they are.
    """
    columns = gap.shape[1]
    start, owner, height = np.empty((3, columns), np.int64)
    for i in range(first, last):
        j = 0
        while j < columns:
            if gap[i, j] == 0:
                j += 1
                continue
            begin = j
            while j < columns and gap[i, j] != 0:
                j += 1
            q = _envelope(gap[i], max(0, begin - 1), min(columns, j + 1), start, owner, height)
            for u in range(min(columns, j + 1) - 1, max(0, begin - 1) - 1, -1):
                if begin <= u < j:
                    if asked:
                        row[i, u], column[i, u] = i - gap[i, owner[q]], owner[q]
                    else:
                        distance[i, u] = np.sqrt((u - owner[q]) ** 2 + height[owner[q]])
                if u == start[q]:
                    q -= 1


def _gaps(mask: Mask) -> npt.NDArray[np.int32]:
    gap = np.empty(mask.shape, dtype=np.int32)
    in_slabs(mask.shape[1], lambda first, last: _along_columns(mask, gap, first, last))
    return gap


def inner_distance(mask: Mask) -> npt.NDArray[np.float64]:
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
    distance = np.zeros(mask.shape, dtype=np.float64)
    if mask.size:
        gap, none = _gaps(mask), np.zeros((1, 1), dtype=np.int32)
        in_slabs(len(mask), lambda first, last: _along_rows(gap, distance, none, none, False, first, last))
    return distance


def nearest_outside(mask: Mask) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Row and column of the unmarked cell that is nearest to each marked one; arbitrary where not marked.

    Parameters
    ----------
    mask : ndarray of bool, shape (rows, columns)
        Not all of it is marked.
    """
    row, column = np.empty((2, *mask.shape), dtype=np.int32)
    gap, none = _gaps(mask), np.zeros((1, 1), dtype=np.float64)
    in_slabs(len(mask), lambda first, last: _along_rows(gap, none, row, column, True, first, last))
    return row, column
