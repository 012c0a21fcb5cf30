"""The cells of one plate, and lines and parabolas of least squares through a band of them; each from one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from .curl import LEAST_CELLS

__all__ = ["BandSums", "PlateCells", "band_sums", "cells_of"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlateCells:
    """The cells of one plate, row by row.

    Parameters
    ----------
    row, column : ndarray of float64, shape (n,)
    values : ndarray of float64, shape (maps, n)
        What some maps show there.
    outline : int
        How many of the cells have a neighbour on one of the four sides that is not of the plate.
    """

    row: Floats
    column: Floats
    values: Floats
    outline: int


@njit(cache=True, nogil=True)
def _gathered(labels, label, top, bottom, left, right, one, two, three, row, column, values):  # type: ignore[no-untyped-def]  # numba infers the types
    n = outline = 0
    for i in range(top, bottom):
        for j in range(left, right):
            if labels[i, j] != label:
                continue
            row[n], column[n] = i, j
            values[0, n], values[1, n], values[2, n] = one[i, j], two[i, j], three[i, j]
            n += 1
            inner = i > top and j > left and i + 1 < bottom and j + 1 < right
            outline += not (
                inner
                and labels[i - 1, j] == label
                and labels[i + 1, j] == label
                and labels[i, j - 1] == label
                and labels[i, j + 1] == label
            )
    return n, outline


def cells_of(
    labels: npt.NDArray[np.int32],
    label: int,
    box: tuple[slice, slice],
    maps: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]],
) -> PlateCells:
    """Gather the cells of a label, which all lie in a box, and what three maps show there."""
    rows, columns = box
    most = (rows.stop - rows.start) * (columns.stop - columns.start)
    found = np.empty((5, most))
    given = rows.start, rows.stop, columns.start, columns.stop, *maps
    n, outline = _gathered(labels, label, *given, found[0], found[1], found[2:])
    return PlateCells(found[0, :n], found[1, :n], found[2:, :n], outline)


@njit(cache=True, nogil=True)
def _sums(d, dz, then, low, high):  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    """Number, powers 1 to 4 of d about the band's middle, dz times its powers 0 to 2, then times 0 and 1."""
    n = s1 = s2 = s3 = s4 = z0 = z1 = z2 = t0 = t1 = 0.0
    middle = 0.5 * (low + high)
    for k in range(d.size):
        if low < d[k] < high and np.isfinite(dz[k]):
            e = d[k] - middle
            n += 1
            s1 += e
            s2 += e * e
            s3 += e * e * e
            s4 += e * e * e * e
            z0 += dz[k]
            z1 += e * dz[k]
            z2 += e * e * dz[k]
            t0 += then[k]
            t1 += e * then[k]
    return n, s1, s2, s3, s4, z0, z1, z2, t0, t1


@dataclass(frozen=True, slots=True)
class BandSums:
    """What least squares need of a band of cells.

    Parameters
    ----------
    slope_now, slope_then : float
        Of the lines through dz and through the baseline's heights against d; NaN of fewer than 3 cells.
    bend : float
        Quadratic coefficient of the parabola through dz, 1/mm; NaN of fewer than 30 cells.
    bend_lever : float
        Sum of squares of d^2 about its regression on 1 and d: it divides the variance of `bend`.
    """

    slope_now: float
    slope_then: float
    bend: float
    bend_lever: float


def band_sums(d: Floats, dz: Floats, then: Floats, low: float, high: float) -> BandSums:
    """Fit the cells with ``low < d < high`` whose dz is known.

    Parameters
    ----------
    d, dz, then : ndarray of float64, shape (n,)
        Distance from the crack, difference of heights, and the baseline's heights, mm.
    low, high : float
        mm.
    """
    n, s1, s2, s3, s4, z0, z1, z2, t0, t1 = _sums(d, dz, then, low, high)
    nan = float("nan")
    if n < 3:
        return BandSums(nan, nan, nan, 0.0)
    # about the mean: d's variance, covariances with d^2, dz and the heights, each times n
    dd, dq, qq = s2 - s1 * s1 / n, s3 - s1 * s2 / n, s4 - s2 * s2 / n
    dh, qh, dt = z1 - s1 * z0 / n, z2 - s2 * z0 / n, t1 - s1 * t0 / n
    now, before = (dh / dd, dt / dd) if dd > 0 else (nan, nan)
    if n < LEAST_CELLS:
        return BandSums(now, before, nan, 0.0)
    lever = qq - dq * dq / max(dd, 1e-12)
    return BandSums(now, before, (qh - dq * now) / lever if lever > 0 else nan, lever)
