"""Compiled inner loops of decoding: one pass over the frames, a block of pixels at a time.

A stack is (frame, pixel). A block of pixels is decoded from the first frame to the last before the next block, so that
words, doubts and limits stay in cache and every byte of the stack is read from memory once. The loops compare and
shift without branches, five patterns and their inverses at a time, so that the compiler uses vector instructions
(`apart` says how it is brought to). Blocks are long because memory is: each new place in it starts slowly.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .apart import read, write

__all__ = ["NO_CELL", "TILE", "decode_gray", "half_step"]

BLOCK = 131072
GROUP = 5  # bits that are read at a time
GROUPS = 3  # words have at most 15
MOST_DOUBTS = 5
TILE = 16
"""Camera pixels along the side of a tile in which the finest stripes are resolved, or not."""
EVERY = 5  # rows of a tile in which doubts are counted
NO_CELL = 0
"""Half step of a pixel that was not decoded."""

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _light(w: U8, b: U8, relative: U16, floor: int, least: int, halves: int, contrast: U8, limit: U8) -> None:
    """White minus black, 8 bits, and the least swing of a certain bit: all that there is where a pixel is unlit."""
    narrow = limit.dtype.type  # numba widens to 64 bits, which costs the vectors their width
    wide = relative.dtype.type  # twice as wide as a pixel, and no wider
    share, lowest, lit, top = (
        wide(relative[0] >> halves),
        narrow(floor),
        narrow(least),
        narrow(2 ** (8 * w.itemsize) - 1),
    )
    for i in range(limit.size):
        swing = narrow(max(read(w, i), read(b, i)) - read(b, i))
        part = max(narrow(wide(wide(swing) * share) >> wide(8)), lowest)
        write(limit, i, part if swing >= lit else top)
    shift = narrow(8 * (w.itemsize - 1))
    for i in range(limit.size):
        swing = narrow(max(read(w, i), read(b, i)) - read(b, i))
        write(contrast, i, np.uint8(swing >> shift))


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _thresholds(w: U8, b: U8, ends: U16, axis: int, middle: U8) -> None:
    """The threshold where there are no inverses: so many 256ths of the way from black to white."""
    narrow, wide = middle.dtype.type, ends.dtype.type
    share = wide(ends[axis])
    for i in range(middle.size):
        swing = wide(max(read(w, i), read(b, i)) - read(b, i))
        write(middle, i, narrow(read(b, i) + narrow(wide(swing * share) >> wide(8))))


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _five(
    p0: U8, n0: U8, p1: U8, n1: U8, p2: U8, n2: U8, p3: U8, n3: U8, p4: U8, n4: U8, limit: U8, word: U8, doubt: U8
) -> None:
    """Five bits of a block, and which of them are in doubt."""
    narrow, byte = limit.dtype.type, np.uint8
    for i in range(word.size):
        least = read(limit, i)
        a0, b0, a1, b1, a2, b2 = read(p0, i), read(n0, i), read(p1, i), read(n1, i), read(p2, i), read(n2, i)
        a3, b3, a4, b4 = read(p3, i), read(n3, i), read(p4, i), read(n4, i)
        bits = byte(16) if a0 > b0 else byte(0)
        bits |= byte(8) if a1 > b1 else byte(0)
        bits |= byte(4) if a2 > b2 else byte(0)
        bits |= byte(2) if a3 > b3 else byte(0)
        bits |= byte(1) if a4 > b4 else byte(0)
        weak = byte(16) if least > narrow(max(a0, b0) - min(a0, b0)) else byte(0)
        weak |= byte(8) if least > narrow(max(a1, b1) - min(a1, b1)) else byte(0)
        weak |= byte(4) if least > narrow(max(a2, b2) - min(a2, b2)) else byte(0)
        weak |= byte(2) if least > narrow(max(a3, b3) - min(a3, b3)) else byte(0)
        weak |= byte(1) if least > narrow(max(a4, b4) - min(a4, b4)) else byte(0)
        write(word, i, bits)
        write(doubt, i, weak)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _words(
    stack: U8 | U16,
    first: int,
    last: int,
    white: int,
    black: int,
    plus: I64,
    minus: I64,
    bits: int,
    middle: U8,
    limit: U8,
    word: U8,
    doubt: U8,
) -> int:
    """Fill words and doubts of a block in groups of five bits, the finest last; gives how many groups there are.

    Black against white stands for the bits that the coarsest group lacks: a certain 0 where a pixel is lit.
    """
    groups = 2 if bits <= 2 * GROUP else GROUPS
    plain, inverse = np.empty(GROUP, np.int64), np.empty(GROUP, np.int64)
    for group in range(groups):
        for place in range(GROUP):
            bit = bits - GROUP * (groups - group) + place
            plain[place] = plus[bit] if bit >= 0 else black
            inverse[place] = minus[bit] if bit >= 0 else white
        n0 = stack[inverse[0], first:last] if inverse[0] >= 0 else middle
        n1 = stack[inverse[1], first:last] if inverse[1] >= 0 else middle
        n2 = stack[inverse[2], first:last] if inverse[2] >= 0 else middle
        n3 = stack[inverse[3], first:last] if inverse[3] >= 0 else middle
        n4 = stack[inverse[4], first:last] if inverse[4] >= 0 else middle
        _five(
            stack[plain[0], first:last],
            n0,
            stack[plain[1], first:last],
            n1,
            stack[plain[2], first:last],
            n2,
            stack[plain[3], first:last],
            n3,
            stack[plain[4], first:last],
            n4,
            limit,
            word[group, : last - first],
            doubt[group, : last - first],
        )
    return groups


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _half_steps(coarse: U8, fine: U8, unsure: U8, weak: U8, lowest: int, span: int, out: U16) -> None:
    """Words of a Gray code in two groups, and their doubts, to half steps."""
    five, low, wide = np.uint16(GROUP), np.uint16(lowest), np.uint16(span)
    for i in range(out.size):
        word = np.uint16(np.uint16(np.uint16(read(coarse, i)) << five) | np.uint16(read(fine, i)))
        doubt = np.uint16(np.uint16(np.uint16(read(unsure, i)) << five) | np.uint16(read(weak, i)))
        write(out, i, half_step(word, doubt, low, wide))


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _half_steps_long(word3: U8, doubt3: U8, size: int, lowest: int, span: int, out: U16) -> None:
    """As `_half_steps`, of three groups."""
    five, low, wide = np.uint16(GROUP), np.uint16(lowest), np.uint16(span)
    for i in range(size):
        word, doubt = np.uint16(0), np.uint16(0)
        for group in range(GROUPS):
            word = np.uint16(np.uint16(word << five) | np.uint16(word3[group, i]))
            doubt = np.uint16(np.uint16(doubt << five) | np.uint16(doubt3[group, i]))
        out[i] = half_step(word, doubt, low, wide)


@numba.njit(cache=True, nogil=True)
def half_step(word, doubt, low, wide):  # type: ignore[no-untyped-def]  # numba infers
    """Middle of a word's cell in half cells; `NO_CELL` outside the axis or in doubt. All are of 16 bits.

    At most one bit may be in doubt, and only where flipping it leads to the cell next door: the finest bit, or the
    one that flips at the other edge of the pair of cells that the finest does not tell apart.
    """
    word16 = np.uint16
    none, one, two, four, eight = word16(0), word16(1), word16(2), word16(4), word16(8)
    number = word16(word ^ word16(word >> one))
    number = word16(number ^ word16(number >> two))
    number = word16(number ^ word16(number >> four))
    number = word16(number ^ word16(number >> eight))
    pair = word16(word16(number + one) & word16(0xFFFE))
    other = word16(pair & word16(none - pair))  # its lowest bit
    good = (doubt == none) | (doubt == one) | (doubt == other)
    good &= word16(number - low) <= wide
    return word16(word16(number << one) | one) if good else none


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _count_doubts(coarse: U8, fine: U8, start: int, columns: int, suspects: U8) -> None:
    """Count, down the columns of tiles, pixels certain of the coarse bits (+ 1), and not of the finest (+ 16)."""
    none, one, four = np.uint8(0), np.uint8(1), np.uint8(4)
    row = (start + columns - 1) // columns
    while (row + 1) * columns - start <= fine.size:
        if row % TILE % EVERY == 0:
            first = row * columns - start
            line = suspects[row // TILE]
            whole, part = coarse[first : first + columns], fine[first : first + columns]
            for n in range(line.size):
                sure = one if whole[n] == none else none
                line[n] = np.uint8(line[n] + np.uint8(sure | np.uint8(np.uint8(part[n] & sure) << four)))
        row += 1


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def decode_gray(
    stack: U8 | U16,
    white: int,
    black: int,
    plus: I64,
    minus: I64,
    bits: I64,
    relative: U16,
    ends: U16,
    limits: tuple[int, int],
    numbers: I64,
    column: U16,
    row: U16,
    contrast: U8,
    suspects: U8,
) -> None:
    """Decode Gray code on both axes; `decode.decode` says what the numbers mean.

    Parameters
    ----------
    stack : ndarray, shape (frame, pixel)
    white, black : int
        Frames.
    plus, minus : ndarray, shape (2, bits)
        Frame of each bit and of its inverse (-1: none), coarsest first, for columns and rows.
    bits : ndarray, shape (2,)
    relative : ndarray of uint16 or uint32 (twice as wide as the stack), shape (1,)
        Least swing of a certain bit, in 1/256 of white minus black.
    ends : ndarray like `relative`, shape (2,)
        Where the stripes of each axis end, in 1/256 of the way from black to white; for patterns without inverses.
    limits : (int, int)
        Least swing of a certain bit, least white minus black, counts.
    numbers : ndarray, shape (2, 2)
        Lowest and highest number of a cell on each axis.
    column, row : ndarray of uint16, shape (row, column)
        Filled: the middle of the pixel's cell, in half cells from the beginning of the code; `NO_CELL` if none.
    contrast : ndarray of uint8, shape (pixel,)
        Filled: white minus black, 8 bits.
    suspects : ndarray of uint8, shape (2, tile, column)
        Zeros; filled by axis, 16 rows and column, from some of these rows: how many pixels are certain of the coarse
        bits, and 16 times how many of these are in doubt of the finest.
    """
    columns = column.shape[1]
    limit, middle = np.empty(BLOCK, stack.dtype), np.empty(BLOCK, stack.dtype)
    word, doubt = np.empty((GROUPS, BLOCK), np.uint8), np.empty((GROUPS, BLOCK), np.uint8)
    halves = 1 if minus[0, 0] < 0 and minus[1, 0] < 0 else 0
    for start in range(0, stack.shape[1], BLOCK):
        stop = min(start + BLOCK, stack.shape[1])
        size = stop - start
        w, b = stack[white, start:stop], stack[black, start:stop]
        _light(w, b, relative, limits[0] >> halves, limits[1], halves, contrast[start:stop], limit[:size])
        for axis in range(2):
            place = column.reshape(-1)[start:stop] if axis == 0 else row.reshape(-1)[start:stop]
            if bits[axis] == 0:
                place[:] = np.uint16(NO_CELL)
                continue
            if halves:
                _thresholds(w, b, ends, axis, middle[:size])
            groups = _words(
                stack,
                start,
                stop,
                white,
                black,
                plus[axis],
                minus[axis],
                bits[axis],
                middle[:size],
                limit[:size],
                word,
                doubt,
            )
            low, high = numbers[axis]
            _count_doubts(doubt[groups - 2, :size], doubt[groups - 1, :size], start, columns, suspects[axis])
            if groups == GROUPS:
                _half_steps_long(word, doubt, size, low, high - low, place)
            else:
                _half_steps(word[0, :size], word[1, :size], doubt[0, :size], doubt[1, :size], low, high - low, place)
