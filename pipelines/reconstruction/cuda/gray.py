"""Gray code on the card: frames to half steps, a pixel a thread; tiles that fall back, a tile a thread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import cuda, uint64

from ..cells import AxisCells
from ..decode import LEAST_SWING, GrayPass, ends_of
from ..fallback import fall_back
from ..frames import Frames
from ..kernels import BLOCK, EVERY, GROUP, GROUPS, NO_CELL, TILE, half_step
from ..light import ROUNDING
from ..stray_light import refuse_strays
from .card import OnCard, clear, empty, kernel, launch, up

__all__ = ["Steps", "decode_gray"]


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """A Gray code decoded to whole cells on the card; as `Cells`, and the frames."""

    stack: OnCard  # (frame, row, column)
    steps: tuple[OnCard, OnCard]
    axes: tuple[AxisCells | None, AxisCells | None]
    levels: tuple[float, float]
    contrast: OnCard


def decode_gray(frames: Frames, stack: OnCard, noise: float) -> Steps:
    """Decode a capture whose stack is on the card, as `decode` does; `noise` is that of a pixel's value, counts."""
    rows, columns = frames.stack.shape[1:]
    given = GrayPass(frames, LEAST_SWING, max(noise, ROUNDING))
    steps = empty((rows, columns), np.uint16), empty((rows, columns), np.uint16)
    contrast = empty((rows, columns), np.uint8)
    coarse = _decode_all(given, stack, (0.0, 0.0), steps, contrast)
    levels = (0.0, 0.0)
    if not frames.patterns.complementary:
        levels = given.levels((steps[0].copy_to_host(), steps[1].copy_to_host()))
    if any(levels):
        coarse = _decode_all(given, stack, levels, steps, contrast)
    if coarse:  # surfaces are followed from pixel to pixel: no work for a card
        held = [each.copy_to_host() for each in steps]
        refuse_strays(*held)
        steps = up(held[0]), up(held[1])
    return Steps(stack, steps, given.axes, levels, contrast)


def _decode_all(
    given: GrayPass, stack: OnCard, levels: tuple[float, float], steps: tuple[OnCard, OnCard], contrast: OnCard
) -> int:
    """As `decode.decode_steps`."""
    rows, columns = contrast.shape
    size, depth = rows * columns, given.frames.stack.itemsize
    white, black, plus, minus, bits, share, limits = given.numbers
    halves = int(minus[0, 0] < 0 and minus[1, 0] < 0)
    ends = ends_of(levels)
    numbers = np.array([(axis.lowest, axis.highest) if axis else (0, 0) for axis in given.axes])
    doubts = empty(size, np.uint8)
    plain, inverse, groups = _in_groups(white, black, plus, minus, bits)
    launch(
        _decode, size, stack.reshape(len(given.stack), size), white, black, up(plain), up(inverse), up(groups),
        int(share[0] >> halves), up(ends), limits[0] >> halves, limits[1], 8 * (depth - 1), up(numbers),
        steps[0].reshape(size), steps[1].reshape(size), contrast.reshape(size), doubts,
    )  # fmt: skip
    changed = clear(1, np.int32)
    for n in range(2):
        if bits[n] > 1:
            launch(
                _fall_back, rows // TILE * (columns // TILE) + columns // TILE, stack, white, black, up(plus[n]),
                up(minus[n]), int(bits[n]), int(share[0]), int(ends[n]), limits, up(numbers[n]), n,
                doubts.reshape(rows, columns), steps[n], changed,
            )  # fmt: skip
    return int(changed.copy_to_host()[0])


def _in_groups(white: int, black: int, plus: Any, minus: Any, bits: Any) -> tuple[Any, Any, Any]:
    """Frames of each bit in whole groups: black against white stands for the bits that the coarsest lacks."""
    most = GROUP * GROUPS
    plain, inverse = np.full((2, most), black, np.int32), np.full((2, most), white, np.int32)
    groups = np.where(bits == 0, 0, np.where(bits <= 2 * GROUP, 2, GROUPS)).astype(np.int32)
    for axis in range(2):
        missing = GROUP * int(groups[axis]) - int(bits[axis])
        for bit in range(int(bits[axis])):
            plain[axis, missing + bit], inverse[axis, missing + bit] = plus[axis, bit], minus[axis, bit]
    return plain, inverse, groups


@kernel
def _decode(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack,
    white,
    black,
    plain,
    inverse,
    groups,
    share,
    ends,
    floor,
    least,
    shift,
    numbers,
    column,
    row,
    contrast,
    doubts,
):
    """As `kernels.decode_gray`; `doubts` has two bits per axis: certain of the coarse bits, and not of the finest."""
    top = (256 << shift) - 1
    for n in range(cuda.grid(1), contrast.size, cuda.gridsize(1)):
        w, b = np.int32(stack[white, n]), np.int32(stack[black, n])
        swing = max(w - b, 0)
        limit = max((swing * share) >> 8, floor) if swing >= least else top
        contrast[n] = np.uint8(swing >> shift)
        flags = 0
        for axis in range(2):
            middle = b + ((ends[axis] * swing) >> 8)
            word, doubt = 0, 0
            for bit in range(GROUP * groups[axis]):
                p, q = np.int32(stack[plain[axis, bit], n]), middle
                if inverse[axis, bit] >= 0:
                    q = np.int32(stack[inverse[axis, bit], n])
                word = 2 * word + (1 if p > q else 0)
                doubt = 2 * doubt + (1 if limit > abs(p - q) else 0)
            step = np.uint16(NO_CELL)
            if groups[axis] > 0:
                low, high = numbers[axis, 0], numbers[axis, 1]
                step = half_step(np.uint16(word), np.uint16(doubt), np.uint16(low), np.uint16(high - low))
                if (doubt >> GROUP) & (2**GROUP - 1) == 0:
                    flags |= (1 + 2 * (doubt & 1)) << (2 * axis)
            if axis == 0:
                column[n] = step
            else:
                row[n] = step
        doubts[n] = np.uint8(flags)


@kernel
def _fall_back(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack, white, black, plus, minus, bits, share, end, limits, numbers, axis, doubts, steps, changed
):
    """`fallback.fall_back` of one tile; the rows that are counted are those that the CPU counts."""
    rows, columns = steps.shape
    across = columns // TILE
    down = (rows + TILE - 1) // TILE
    for tile in range(cuda.grid(1), down * across, cuda.gridsize(1)):
        top, left = tile // across * TILE, tile % across * TILE
        bottom, right = min(top + TILE, rows), left + TILE
        words = cuda.local.array((1, 2), uint64)
        for half in range(2):
            word = uint64(0)
            for k in range(8):
                sure, weak = 0, 0
                for i in range(top, bottom, EVERY):
                    if i * columns // BLOCK == ((i + 1) * columns - 1) // BLOCK:
                        flags = (doubts[i, left + 8 * half + k] >> (2 * axis)) & 3
                        sure += flags & 1
                        weak += flags >> 1
                word |= uint64(sure + 16 * weak) << uint64(8 * k)
            words[0, half] = word
        if tile % across == across - 1:
            right = columns
        found = fall_back(
            stack[:, top:bottom, left:right], white, black, plus, minus, bits, share, end, limits, numbers, words,
            steps[top:bottom, left:right],
        )  # fmt: skip
        if found > 0:
            cuda.atomic.add(changed, 0, np.int32(found))
