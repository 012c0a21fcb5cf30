"""Connected parts of a mask: numbered, summed over, kept or not; and a mask that spreads within another."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs

__all__ = ["by_part", "part_greatest", "part_sums", "parts", "spread"]

Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]
Value = TypeVar("Value", np.bool_, np.int32, np.float32)


@njit(cache=True, nogil=True)
def _root(parent, label):  # type: ignore[no-untyped-def]  # numba infers the types
    while parent[label] != label:
        parent[label] = parent[parent[label]]
        label = parent[label]
    return label


@njit(cache=True, nogil=True)
def _joined(parent, one, two):  # type: ignore[no-untyped-def]  # as above
    one, two = _root(parent, one), _root(parent, two)
    if one == two:
        return one
    low, high = min(one, two), max(one, two)
    parent[high] = low
    return low


@njit(cache=True, nogil=True)
def _begun(mask, diagonal, labels, parent, first, last):  # type: ignore[no-untyped-def]  # as above
    """Number the parts of a slab, as far as it alone tells; gives the first number not used.

    A parent's number is never above its child's.
    """
    columns = mask.shape[1]
    free = 1 + first * ((columns + 1) // 2)  # in a row a part begins at every second cell at most
    for i in range(first, last):
        label = np.int32(0)
        for j in range(columns):
            if not mask[i, j]:
                label = np.int32(0)
                labels[i, j] = 0
                continue
            above = labels[i - 1, j] if i > first else np.int32(0)
            if above:
                # what lies to either side of it is of its part already
                if label != above:
                    label = _joined(parent, label, above) if label else above
            elif diagonal and i > first:
                if not label and j > 0:
                    label = labels[i - 1, j - 1]
                after = labels[i - 1, j + 1] if j + 1 < columns else np.int32(0)
                if after and label != after:
                    label = _joined(parent, label, after) if label else after
            if not label:
                label = np.int32(free)
                parent[free] = label
                free += 1
            labels[i, j] = label
    return free


@njit(cache=True, nogil=True)
def _sewn(labels, diagonal, parent, row):  # type: ignore[no-untyped-def]  # as above
    """Join the parts of two slabs along the row with which the second begins."""
    columns = labels.shape[1]
    reach = 1 if diagonal else 0
    for j in range(columns):
        if labels[row, j]:
            for k in range(max(0, j - reach), min(columns, j + reach + 1)):
                if labels[row - 1, k]:
                    _joined(parent, labels[row, j], labels[row - 1, k])


@njit(cache=True, nogil=True)
def _counted(parent, first, last, count):  # type: ignore[no-untyped-def]  # as above
    """Turn parents into numbers without gaps, in place; gives how many there are."""
    for label in range(first, last):
        if parent[label] == label:
            count += 1
            parent[label] = count
        else:
            parent[label] = parent[parent[label]]
    return count


@njit(cache=True, nogil=True)
def _renamed(labels, numbers, first, last):  # type: ignore[no-untyped-def]  # as above
    for i in range(first, last):
        for j in range(labels.shape[1]):
            labels[i, j] = numbers[labels[i, j]]


def parts(mask: Mask, *, diagonal: bool) -> tuple[Labels, int]:
    """Number the connected parts of a mask.

    Parameters
    ----------
    mask : ndarray of bool, shape (rows, columns)
    diagonal : bool
        Whether cells that touch at a corner hang together.

    Returns
    -------
    labels : ndarray of int32, shape (rows, columns)
        From 1, in the order of each part's first cell, row by row; 0 where not marked.
    count : int
    """
    rows, columns = mask.shape
    labels = np.empty(mask.shape, dtype=np.int32)
    parent = np.empty(1 + rows * ((columns + 1) // 2), dtype=np.int32)
    parent[0] = 0
    slabs = in_slabs(rows, lambda first, last: (first, _begun(mask, diagonal, labels, parent, first, last)), least=256)
    for first, _ in slabs[1:]:
        _sewn(labels, diagonal, parent, first)
    count = 0
    for first, free in slabs:
        count = _counted(parent, 1 + first * ((columns + 1) // 2), free, count)
    in_slabs(rows, lambda first, last: _renamed(labels, parent, first, last), least=256)
    return labels, count


@njit(cache=True, nogil=True)
def _added(labels, values, where, everywhere, sums, first, last):  # type: ignore[no-untyped-def]  # as above
    for i in range(first, last):
        for j in range(labels.shape[1]):
            if labels[i, j] and (everywhere or where[i, j]):
                sums[labels[i, j]] += values[i, j]


def part_sums(
    labels: Labels, count: int, values: npt.NDArray[np.floating] | Mask, where: Mask | None = None
) -> npt.NDArray[np.float64]:
    """Sum values, or count marked cells, over each of `count` parts, or those of its cells that are marked by `where`.

    Returns
    -------
    ndarray of float64, shape (count + 1,)
        By label; 0 at 0, for what is of no part.
    """

    def slab(first: int, last: int) -> npt.NDArray[np.float64]:
        sums = np.zeros(count + 1)
        _added(labels, values, labels if where is None else where, where is None, sums, first, last)
        return sums

    total: npt.NDArray[np.float64] = np.sum(in_slabs(len(labels), slab, least=256), axis=0)
    return total


@njit(cache=True, nogil=True)
def _raised(labels, values, most, first, last):  # type: ignore[no-untyped-def]  # as above
    for i in range(first, last):
        for j in range(labels.shape[1]):
            if values[i, j] > most[labels[i, j]] and labels[i, j]:
                most[labels[i, j]] = values[i, j]


def part_greatest(labels: Labels, count: int, values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Greatest value of each of `count` parts, by label; 0 where none is above, and for what is of no part."""

    def slab(first: int, last: int) -> npt.NDArray[np.float32]:
        most = np.zeros(count + 1, dtype=np.float32)
        _raised(labels, values, most, first, last)
        return most

    greatest: npt.NDArray[np.float32] = np.max(in_slabs(len(labels), slab, least=256), axis=0)
    return greatest


