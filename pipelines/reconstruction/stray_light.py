"""Places that only stray light shows: coarser cells that lie on no surface which finer cells beside them show."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .kernels import NO_CELL, TILE

__all__ = ["refuse_strays"]

FEW = 8
"""Pairs of pixels that decide on a surface, at least."""
NEAR = 8
"""Camera pixels from a jump in which nothing is joined."""
SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))
STEP = 2
"""Half cells by which a surface may grow per camera pixel."""

U16 = npt.NDArray[np.uint16]


@numba.njit(cache=True, nogil=True, inline="always")
def _half(column, row, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Half the width of a pixel's cell, of the coarser axis, in half cells; 0 where it has none."""
    a, b = np.int32(column[i, j]), np.int32(row[i, j])
    return max(a & -a, b & -b)


@numba.njit(cache=True, nogil=True, inline="always")
def _joined(column, row, i, j, y, x, away):  # type: ignore[no-untyped-def]  # numba infers
    """Whether two pixels may lie on one surface."""
    joined = True
    for steps in (column, row):
        a, b = np.int32(steps[i, j]), np.int32(steps[y, x])
        if a != NO_CELL and b != NO_CELL:
            joined &= abs(a - b) <= (a & -a) + (b & -b) + STEP * away
    return joined


@numba.njit(cache=True, nogil=True)
def _beside(column, row, i, j, side):  # type: ignore[no-untyped-def]  # numba infers
    """Distance and place of the nearest decoded pixel to one side, no farther than a tile; 0 if there is none."""
    di, dj = SIDES[side]
    for away in range(1, TILE + 1):
        y, x = i + away * di, j + away * dj
        if not (0 <= y < column.shape[0] and 0 <= x < column.shape[1]):
            break
        if _half(column, row, y, x):
            return away, y, x
    return 0, i, j


@numba.njit(cache=True, nogil=True)
def _torn(column, row):  # type: ignore[no-untyped-def]  # numba infers
    """Pixels of coarser cells near a jump. Two surfaces that cross seem one where they do, but near it they jump."""
    H, W = column.shape
    torn = np.zeros((H, W), np.bool_)
    for i in range(H):
        for j in range(W):
            if _half(column, row, i, j) <= 1:
                continue
            for side in range(4):
                away, y, x = _beside(column, row, i, j, side)
                if away and not _joined(column, row, i, j, y, x, away):
                    torn[max(0, i - NEAR) : i + NEAR + 1, max(0, j - NEAR) : j + NEAR + 1] = True
                    break
    return torn


@numba.njit(cache=True, nogil=True)
def _spread(column, row, label, mine, barred, queue, first, last):  # type: ignore[no-untyped-def]  # numba infers
    """Give the label to all coarser pixels that those in the queue are joined with; the queue's new end."""
    while first < last:
        i, j = np.intp(queue[first, 0]), np.intp(queue[first, 1])
        first += 1
        for di, dj in SIDES:
            y, x = i + di, j + dj
            if not (0 <= y < label.shape[0] and 0 <= x < label.shape[1]) or label[y, x] or barred[y, x]:
                continue
            if _half(column, row, y, x) > 1 and _joined(column, row, i, j, y, x, 1):
                label[y, x] = mine
                queue[last] = y, x
                last += 1
    return last


@numba.njit(cache=True, nogil=True)
def _goes_on(column, row, torn, i, j):  # type: ignore[no-untyped-def]  # numba infers
    """Whether a pixel's surface goes on in finer cells next to it, for a tile at least."""
    for di, dj in SIDES:
        y, x = i + di, j + dj
        if not (0 <= y < column.shape[0] and 0 <= x < column.shape[1]) or torn[y, x]:
            continue
        if not 0 < _half(column, row, y, x) < _half(column, row, i, j):
            continue
        far, before, whole = 1, (i, j), True
        while whole and far <= TILE:
            y, x = i + far * di, j + far * dj
            whole = 0 <= y < column.shape[0] and 0 <= x < column.shape[1]
            if whole and _half(column, row, y, x):
                whole = _joined(column, row, before[0], before[1], y, x, 1)
                before = (y, x)
            far += 1
        if whole:
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _meets(column, row, label, anchored, i, j):  # type: ignore[no-untyped-def]  # numba infers
    """Whether finer cells or an anchored surface are near a pixel of a surface."""
    own, mine = _half(column, row, i, j), label[i, j]
    for di, dj in SIDES:
        for away in range(1, NEAR + TILE + 1):
            y, x = i + away * di, j + away * dj
            if not (0 <= y < label.shape[0] and 0 <= x < label.shape[1]) or label[y, x] == mine:
                break
            half = _half(column, row, y, x)
            if half and (half < own or anchored[label[y, x]]):
                return True
    return False


