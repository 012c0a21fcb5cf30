"""Greatest and least value of a square window, in time that does not grow with the window."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["greatest", "least"]

Floats = npt.NDArray[np.float32]


@njit(cache=True, nogil=True)
def _along_rows(values, reach, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types
    """Running maximum of each row of a slab (van Herk 1992, Gil and Werman 1993): two maxima a cell."""
    columns = values.shape[1]
    window = 2 * reach + 1
    size = columns + 2 * reach
    ahead = np.full(size, -np.inf, np.float32)
    back = np.full(size, -np.inf, np.float32)
    for i in range(first, last):
        for j in range(columns):
            ahead[reach + j] = back[reach + j] = values[i, j]
        ahead[reach + columns :] = -np.inf
        back[:reach] = -np.inf
        for k in range(1, size):
            if k % window != 0 and ahead[k - 1] > ahead[k]:
                ahead[k] = ahead[k - 1]
        for k in range(size - 2, -1, -1):
            if (k + 1) % window != 0 and back[k + 1] > back[k]:
                back[k] = back[k + 1]
        for j in range(columns):
            out[i, j] = max(back[j], ahead[j + 2 * reach])


@njit(cache=True, nogil=True)
def _along_columns(values, reach, out, first, last):  # type: ignore[no-untyped-def]  # as above
    """The same along columns, a slab of columns at once."""
    rows = values.shape[0]
    window = 2 * reach + 1
    size = rows + 2 * reach
    ahead = np.full((size, last - first), -np.inf, np.float32)
    back = np.full((size, last - first), -np.inf, np.float32)
    ahead[reach : reach + rows] = values[:, first:last]
    back[reach : reach + rows] = values[:, first:last]
    for k in range(1, size):
        if k % window != 0:
            for j in range(last - first):
                ahead[k, j] = max(ahead[k - 1, j], ahead[k, j])
    for k in range(size - 2, -1, -1):
        if (k + 1) % window != 0:
            for j in range(last - first):
                back[k, j] = max(back[k + 1, j], back[k, j])
    for i in range(rows):
        for j in range(last - first):
            out[i, first + j] = max(back[i, j], ahead[i + 2 * reach, j])


def greatest(values: Floats, cells: int) -> Floats:
    """Greatest value of the part of a square window that lies on the map.

    Parameters
    ----------
    values : ndarray of float32, shape (rows, columns)
        No NaN; -inf where a cell does not count.
    cells : int
        Side of the window, odd.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
    """
    rows, columns = values.shape
    reach = cells // 2
    wide, out = np.empty_like(values), np.empty_like(values)
    in_slabs(rows, lambda first, last: _along_rows(values, reach, wide, first, last))
    in_slabs(columns, lambda first, last: _along_columns(wide, reach, out, first, last))
    return out


def least(values: Floats, cells: int) -> Floats:
    """Least value of the part of a square window that lies on the map; as `greatest`, +inf does not count."""
    return -greatest(-values, cells)
