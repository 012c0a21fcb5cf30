"""What each projector pixel of one axis carries: bit planes, and the codebook that reads them back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

__all__ = ["MAX_BITS", "Codebook", "gray_planes", "make_codebook", "order_cell_px", "order_planes", "stripe_planes"]

MAX_BITS = 15
"""Longest code word: 32768 cells."""

Planes = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Codebook:
    """The cells of one projector axis: runs of pixels that carry the same code word.

    Parameters
    ----------
    bits : int
        Length of a word; the coarsest pattern is its most significant bit.
    first, last : ndarray of int32, shape (cell,)
        First and last projector pixel of each cell, ascending.
    word : ndarray of uint16, shape (cell,)
        What each cell carries.
    cell : ndarray of int32, shape (2 ** bits,)
        Cell of each word, -1 where no cell carries it.
    """

    bits: int
    first: npt.NDArray[np.int32]
    last: npt.NDArray[np.int32]
    word: npt.NDArray[np.uint16]
    cell: npt.NDArray[np.int32]

    @property
    def centre(self) -> npt.NDArray[np.float64]:
        """Middle of each cell, px (pixel centres are integers)."""
        return (self.first + self.last) / 2.0

    @property
    def width(self) -> npt.NDArray[np.int32]:
        """Projector pixels of each cell."""
        return self.last - self.first + 1


def gray_planes(length: int, bits: int, offset: Literal["none", "centred"]) -> Planes:
    """Reflected Gray code along an axis, coarsest bit first.

    With fewer bits than the axis needs the finest are dropped, so that a cell is 2, 4, ... pixels wide.

    Parameters
    ----------
    length : int
        Pixels of the axis.
    bits : int
    offset : {"none", "centred"}
        The first pixel carries the first word, or the middle of the code lies on the middle of the axis.

    Returns
    -------
    ndarray of bool, shape (bits, length)
        True is white.
    """
    needed = max(bits, (length - 1).bit_length())
    start = (2**needed - length) // 2 if offset == "centred" else 0
    number = np.arange(start, start + length) >> (needed - bits)
    return _unpack(number ^ (number >> 1), bits)


def order_cell_px(length: int, bits: int) -> int:
    """Width of an order cell of a phase set: half a period, the least that lets `bits` number the whole axis."""
    return -(-length // (1 << bits))


def order_planes(length: int, bits: int) -> Planes:
    """Gray code that numbers the half periods of a phase set, shape (bits, length)."""
    number = np.arange(length) // order_cell_px(length, bits)
    return _unpack(number ^ (number >> 1), bits)


def stripe_planes(length: int, counts: Sequence[int]) -> Planes:
    """Equal-width alternate stripes, black first: pixel x of a pattern of n stripes is ``floor(x n / length) mod 2``.

    Returns
    -------
    ndarray of bool, shape (len(counts), length)
    """
    x = np.arange(length, dtype=np.int64)
    return np.stack([(x * n // length) % 2 == 1 for n in counts])


def make_codebook(planes: Planes) -> Codebook:
    """Read the codebook off the bit planes and prove that no two cells carry the same word.

    Parameters
    ----------
    planes : ndarray of bool, shape (bits, length)
        Coarsest first.

    Raises
    ------
    ValueError
        If two separate runs of pixels carry the same word: the position could not be told.
    """
    bits, length = planes.shape
    weights = 1 << np.arange(bits - 1, -1, -1)
    words = (planes * weights[:, np.newaxis]).sum(axis=0)
    starts = np.flatnonzero(np.diff(words, prepend=-1))
    carried = words[starts]
    if len(np.unique(carried)) < len(carried):
        seen: dict[int, int] = {}
        for start, word in zip(starts.tolist(), carried.tolist(), strict=True):
            if word in seen:
                raise ValueError(
                    f"the patterns do not tell projector pixels {seen[word]} and {start} apart: "
                    f"both carry {word:0{bits}b}; add a pattern or change the stripe counts"
                )
            seen[word] = start
    cell = np.full(2**bits, -1, dtype=np.int32)
    cell[carried] = np.arange(len(carried), dtype=np.int32)
    return Codebook(
        bits=bits,
        first=starts.astype(np.int32),
        last=np.append(starts[1:] - 1, length - 1).astype(np.int32),
        word=carried.astype(np.uint16),
        cell=cell,
    )


def _unpack(words: npt.NDArray[np.int64], bits: int) -> Planes:
    return np.stack([(words >> (bits - 1 - bit)) & 1 == 1 for bit in range(bits)])
