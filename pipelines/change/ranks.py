"""Medians of what is known, exact, in one pass: a sample brackets the middle, and only what lies between is sorted."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["MAD_TO_SIGMA", "at_rank", "median", "ordered", "robust_sigma", "some_rows"]

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, for a normal distribution."""
SAMPLED = 8192
"""Values of a large map that are sorted to find a bracket; of n values their power of 2/3 if that is less."""
LEAST_SAMPLED = 200
BESIDE = 4.0
"""The bracket reaches so many standard errors of a sample's median to either side."""
SMALL = 4096
"""Fewer values are sorted as they are."""
BLOCK = 2048
ENOUGH = 1_000_000
"""Values of which a spread is known to a thousandth: of more, some rows are looked at where that will do."""

Mask = npt.NDArray[np.bool_]


@njit(cache=True, nogil=True)
def at_rank(keys, count, rank):  # type: ignore[no-untyped-def]  # numba infers the types
    """Key of a rank (from 0) among the first `count`: by halving, 32 counts in wide registers. For compiled loops."""
    low, high = np.int64(-(2**31)), np.int64(2**31 - 1)
    while low < high:
        middle = (low + high) >> 1
        bound = np.int32(middle)
        below = 0
        for k in range(count):
            below += keys[k] <= bound
        if below > rank:
            high = middle
        else:
            low = middle + 1
    return np.int32(low)


@njit(cache=True, nogil=True)
def ordered(bits):  # type: ignore[no-untyped-def]  # as above
    """Bits of a float32 to a whole number in the order of the floats, and back. For compiled loops."""
    return np.int32(bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF)))


@njit(cache=True, nogil=True)
def _between(values, use, masked, about, centred, low, high, inside, first, last):  # type: ignore[no-untyped-def]
    """How many values are known, how many of them lie below `low`; those up to `high` into `inside`.

    In blocks: what lies between is marked first, in wide registers, and only where there is any it is gathered. Of
    bounds that are the same nothing is gathered.
    """
    block = np.empty(BLOCK, values.dtype)
    marks = np.zeros(BLOCK, np.uint8)
    words = marks.view(np.uint64)
    known = below = kept = 0
    for start in range(first, last, BLOCK):
        size = min(BLOCK, last - start)
        some, marks[size:] = values[start : start + size], 0
        if centred:
            for k in range(size):
                block[k] = abs(some[k] - about)
        else:
            for k in range(size):
                block[k] = some[k]
        if masked:
            may = use[start : start + size]
            for k in range(size):
                block[k] = block[k] if may[k] else np.inf
        for k in range(size):
            known += abs(block[k]) < np.inf
        for k in range(size):
            below += (block[k] < low) & (block[k] > -np.inf)
        for k in range(size):
            marks[k] = (block[k] >= low) & (block[k] <= high) & (abs(block[k]) < np.inf)
        if low == high:
            for k in range(size):
                kept += marks[k]
            continue
        for word in range((size + 7) // 8):
            if words[word]:
                for k in range(8 * word, min(8 * word + 8, size)):
                    # no branch: what does not count is written over by the next
                    inside[first + kept] = block[k]
                    kept += marks[k]
    return known, below, kept


def median(values: npt.NDArray[np.floating], use: Mask | None = None, about: float | None = None) -> float:
    """Median of the finite values, or of their distances from `about`; that of numpy, bit by bit.

    Parameters
    ----------
    values : ndarray of float32 or float64
    use : ndarray of bool, of the same shape, optional
        Which count.
    about : float, optional
        In the values' type: then ``|value - about|`` is ranked.

    Returns
    -------
    float
        NaN where nothing is finite.
    """
    flat = np.ascontiguousarray(values).reshape(-1)
    mask = np.zeros(1, dtype=np.bool_) if use is None else np.ascontiguousarray(use).reshape(-1)
    centre = values.dtype.type(0 if about is None else about)
    given = flat, mask, use is not None, centre, about is not None
    if flat.size > SMALL:
        # a stride that shares no factor with a row's length does not run down columns
        every = (flat.size // min(SAMPLED, round(flat.size ** (2 / 3)))) | 1
        some = flat[::every] if use is None else flat[::every][mask[::every]]
        some = some if about is None else np.abs(some - centre)
        some = np.sort(some[np.isfinite(some)])
        if some.size > LEAST_SAMPLED:
            reach = BESIDE * 0.5 / np.sqrt(some.size)
            low, high = some[[int((0.5 - reach) * some.size), int((0.5 + reach) * some.size)]]
            found = _ranked(given, low, high)
            if found is not None:
                return found
    found = _ranked(given, values.dtype.type(-np.inf), values.dtype.type(np.inf))
    assert found is not None
    return found


def _ranked(given: tuple[Any, ...], low: np.floating, high: np.floating) -> float | None:
    """The median, if it lies between two bounds."""
    inside = np.empty_like(given[0])
    parts = in_slabs(
        given[0].size, lambda first, last: (first, *_between(*given, low, high, inside, first, last)), least=100_000
    )
    known = sum(part[1] for part in parts)
    if known == 0:
        return float("nan")
    below, count = sum(part[2] for part in parts), sum(part[3] for part in parts)
    lower, upper = (known - 1) // 2 - below, known // 2 - below
    if lower < 0 or upper >= count:
        return None
    if low == high:  # heights and sigmas of a store are steps of some size: many are the same
        return float(low)
    kept = np.concatenate([inside[first : first + number] for first, _, _, number in parts])
    kept.partition((lower, upper))
    return float(np.mean(kept[[lower, upper]]))


def some_rows(values: npt.NDArray[np.floating], use: Mask) -> tuple[npt.NDArray[np.floating], Mask]:
    """Give every so manieth row of a map of several million cells, and of the mask that goes with it."""
    step = max(1, values.size // ENOUGH)
    return values[::step], use[::step]


def robust_sigma(values: npt.NDArray[np.floating], use: Mask | None = None) -> float:
    """1.4826 times the median absolute deviation from the median of the finite values; NaN if there is none."""
    middle = median(values, use)
    return MAD_TO_SIGMA * median(values, use, middle) if np.isfinite(middle) else middle
