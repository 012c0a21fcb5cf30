"""The passes over a map that roughness needs: a Gaussian mean, a polynomial taken out, sums of powers; compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["gaussian_mean", "moments", "power_sums", "without_form"]

Floats = npt.NDArray[np.float64]

TRUNCATED = 5.0
"""The Gaussian ends at so many standard deviations."""


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _mean(values, half, out, first, last):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    rows, columns = values.shape
    reach = half.size - 1
    total, weight = np.zeros((2, columns + 2 * reach))
    inner_total, inner_weight = total[reach : reach + columns], weight[reach : reach + columns]
    for i in range(first, last):
        inner_total[:] = 0
        inner_weight[:] = 0
        for r in range(max(0, i - reach), min(rows, i + reach + 1)):
            w, row = half[abs(r - i)], values[r]
            for j in range(columns):
                good = abs(row[j]) < np.inf
                inner_total[j] += w * (row[j] if good else 0.0)
                inner_weight[j] += w if good else 0.0
        line = out[i]
        counts = np.zeros(columns)
        line[:] = 0
        for k in range(2 * reach + 1):
            w = half[abs(k - reach)]
            some, others = total[k:], weight[k:]
            for j in range(columns):
                line[j] += w * some[j]
                counts[j] += w * others[j]
        row = values[i]
        for j in range(columns):
            line[j] = line[j] / counts[j] if abs(row[j]) < np.inf else np.nan


def gaussian_mean(values: Floats, sigma: float) -> Floats:
    """Mean of the measured cells under a Gaussian; beyond the border nothing is measured.

    Parameters
    ----------
    values : ndarray of float64, shape (rows, columns)
        NaN where not measured, and so it stays.
    sigma : float
        Of the Gaussian, cells.
    """
    half = np.exp(-0.5 * (np.arange(int(TRUNCATED * sigma + 0.5) + 1) / sigma) ** 2)
    half /= 2 * half.sum() - half[0]
    out = np.empty_like(values)
    in_slabs(len(values), lambda first, last: _mean(values, half, out, first, last))
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _moments(values, x, y, known, heights, first, last):  # type: ignore[no-untyped-def]  # as above
    powers = x.shape[0]
    count, total = np.empty(powers), np.empty(powers)
    for i in range(first, last):
        row = values[i]
        for a in range(powers):
            n = z = 0.0
            for j in range(row.size):
                good = abs(row[j]) < np.inf
                n += x[a, j] if good else 0.0
                z += x[a, j] * row[j] if good else 0.0
            count[a], total[a] = n, z
        for b in range(y.shape[0]):
            for a in range(powers):
                known[b, a] += y[b, i] * count[a]
                heights[b, a] += y[b, i] * total[a]


def moments(values: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Sums over the measured cells of products of powers of their places, and of those times the heights.

    Parameters
    ----------
    values : ndarray of float64, shape (rows, columns)
    x, y : ndarray of float64, shapes (powers, columns) and (powers, rows)

    Returns
    -------
    known, heights : ndarray of float64, shape (powers of y, powers of x)
    """

    def part(first: int, last: int) -> Floats:
        sums = np.zeros((2, len(y), len(x)))
        _moments(values, x, y, sums[0], sums[1], first, last)
        return sums

    known, heights = np.sum(in_slabs(len(values), part), axis=0)
    return known, heights


@njit(cache=True, nogil=True, fastmath={"contract"})
def _without(values, x, along, out, first, last):  # type: ignore[no-untyped-def]  # as above
    total = 0.0
    count = 0
    for i in range(first, last):
        row, line = values[i], out[i]
        line[:] = row
        for a in range(x.shape[0]):
            factor = along[i, a]
            for j in range(row.size):
                line[j] -= factor * x[a, j]
        for j in range(row.size):
            good = abs(line[j]) < np.inf
            total += line[j] if good else 0.0
            count += good
    return total, count


def without_form(values: Floats, factors: Floats, x: Floats, y: Floats) -> Floats:
    """Take a polynomial and then the mean out.

    Parameters
    ----------
    values : ndarray of float64, shape (rows, columns)
        NaN where not measured, and so it stays.
    factors : ndarray of float64, shape (powers of y, powers of x)
    x, y : ndarray of float64, shapes (powers, columns) and (powers, rows)
    """
    out = np.empty_like(values)
    along = y.T @ factors
    sums = in_slabs(len(values), lambda first, last: _without(values, x, along, out, first, last))
    total, count = np.sum(sums, axis=0)
    out -= total / count
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _powers(values, first, last):  # type: ignore[no-untyped-def]  # as above
    n = 0
    sizes = squares = cubes = fourths = 0.0
    top, bottom = -np.inf, np.inf
    for i in range(first, last):
        row = values[i]
        for j in range(row.size):
            good = abs(row[j]) < np.inf
            z = row[j] if good else 0.0
            n += good
            sizes += abs(z)
            squares += z * z
            cubes += z * z * z
            fourths += z * z * z * z
            top = max(top, z if good else -np.inf)
            bottom = min(bottom, z if good else np.inf)
    return n, sizes, squares, cubes, fourths, top, bottom


def power_sums(values: Floats) -> tuple[float, float, float, float, float, float, float]:
    """Number of the measured cells; sums of their sizes, squares, cubes and fourth powers; highest and lowest."""
    parts = np.array(in_slabs(len(values), lambda first, last: _powers(values, first, last)))
    n, sizes, squares, cubes, fourths = (float(each) for each in parts[:, :5].sum(axis=0))
    return n, sizes, squares, cubes, fourths, float(parts[:, 5].max()), float(parts[:, 6].min())
