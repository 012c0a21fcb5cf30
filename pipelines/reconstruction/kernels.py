"""Compiled inner loops of decoding: one pass over the frames, a block of pixels at a time.

A stack is (frame, pixel). A block of pixels is decoded from the first frame to the last before the next block, so that
words, doubts and limits stay in cache and every byte of the stack is read from memory once. The loops compare and
shift without branches and read few arrays each: then the compiler can prove that they do not overlap what is
written, and uses vector instructions.
"""

from __future__ import annotations

from math import sqrt

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["decode_words"]

BLOCK = 16384
GROUPS = 5  # of three bits: words have at most 15
NOT_MEASURED = 255
MOST_DOUBTS = 5
NO_WORD = 0xFFFF

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _three(p0: U8, n0: U8, p1: U8, n1: U8, p2: U8, n2: U8, limit: U8, code: U8) -> None:
    """Three bits of a block: word in bits 0-2 of `code`, doubts in bits 4-6."""
    narrow = limit.dtype.type  # numba widens to 64 bits, which costs the vectors their width
    for i in range(code.size):
        a0, b0, a1, b1, a2, b2 = p0[i], n0[i], p1[i], n1[i], p2[i], n2[i]
        least = limit[i]
        one = np.uint8(4) if a0 > b0 else np.uint8(0)
        two = np.uint8(2) if a1 > b1 else np.uint8(0)
        four = np.uint8(1) if a2 > b2 else np.uint8(0)
        eight = np.uint8(64) if least > narrow(max(a0, b0) - min(a0, b0)) else np.uint8(0)
        nine = np.uint8(32) if least > narrow(max(a1, b1) - min(a1, b1)) else np.uint8(0)
        ten = np.uint8(16) if least > narrow(max(a2, b2) - min(a2, b2)) else np.uint8(0)
        code[i] = one | two | four | eight | nine | ten


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _one(p: U8, n: U8, limit: U8, code: U8) -> None:
    """One bit of a block: word in bit 0 of `code`, doubt in bit 4."""
    narrow = limit.dtype.type
    for i in range(code.size):
        a, b = p[i], n[i]
        word = np.uint8(1) if a > b else np.uint8(0)
        doubt = np.uint8(16) if limit[i] > narrow(max(a, b) - min(a, b)) else np.uint8(0)
        code[i] = word | doubt


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _join(coarse: U8, fine: U8) -> None:
    """Two codes of one bit to one of two bits, in `fine`."""
    for i in range(fine.size):
        fine[i] = np.uint8(coarse[i] + coarse[i]) | fine[i]


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _light(w: U8, b: U8, swing: U8, middle: U8, limit: U8, relative: U16, floor: int, halves: int) -> None:
    """White minus black (0 where black is brighter), their mean, and the least swing of a certain bit."""
    narrow = swing.dtype.type
    wide = relative.dtype.type  # twice as wide as a pixel, and no wider
    share = wide(relative[0] >> halves)
    lowest = narrow(floor)
    for i in range(swing.size):
        swing[i] = narrow(max(w[i], b[i]) - b[i])
    if halves:
        for i in range(swing.size):
            middle[i] = wide(wide(w[i]) + wide(b[i])) >> wide(1)
    for i in range(swing.size):
        part = narrow(wide(wide(swing[i]) * share) >> wide(8))
        limit[i] = max(part, lowest)


