"""Masks grown and shrunk by squares of 3 x 3 cells: what lies beyond the border is not marked."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["grown", "shrunk"]

Mask = npt.NDArray[np.bool_]


@njit(cache=True, nogil=True)
def _grown(mask, wanted, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    """Mark, in rows of a slab, what has a cell of a value among its nine; what lies beyond the border is not marked."""
    rows, columns = mask.shape
    beyond = np.uint8(0 if wanted else 1)
    line = np.zeros(columns + 2, np.uint8)
    for i in range(first, last):
        line[0] = line[columns + 1] = beyond
        inner = line[1 : columns + 1]
        inner[:] = beyond if i == 0 or i == rows - 1 else np.uint8(0)
        for r in range(max(0, i - 1), min(rows, i + 2)):
            row = mask[r]
            if wanted:
                for j in range(columns):
                    inner[j] |= row[j]
            else:
                for j in range(columns):
                    inner[j] |= row[j] ^ np.uint8(1)
        before, after, to = line[:columns], line[2:], out[i]
        if wanted:
            for j in range(columns):
                to[j] = before[j] | inner[j] | after[j]
        else:
            for j in range(columns):
                to[j] = (before[j] | inner[j] | after[j]) ^ np.uint8(1)


def grown(mask: Mask, times: int = 1) -> Mask:
    """Mark what has a marked cell among its nine, some times over: binary dilation."""
    return _repeated(mask, 1, times)


def shrunk(mask: Mask, times: int = 1) -> Mask:
    """Keep what has marked cells alone among its nine, some times over: binary erosion."""
    return _repeated(mask, 0, times)


def _repeated(mask: Mask, wanted: int, times: int) -> Mask:
    found = np.ascontiguousarray(mask).view(np.uint8)
    for _ in range(times):
        given, found = found, np.empty_like(found)
        in_slabs(len(given), lambda *rows, given=given, out=found: _grown(given, wanted, out, *rows), least=256)
    return found.view(np.bool_)