@njit(cache=True, nogil=True)
def _given(labels, of_part, out, first, last):  # type: ignore[no-untyped-def]  # as above
    for i in range(first, last):
        for j in range(labels.shape[1]):
            label = labels[i, j]
            out[i, j] = of_part[label] if label else 0


def by_part(labels: Labels, of_part: npt.NDArray[Value]) -> npt.NDArray[Value]:
    """Give each cell what its part is given by label; 0, or False, where there is no part."""
    out = np.empty(labels.shape, dtype=of_part.dtype)
    in_slabs(len(labels), lambda first, last: _given(labels, of_part, out, first, last), least=256)
    return out


@njit(cache=True, nogil=True)
def _spread(found, within, steps):  # type: ignore[no-untyped-def]  # as above
    rows, columns = found.shape
    queue = np.empty(found.size, np.int32)
    head = tail = 0
    for i in range(rows):
        for j in range(columns):
            if found[i, j]:
                queue[tail] = i * columns + j
                tail += 1
    while head < tail and steps != 0:
        end = tail
        while head < end:
            i, j = queue[head] // columns, queue[head] % columns
            head += 1
            for r in range(max(0, i - 1), min(rows, i + 2)):
                for c in range(max(0, j - 1), min(columns, j + 2)):
                    if within[r, c] and not found[r, c]:
                        found[r, c] = True
                        queue[tail] = r * columns + c
                        tail += 1
        steps -= 1


def spread(seeds: Mask, within: Mask, steps: int = -1) -> Mask:
    """Mark what can be reached from some cells by steps to one of the eight neighbours, within a mask.

    Parameters
    ----------
    seeds, within : ndarray of bool, shape (rows, columns)
        Seeds stay marked, whether within or not.
    steps : int
        At most so many; any number if below 0.
    """
    found = seeds.copy()
    _spread(found, within, steps)
    return found