@numba.njit(cache=True, nogil=True, inline="never", error_model="numpy", fastmath=True)  # type: ignore[untyped-decorator]
def _spread(swing: U8, jitter: float, spread: F32) -> None:
    """Standard uncertainty in cells, sqrt(1/12 + (jitter / swing)^2): uniform in a cell, and the noise of its edges.

    The root is its series to the third power, right to 5e-4 where the swing of a lit pixel is at least 6 jitters.
    """
    noise = np.float32(jitter * sqrt(12.0))
    one, half, eighth, sixteenth = np.float32(1), np.float32(0.5), np.float32(0.125), np.float32(0.0625)
    uniform = np.float32(1 / sqrt(12.0))
    for i in range(swing.size):
        ratio = noise / np.float32(swing[i])
        u = ratio * ratio
        spread[i] = uniform * (one + u * (half - u * (eighth - u * sixteenth)))


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _number_gray(
    c0: U8, c1: U8, c2: U8, c3: U8, c4: U8, swing: U8, least: int, lowest: int, highest: int, numbers: U16
) -> None:
    """Codes of all groups to numbers of cells; `NO_WORD` where unlit, outside the axis or in doubt.

    At most one bit may be in doubt, and only where flipping it leads to the cell next door: the bits below it
    are then 1 and all 0.
    """
    lit, low, high = swing.dtype.type(least), np.uint16(lowest), np.uint16(highest)
    none, one, two, four, eight = np.uint16(0), np.uint16(1), np.uint16(2), np.uint16(4), np.uint16(8)
    is_word, is_doubt = np.uint16(7), np.uint16(0x70)
    for i in range(numbers.size):
        g0, g1, g2, g3, g4 = np.uint16(c0[i]), np.uint16(c1[i]), np.uint16(c2[i]), np.uint16(c3[i]), np.uint16(c4[i])
        word = np.uint16((g0 & is_word) * np.uint16(4096)) | np.uint16((g1 & is_word) * np.uint16(512))
        word = np.uint16(word | np.uint16((g2 & is_word) * np.uint16(64)))
        word = np.uint16(word | np.uint16((g3 & is_word) * eight))
        word = np.uint16(word | np.uint16(g4 & is_word))
        doubt = np.uint16((g0 & is_doubt) * np.uint16(256)) | np.uint16((g1 & is_doubt) * np.uint16(32))
        doubt = np.uint16(doubt | np.uint16((g2 & is_doubt) * four))
        doubt = np.uint16(doubt | np.uint16(np.uint16(g3 & is_doubt) >> one))
        doubt = np.uint16(doubt | np.uint16(np.uint16(g4 & is_doubt) >> four))
        below = np.uint16(doubt - one)
        # without a doubt `below` is all ones, and the second test would ask for a word of zeros
        rest = np.uint16(np.uint16(word & below) ^ np.uint16(doubt >> one)) if doubt != none else none
        fault = np.uint16(np.uint16(doubt & below) | rest)
        number = np.uint16(word ^ np.uint16(word >> one))
        number = np.uint16(number ^ np.uint16(number >> two))
        number = np.uint16(number ^ np.uint16(number >> four))
        number = np.uint16(number ^ np.uint16(number >> eight))
        good = (fault == none) & (swing[i] >= lit) & (number >= low) & (number <= high)
        numbers[i] = number if good else np.uint16(NO_WORD)


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _place(numbers: U16, scale: float, origin: float, out: F32, level: U8) -> None:
    """Numbers of cells to their centres; where there is none NaN, and `level` says so."""
    nan = np.float32(np.nan)
    step, first = np.float32(scale), np.float32(origin)
    for i in range(out.size):
        number = numbers[i]
        out[i] = np.float32(number) * step + first if number != np.uint16(NO_WORD) else nan
    for i in range(out.size):
        level[i] = level[i] if numbers[i] != np.uint16(NO_WORD) else np.uint8(NOT_MEASURED)


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _uncertainty(place: F32, spread: F32, width: float, sigma: F32) -> None:
    cell, none = np.float32(width), np.float32(0)
    for i in range(sigma.size):
        sigma[i] = cell * spread[i] + none * place[i]  # NaN where the place is


