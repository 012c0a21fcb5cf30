"""Sums and means over square blocks: correlations of a large map by blocks count every pair, by coarser lags."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["block_means", "block_side", "block_sums", "error_sums"]

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MOST_LAGS = 90
"""Errors that reach a quarter of the map are told apart by so many lags, no more."""


def block_side(longest_lag: int) -> int:
    """Side of a block, cells: 1 on maps of a shorter side below 720."""
    return max(1, longest_lag // MOST_LAGS)


# Rows of cells are added up to one row first, in the processor's wide registers, and that is folded to blocks.


@njit(cache=True, nogil=True, inline="always")
def _folded(line, side, out):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    for c in range(out.size):
        total = 0.0
        for j in range(c * side, min(line.size, (c + 1) * side)):
            total += line[j]
        out[c] = total


@njit(cache=True, nogil=True)
def _summed(values, side, out, first, last):  # type: ignore[no-untyped-def]  # as above
    rows, columns = values.shape
    line = np.empty(columns)
    for r in range(first, last):
        line[:] = 0
        for i in range(r * side, min(rows, (r + 1) * side)):
            for j in range(columns):
                line[j] += values[i, j]
        _folded(line, side, out[r])


def block_sums(values: npt.NDArray[np.bool_] | Floats, side: int) -> Floats:
    """Sum each block; those at the far borders may hold fewer cells.

    Parameters
    ----------
    values : ndarray of bool or float64, shape (rows, columns)
    side : int

    Returns
    -------
    ndarray of float64, shape (rows / side, columns / side), rounded up
    """
    if side == 1:
        return values.astype(np.float64)
    out = np.zeros(tuple(-(-n // side) for n in values.shape))
    in_slabs(len(out), lambda first, last: _summed(values, side, out, first, last), least=64)
    return out


@njit(cache=True, nogil=True)
def _averaged(values, side, least, out, first, last):  # type: ignore[no-untyped-def]  # as above
    rows, columns = values.shape
    total_by, count_by = np.empty(columns), np.empty(columns)
    total, count = np.empty(out.shape[1]), np.empty(out.shape[1])
    for r in range(first, last):
        total_by[:], count_by[:] = 0, 0
        for i in range(r * side, min(rows, (r + 1) * side)):
            for j in range(columns):
                known = abs(values[i, j]) < np.inf
                total_by[j] += values[i, j] if known else np.float32(0)
                count_by[j] += 1.0 if known else 0.0
        _folded(total_by, side, total)
        _folded(count_by, side, count)
        for c in range(out.shape[1]):
            out[r, c] = total[c] / count[c] if count[c] >= least else np.nan


def block_means(values: npt.NDArray[np.float32], side: int, least: int = 1) -> npt.NDArray[np.float32]:
    """Average each block over its finite cells; those at the far borders may hold fewer cells.

    Parameters
    ----------
    values : ndarray of float32, shape (rows, columns)
        NaN where not measured.
    side : int
    least : int
        A block of fewer finite cells is NaN.

    Returns
    -------
    ndarray of float32, shape (rows / side, columns / side), rounded up
    """
    out = np.empty(tuple(-(-n // side) for n in values.shape), np.float32)
    in_slabs(len(out), lambda first, last: _averaged(values, side, least, out, first, last), least=16)
    return out


@njit(cache=True, nogil=True)
def _errors(dz, stable, side, middle, bound, sums, counts, first, last):  # type: ignore[no-untyped-def]  # as above
    rows, columns = dz.shape
    off_by, count_by, squares = np.empty(columns), np.empty(columns), np.zeros(columns)
    for r in range(first, last):
        off_by[:], count_by[:] = 0, 0
        for i in range(r * side, min(rows, (r + 1) * side)):
            for j in range(columns):
                off = np.float64(dz[i, j]) - middle
                some = stable[i, j] & (abs(off) <= bound)
                off = off if some else 0.0
                off_by[j] += off
                count_by[j] += 1.0 if some else 0.0
                squares[j] += off * off
        _folded(off_by, side, sums[r])
        _folded(count_by, side, counts[r])
    return squares.sum()


def error_sums(
    dz: npt.NDArray[np.float32], stable: Mask, side: int, middle: float, bound: float
) -> tuple[Floats, Floats, float]:
    """Sum, by blocks, dz about its mean on the stable cells that lie no farther than `bound` from `middle`.

    Returns
    -------
    sums, counts : ndarray of float64, shape (rows / side, columns / side), rounded up
    variance : float
        Of one cell.
    """
    sums, counts = np.zeros((2, *(-(-n // side) for n in dz.shape)))
    parts = in_slabs(
        len(sums), lambda first, last: _errors(dz, stable, side, middle, bound, sums, counts, first, last), least=64
    )
    number = max(1.0, float(counts.sum()))
    mean = float(sums.sum()) / number
    return sums - mean * counts, counts, float(np.sum(parts)) / number - mean**2