@numba.njit(cache=True, nogil=True)
def _refuse(column, row, label, queue):  # type: ignore[no-untyped-def]  # numba infers
    """Refuse the pixels in the queue and what goes on from them: near jumps, and in tiles mostly of others."""
    if len(queue) == 0:
        return 0
    gone = np.empty((column.size, 2), np.int32)  # memory that is not used costs nothing
    gone[: len(queue)] = queue
    first, last = 0, len(queue)
    for _ in range(3 * NEAR):  # not further: where surfaces cross, others seem to go on from them
        stop = last
        for n in range(first, stop):
            i, j = np.intp(gone[n, 0]), np.intp(gone[n, 1])
            for di, dj in SIDES:
                y, x = i + di, j + dj
                if not (0 <= y < label.shape[0] and 0 <= x < label.shape[1]) or label[y, x]:
                    continue
                if _half(column, row, y, x) and _joined(column, row, i, j, y, x, 1):
                    label[y, x] = -1
                    gone[last] = y, x
                    last += 1
        first = stop
    for n in range(last):
        i, j = np.intp(gone[n, 0]), np.intp(gone[n, 1])
        column[i, j] = NO_CELL
        row[i, j] = NO_CELL
    return last


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def refuse_strays(column: U16, row: U16) -> int:
    """Refuse surfaces of coarser cells that end in a jump wherever they meet finer ones.

    In shadow a pixel may still see the pattern: by light that a wall throws there, which has lost the finest stripes
    on its way and belongs to another place. A pixel alone cannot tell that from a blurred lens. A surface can: a lens
    blurs what is next to it as well, and where the blur ends the same surface goes on in finer cells.

    Surfaces are neighbouring pixels of coarser cells without a jump between them. One that goes on in finer cells
    somewhere is anchored. One that is not is refused if it meets finer cells, or an anchored surface, beyond a jump;
    where all around is as coarse it is kept.

    Parameters
    ----------
    column, row : ndarray of uint16, shape (row, column)
        Half steps; changed to `NO_CELL` where refused.

    Returns
    -------
    int
        Pixels refused.
    """
    H, W = column.shape
    torn = _torn(column, row)
    count = 0
    for i in range(H):
        for j in range(W):
            count += _half(column, row, i, j) > 1
    label = np.zeros((H, W), np.int32)
    queue = np.empty((count, 2), np.int32)
    begin = np.zeros(count + 2, np.int32)  # of each surface in the queue, which keeps all of them
    anchored = np.zeros(count + 1, np.bool_)
    last, surfaces = 0, 0
    for i in range(H):
        for j in range(W):
            if label[i, j] or torn[i, j] or _half(column, row, i, j) <= 1:
                continue
            surfaces += 1
            begin[surfaces] = last
            label[i, j] = surfaces
            queue[last] = i, j
            last = _spread(column, row, label, surfaces, torn, queue, last, last + 1)
            met = 0
            for n in range(begin[surfaces], last):
                met += _goes_on(column, row, torn, np.intp(queue[n, 0]), np.intp(queue[n, 1]))
            anchored[surfaces] = met >= FEW
    begin[surfaces + 1] = last
    found = queue[:last].copy()
    gone = 0
    for surface in range(1, surfaces + 1):
        met = 0
        for n in range(begin[surface], begin[surface + 1]):
            if anchored[surface] or met >= FEW:
                break
            met += _meets(column, row, label, anchored, np.intp(found[n, 0]), np.intp(found[n, 1]))
        if met >= FEW:
            queue[gone : gone + begin[surface + 1] - begin[surface]] = found[begin[surface] : begin[surface + 1]]
            gone += begin[surface + 1] - begin[surface]
    return int(_refuse(column, row, label, queue[:gone]))