@numba.njit(cache=True, nogil=True, inline="never")  # type: ignore[untyped-decorator]
def _place_table(
    codes: U8, swing: U8, least: int, cell: I32, first: I32, last: I32, spread: F32, out: F32, sigma: F32
) -> None:
    """Words of any code to projector pixels by its codebook, NaN where unlit or ambiguous.

    The cells that agree with every certain bit must be one, or two next to each other: then the pixel lies on
    their edge, or in that of the two whose word it reads.
    """
    for i in range(out.size):
        out[i] = np.nan
        sigma[i] = np.nan
        if swing[i] < least:
            continue
        word, doubt = np.int64(0), np.int64(0)
        for group in range(GROUPS):
            word = (word << 3) | np.int64(codes[group, i] & 7)
            doubt = (doubt << 3) | np.int64(codes[group, i] >> 4)
        own = cell[word]
        low, high = own, own
        if doubt:
            count = 0
            rest = doubt
            while rest:
                rest &= rest - 1
                count += 1
            if count > MOST_DOUBTS:
                continue
            flip = doubt
            while flip:  # every way to read the uncertain bits
                other = cell[word ^ flip]
                if other >= 0:
                    low = other if low < 0 else min(low, other)
                    high = max(high, other)
                flip = (flip - 1) & doubt
        if low < 0 or high - low > 1:
            continue
        if own >= 0:
            low = high = own
        out[i] = 0.25 * (first[low] + last[low] + first[high] + last[high])
        sigma[i] = spread[i] * 0.5 * (last[low] - first[low] + last[high] - first[high] + 2)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def decode_words(
    stack: U8 | U16,
    white: int,
    black: int,
    plus: I64,
    minus: I64,
    bits: I64,
    relative: U16,
    limits: tuple[int, int],
    cells: F32,
    table: I32,
    jitter: float,
    column: F32,
    row: F32,
    sigma_column: F32,
    sigma_row: F32,
    level_map: U8,
    texture_map: U8,
    contrast_map: U8,
) -> None:
    """Decode the stripe patterns of both axes; `decode.decode` says what the numbers mean.

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
    limits : (int, int)
        Least swing of a certain bit, least white minus black, counts.
    cells : ndarray of float32, shape (2, 4)
        Of each axis in Gray code: px per cell, centre of cell number 0, lowest and highest number; 0 px: use `table`.
    table : ndarray of int32, shape (2, 3, words)
        Of each axis: cell of each word (-1: none), first and last px of each cell.
    jitter : float
        Noise of pattern minus inverse, counts.
    column, row, sigma_column, sigma_row : ndarray of float32, shape (pixel,)
        Filled: projector px and their standard uncertainty.
    level_map, texture_map, contrast_map : ndarray of uint8, shape (pixel,)
        Filled.
    """
    pixels = stack.shape[1]
    swing = np.empty(BLOCK, stack.dtype)
    middle = np.empty(BLOCK, stack.dtype)
    limit = np.empty(BLOCK, stack.dtype)
    codes = np.empty((GROUPS, BLOCK), np.uint8)
    spread = np.empty(BLOCK, np.float32)
    spare = np.empty(BLOCK, np.uint8)
    numbers = np.empty(BLOCK, np.uint16)
    shift = 8 * (stack.itemsize - 1)
    halves = 1 if minus[0, 0] < 0 and minus[1, 0] < 0 else 0
    for start in range(0, pixels, BLOCK):
        stop = min(start + BLOCK, pixels)
        size = stop - start
        w, b = stack[white, start:stop], stack[black, start:stop]
        lit, mid, low = swing[:size], middle[:size], limit[:size]
        _light(w, b, lit, mid, low, relative, limits[0] >> halves, halves)
        _spread(lit, jitter, spread[:size])
        level, texture, contrast = level_map[start:stop], texture_map[start:stop], contrast_map[start:stop]
        for i in range(size):
            texture[i] = np.uint8(w[i] >> shift)
        for i in range(size):
            contrast[i] = np.uint8(lit[i] >> shift)
        level[:] = np.uint8(0)
        for axis in range(2):
            place = column[start:stop] if axis == 0 else row[start:stop]
            error = sigma_column[start:stop] if axis == 0 else sigma_row[start:stop]
            if bits[axis] == 0:
                place[:] = np.float32(np.nan)
                error[:] = np.float32(np.nan)
                continue
            group = GROUPS - (bits[axis] + 2) // 3  # the coarsest group takes what is not a multiple of three
            for empty in range(group):
                codes[empty, :size] = 0
            bit = 0
            odd = bits[axis] % 3
            while bit < odd:
                code = spare[:size] if bit == 0 and odd == 2 else codes[group, :size]
                n0 = mid if halves else stack[minus[axis, bit], start:stop]
                _one(stack[plus[axis, bit], start:stop], n0, low, code)
                bit += 1
            if odd == 2:
                _join(spare[:size], codes[group, :size])
            group += odd > 0
            while bit < bits[axis]:
                p0, p1, p2 = (
                    stack[plus[axis, bit], start:stop],
                    stack[plus[axis, bit + 1], start:stop],
                    stack[plus[axis, bit + 2], start:stop],
                )
                n0 = mid if halves else stack[minus[axis, bit], start:stop]
                n1 = mid if halves else stack[minus[axis, bit + 1], start:stop]
                n2 = mid if halves else stack[minus[axis, bit + 2], start:stop]
                _three(p0, n0, p1, n1, p2, n2, low, codes[group, :size])
                bit += 3
                group += 1
            wide, origin, lowest, highest = cells[axis]
            if wide > 0:
                c0, c1, c2, c3, c4 = codes[0, :size], codes[1, :size], codes[2, :size], codes[3, :size], codes[4, :size]
                number = numbers[:size]
                _number_gray(c0, c1, c2, c3, c4, lit, limits[1], lowest, highest, number)
                _place(number, wide, origin, place, level)
                _uncertainty(place, spread[:size], wide, error)
            else:
                cell, first, last = table[axis]
                _place_table(codes[:, :size], lit, limits[1], cell, first, last, spread[:size], place, error)
                for i in range(size):
                    level[i] = level[i] if place[i] == place[i] else np.uint8(NOT_MEASURED)
