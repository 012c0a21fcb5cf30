"""Compiled inner loops of decoding: one pass over the frames, a block of pixels at a time.

A stack is (frame, pixel); a block of pixels of all frames fits the second-level cache and the block's words and
thresholds the first-level one, so that every byte of the stack is read from memory once. The loops compare and
shift without branches, which lets the compiler use vector instructions.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["decode_words"]

BLOCK = 4096
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


@numba.njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy")  # type: ignore[untyped-decorator]
def decode_words(
    stack: U8 | U16,
    white: int,
    black: int,
    plus: I64,
    minus: I64,
    bits: I64,
    position: F32,
    spread: F32,
    forbidden: U16,
    relative: float,
    floor: float,
    least: float,
    jitter: float,
    shift: int,
    out: F32,
    sigma: F32,
    level: U8,
    texture: U8,
    contrast: U8,
) -> None:
    """Decode the stripe patterns of both axes; see `decode.decode` for what the numbers mean."""
    pixels = stack.shape[1]
    word = np.empty((2, BLOCK), np.uint16)
    unsure = np.empty((2, BLOCK), np.uint16)
    limit = np.empty(BLOCK, stack.dtype)
    swing = np.empty(BLOCK, np.float32)
    for start in range(0, pixels, BLOCK):
        size = min(BLOCK, pixels - start)
        w = stack[white, start : start + size]
        b = stack[black, start : start + size]
        top = np.float32(2 ** (8 * stack.itemsize) - 1)
        for i in range(size):
            difference = np.float32(w[i]) - np.float32(b[i])
            swing[i] = difference
            limit[i] = min(max(np.float32(relative) * difference, np.float32(floor)), top)
            texture[start + i] = w[i] >> shift
            contrast[start + i] = np.uint8(max(difference, np.float32(0))) if shift == 0 else 0
            level[start + i] = 255
        if shift:
            for i in range(size):
                contrast[start + i] = np.uint8(max(swing[i], np.float32(0)) * np.float32(1 / 256))
        for axis in range(2):
            words = word[axis]
            doubts = unsure[axis]
            words[:size] = 0
            doubts[:size] = 0
            for bit in range(bits[axis]):
                p = stack[plus[axis, bit], start : start + size]
                if minus[axis, bit] >= 0:
                    n = stack[minus[axis, bit], start : start + size]
                    for i in range(size):
                        words[i] = (words[i] << 1) | np.uint16(p[i] > n[i])
                        doubts[i] = (doubts[i] << 1) | np.uint16(max(p[i], n[i]) - min(p[i], n[i]) < limit[i])
                else:
                    for i in range(size):
                        double = 2 * np.int32(p[i]) - np.int32(w[i]) - np.int32(b[i])
                        words[i] = (words[i] << 1) | np.uint16(double > 0)
                        doubts[i] = (doubts[i] << 1) | np.uint16(abs(double) < np.int32(limit[i]))
        for axis in range(2):
            if bits[axis] == 0:
                continue
            words = word[axis]
            doubts = unsure[axis]
            centres = position[axis]
            spreads = spread[axis]
            masks = forbidden[axis]
            for i in range(size):
                code = words[i]
                doubt = doubts[i]
                # at most one uncertain bit, and only where flipping it leads to the cell next door
                good = (doubt & (doubt - 1) == 0) & (doubt & masks[code] == 0) & (swing[i] >= np.float32(least))
                ratio = np.float32(jitter) / swing[i]
                out[axis, start + i] = centres[code] if good else np.float32(np.nan)
                sigma[axis, start + i] = (
                    spreads[code] * np.sqrt(np.float32(1 / 12) + ratio * ratio) if good else np.float32(np.nan)
                )
