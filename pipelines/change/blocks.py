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


@njit(cache=True, nogil=True)
def _summed(values, side, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    rows, columns = values.shape
    for r in range(first, last):
        for i in range(r * side, min(rows, (r + 1) * side)):
            for j in range(columns):
                out[r, j // side] += values[i, j]


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
    for r in range(first, last):
        low, high = r * side, min(rows, (r + 1) * side)
        for c in range(out.shape[1]):
            total, count = 0.0, 0
            for i in range(low, high):
                for j in range(c * side, min(columns, (c + 1) * side)):
                    z = values[i, j]
                    known = abs(z) < np.inf
                    count += known
                    total += z if known else 0.0
            out[r, c] = total / count if count >= least else np.nan


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
    squares = 0.0
    for r in range(first, last):
        for i in range(r * side, min(rows, (r + 1) * side)):
            for j in range(columns):
                off = np.float64(dz[i, j]) - middle
                if stable[i, j] and abs(off) <= bound:
                    sums[r, j // side] += off
                    counts[r, j // side] += 1
                    squares += off * off
    return squares


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
