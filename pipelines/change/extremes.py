"""Greatest and least value of a square window, in time that grows with the logarithm of its side."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["greatest", "least"]

Floats = npt.NDArray[np.float32]

# The greatest of 2, 4, 8, ... values in a row, each from two of the step before, then of the window from two that
# overlap: loops that go the same way over whole lines, as wide registers like them.
LINES = 64
"""Columns of a map that are worked on at once: with a window's rows they fit the processor's cache."""


@njit(cache=True, nogil=True)
def _along_rows(values, reach, sign, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types
    columns = values.shape[1]
    window = 2 * reach + 1
    line, other = np.empty(columns + 2 * reach, np.float32), np.empty(columns + 2 * reach, np.float32)
    none = np.float32(-np.inf)
    for i in range(first, last):
        line[:reach] = none
        inner, row = line[reach : reach + columns], values[i]
        for j in range(columns):
            inner[j] = sign * row[j] if abs(row[j]) < np.inf else none
        line[reach + columns :] = none
        side, size = 1, line.size
        while 2 * side <= window:
            size -= side
            ahead = line[side:]
            for k in range(size):
                other[k] = line[k] if line[k] > ahead[k] else ahead[k]
            line, other = other, line
            side *= 2
        ahead, to = line[window - side :], out[i]
        for j in range(columns):
            to[j] = line[j] if line[j] > ahead[j] else ahead[j]


@njit(cache=True, nogil=True)
def _along_columns(values, reach, sign, out, first, last):  # type: ignore[no-untyped-def]  # as above
    rows = values.shape[0]
    window = 2 * reach + 1
    lines = np.empty((rows + 2 * reach, LINES), np.float32)
    for left in range(first, last, LINES):
        wide = min(LINES, last - left)
        lines[:reach] = -np.inf
        lines[reach + rows :] = -np.inf
        lines[reach : reach + rows, :wide] = values[:, left : left + wide]
        side, size = 1, rows + 2 * reach
        while 2 * side <= window:
            size -= side
            for k in range(size):
                line, ahead = lines[k], lines[k + side]
                for j in range(LINES):
                    line[j] = line[j] if line[j] > ahead[j] else ahead[j]
            side *= 2
        for i in range(rows):
            line, ahead, to = lines[i], lines[i + window - side], out[i, left : left + wide]
            for j in range(wide):
                to[j] = sign * (line[j] if line[j] > ahead[j] else ahead[j])


def greatest(values: Floats, cells: int) -> Floats:
    """Greatest value of the part of a square window that lies on the map.

    Parameters
    ----------
    values : ndarray of float32, shape (rows, columns)
        A cell that is not finite does not count.
    cells : int
        Side of the window, odd.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        -inf where no cell of the window counts.
    """
    return _farthest(values, cells, 1)


def least(values: Floats, cells: int) -> Floats:
    """Least value of the part of a square window that lies on the map, as `greatest`; +inf where no cell counts."""
    return _farthest(values, cells, -1)


def _farthest(values: Floats, cells: int, towards: int) -> Floats:
    rows, columns = values.shape
    reach, sign = cells // 2, np.float32(towards)
    wide, out = np.empty_like(values), np.empty_like(values)
    in_slabs(rows, lambda first, last: _along_rows(values, reach, sign, wide, first, last))
    in_slabs(columns, lambda first, last: _along_columns(wide, reach, sign, out, first, last))
    return out
