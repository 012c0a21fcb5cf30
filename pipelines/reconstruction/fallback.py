"""Where the finest stripes are not resolved the next coarser ones are used: tile by tile, after the fast pass."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .kernels import NO_CELL, TILE

__all__ = ["DIRECT", "fall_back"]

MOST_LEVELS = 3
FEW = 8
DIRECT = 4
"""Of white minus black, one part in so many is the least swing of patterns coarser than the finest resolved."""
NIBBLES, ONES = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x0101010101010101)

Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
I64 = npt.NDArray[np.int64]


@numba.njit(cache=True, nogil=True)
def _swing(stack, black, plus, minus, light, end, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Pattern minus inverse of a pixel; without inverses twice what the pattern exceeds the ends of its stripes by."""
    p = np.int32(stack[plus, i, j])
    if minus >= 0:
        return p - np.int32(stack[minus, i, j])
    return 2 * (p - np.int32(stack[black, i, j]) - ((light * end) >> 8))


@numba.njit(cache=True, nogil=True)
def _light(stack, white, black, share, floor, i, j):  # type: ignore[no-untyped-def]  # numba infers
    """White minus black of a pixel, and the least swing of a certain bit."""
    light = max(np.int32(stack[white, i, j]) - np.int32(stack[black, i, j]), 0)
    return light, max((light * share) >> 8, floor)


@numba.njit(cache=True, nogil=True)
def _unresolved(stack, white, black, plus, minus, share, end, floor, least, rows, columns):  # type: ignore[no-untyped-def]  # numba infers
    """Whether more than half of the lit pixels of a tile are in doubt of a pattern."""
    lit, weak = 0, 0
    for i in range(rows[0], rows[1]):
        for j in range(columns[0], columns[1]):
            light, limit = _light(stack, white, black, share, floor, i, j)
            if light >= least:
                lit += 1
                weak += abs(_swing(stack, black, plus, minus, light, end, i, j)) < limit
    return lit >= FEW and 2 * weak > lit


@numba.njit(cache=True, nogil=True)
def _read(stack, white, black, plus, minus, bits, share, end, floor, least, i, j, low, high):  # type: ignore[no-untyped-def]  # numba infers
    """Number of a pixel's cell in a code of so many bits, -1 in doubt.

    The rule is that of the fast pass, and another one: blur that leaves a tenth of the finest pattern leaves half of
    the next one and more of the others, but where the pixel lies on their edge. Where they are weaker, light from
    elsewhere tells against them (Xu and Aliaga: what is direct must outweigh what is not).
    """
    light, limit = _light(stack, white, black, share, floor, i, j)
    if light < least:
        return -1
    word, doubt, mixed = 0, 0, 0
    for bit in range(bits):
        swing = _swing(stack, black, plus[bit], minus[bit], light, end, i, j)
        word = 2 * word + (swing > 0)
        doubt = 2 * doubt + (abs(swing) < limit)
        mixed = 2 * mixed + (DIRECT * abs(swing) < light)
    number = word
    for shift in (1, 2, 4, 8):
        number ^= number >> shift
    pair = (number + 1) & ~1
    edge = pair & -pair
    if doubt not in (0, 1, edge) or mixed & ~1 not in (0, edge) or not low <= number <= high:
        return -1
    return number


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def fall_back(
    stack: Stack,
    white: int,
    black: int,
    plus: I64,
    minus: I64,
    bits: int,
    share: int,
    end: int,
    limits: tuple[int, int],
    numbers: I64,
    suspects: npt.NDArray[np.uint64],
    steps: npt.NDArray[np.uint16],
) -> int:
    """Decode tiles of one axis to pairs of cells (fours, eights) where the finest stripes are not resolved.

    They are not where more than half of a tile's lit pixels are in doubt of them: where their contrast is below one
    and a half times the least swing of a certain bit. Such a tile's finest bits would be read off noise. Where three
    coarser levels are not resolved either, it is not blur that hides the stripes, and the tile is not measured.
    Tiles that are looked at closely and resolved after all are read once more, as strictly (`_read`).

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    white, black, share, end, limits
        As of `kernels.decode_gray`; `share` is its `relative` as a number, `end` that of this axis in `ends`.
    plus, minus : ndarray of int64, shape (bit,)
    bits : int
    numbers : ndarray, shape (2,)
        Lowest and highest number of a cell.
    suspects : ndarray of uint64, shape (tile, column / 8)
        As of `decode_gray`, eight columns a word: tiles where the fast pass was often in doubt are looked at closely.
    steps : ndarray of uint16, shape (row, column)
        Changed where a tile falls back.

    Returns
    -------
    int
        Tiles that fell back.
    """
    H, W = steps.shape
    floor, least = limits
    changed = 0
    tiles = suspects.shape[1] // (TILE // 8)
    for down in range(suspects.shape[0]):
        top, bottom = down * TILE, min((down + 1) * TILE, H)
        for tile in range(tiles):
            lit, weak = np.uint64(0), np.uint64(0)
            for word in range(TILE // 8):
                eight = suspects[down, tile * (TILE // 8) + word]
                lit += ((eight & NIBBLES) * ONES) >> np.uint64(56)  # sums of eight small numbers at once
                weak += (((eight >> np.uint64(4)) & NIBBLES) * ONES) >> np.uint64(56)
            # a little less than half, as not all rows were counted
            if 5 * np.int64(weak) <= 2 * np.int64(lit):
                continue
            rows, columns = (top, bottom), (tile * TILE, W if tile + 1 == tiles else (tile + 1) * TILE)
            level, most = 0, min(MOST_LEVELS, bits - 1)
            while level <= most:
                bit = bits - 1 - level
                if not _unresolved(stack, white, black, plus[bit], minus[bit], share, end, floor, least, rows, columns):
                    break
                level += 1
            changed += level > 0
            low, high = numbers[0] >> level, numbers[1] >> level
            for i in range(rows[0], rows[1]):
                for j in range(columns[0], columns[1]):
                    number = -1  # where no level is resolved nothing is measured
                    if level <= most:
                        number = _read(
                            stack, white, black, plus, minus, bits - level, share, end, floor, least, i, j, low, high
                        )
                    steps[i, j] = (2 * number + 1) << level if number >= 0 else NO_CELL
    return changed
