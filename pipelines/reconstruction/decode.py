"""Frames to the projector position that each camera pixel sees."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np
import numpy.typing as npt

from .codebook import MAX_BITS, Codebook
from .frames import Frames
from .kernels import decode_words
from .patterns import AXES, PatternSet
from .phase import decode_phase
from .pixel_maps import Decoded
from .stripes import decode_stripes
from .surface_light import show_light

__all__ = ["decode"]

RUNS, RUN = 16, 32
"""Noise is estimated from this many runs of this many neighbouring pixels (scattered single ones cost a cache miss)."""
ROUNDING = 0.29
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""


def decode(
    frames: Frames, *, relative: float = 0.1, noise: float | None = None, into: Decoded | None = None
) -> Decoded:
    """Decode a capture.

    A pixel is lit if white minus black exceeds six standard deviations of its noise. A bit is certain if pattern
    minus inverse (without inverses: twice the pattern minus white and black) exceeds `relative` of white minus
    black and three standard deviations of its noise. One bit may be uncertain where flipping it leads to the cell
    next door: that is the edge it lies on. Of stripes and phase sets places are found to sub-pixel at once
    (`stripes.decode_stripes`, `phase.decode_phase`).

    Parameters
    ----------
    frames : Frames
    relative : float
        Least swing of a certain bit of Gray code, of white minus black.
    noise : float, optional
        Standard deviation of a pixel's value, in the frames' own counts; estimated from the frames if absent.
    into : Decoded, optional
        An earlier result of `decode` whose arrays are used again, for video: fresh memory costs as much as decoding.
        What it held is lost.

    Returns
    -------
    Decoded

    Raises
    ------
    ValueError
        If `relative` or `noise` is out of range, or `into` has another shape.
    """
    if not 0 <= relative < 1:
        raise ValueError(f"relative is a share of white minus black from 0 to 1, not {relative}")
    if noise is not None and not noise >= 0:
        raise ValueError(f"noise is a standard deviation in counts, not {noise}")
    patterns = frames.patterns
    rows, columns = frames.stack.shape[1:]
    stack = np.ascontiguousarray(frames.stack).reshape(len(frames.stack), -1)
    sd = max(noise_counts(frames) if noise is None else noise, ROUNDING)
    top = 256**stack.itemsize - 1
    bits, plus, minus = frame_indices(patterns)
    books = [patterns.codebook(axis) if number else None for axis, number in zip(AXES, bits, strict=True)]
    if into is None:
        into = _room(rows, columns)
    elif into.column.shape != (rows, columns):
        raise ValueError(f"frames are {columns}x{rows}, `into` is {into.column.shape[1]}x{into.column.shape[0]}")
    if patterns.kind != "gray":
        show_light(frames, into)
        (decode_stripes if patterns.kind == "stripes" else decode_phase)(frames, sd, into)
        return into
    decode_words(
        stack,
        frame_of(patterns, "white"),
        frame_of(patterns, "black"),
        plus,
        minus,
        bits,
        np.array([round(256 * relative)], dtype=np.uint16 if stack.itemsize == 1 else np.uint32),
        (min(ceil(3 * sqrt(2) * sd), top), min(ceil(6 * sqrt(2) * sd), top)),
        np.array([_gray_cells(book) for book in books], np.float32),
        np.stack([_table(book, 2 ** int(bits.max())) for book in books]),
        sqrt(2) * sd,
        into.column.reshape(-1),
        into.row.reshape(-1),
        into.sigma_column.reshape(-1),
        into.sigma_row.reshape(-1),
        into.level.reshape(-1),
        into.texture.reshape(-1),
        into.contrast.reshape(-1),
    )
    return into


def _room(rows: int, columns: int) -> Decoded:
    column, row, sigma_column, sigma_row = (np.empty((rows, columns), np.float32) for _ in range(4))
    level, texture, contrast = (np.empty((rows, columns), np.uint8) for _ in range(3))
    return Decoded(column, row, sigma_column, sigma_row, level, texture, contrast)


def _gray_cells(book: Codebook | None) -> tuple[float, float, float, float]:
    """Cells of a Gray code: px per cell, centre of number 0, lowest and highest number; zeros if it is no such code."""
    if book is None:
        return 0, 0, 0, 0
    number = book.word.astype(np.int64)
    for shift in (1, 2, 4, 8):
        number ^= number >> shift
    width = int(book.width[0])
    if np.any(book.width != width) or np.any(np.diff(number) != 1):
        return 0, 0, 0, 0
    return width, float(book.centre[0]) - float(number[0]) * width, float(number[0]), float(number[-1])


def _table(book: Codebook | None, size: int) -> npt.NDArray[np.int32]:
    """Cell of each word, first and last px of each cell, shape (3, size)."""
    table = np.full((3, size), -1, dtype=np.int32)
    if book is not None:
        table[0, : len(book.cell)] = book.cell
        table[1, : len(book.first)] = book.first
        table[2, : len(book.last)] = book.last
    return table


def frame_of(patterns: PatternSet, what: str) -> int:
    """Index of the white or the black frame."""
    return next(number for number, role in enumerate(patterns.roles) if role.what == what)


def frame_indices(
    patterns: PatternSet,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Which frame shows which bit.

    Returns
    -------
    bits : ndarray, shape (2,)
        Bits along columns, rows.
    plus, minus : ndarray, shape (2, MAX_BITS)
        Frame of each bit, coarsest first, and of its inverse; -1 where there is none.
    """
    plus = np.full((2, MAX_BITS), -1, dtype=np.int64)
    minus = np.full((2, MAX_BITS), -1, dtype=np.int64)
    for frame, role in enumerate(patterns.roles):
        if role.what == "bit" and role.axis:
            (minus if role.inverted else plus)[AXES.index(role.axis), role.index] = frame
    return np.array(patterns.bits, dtype=np.int64), plus, minus


def noise_counts(frames: Frames) -> float:
    """Standard deviation of a pixel's value, counts, from the frames themselves.

    With inverses it is the scatter of pattern + inverse - white - black, which is 0 up to the flicker of the light
    (regressed out); without, that of the black frame's second differences along rows.

    Parameters
    ----------
    frames : Frames

    Returns
    -------
    float
    """
    white, black = frame_of(frames.patterns, "white"), frame_of(frames.patterns, "black")
    if not frames.patterns.complementary:
        dark = frames.stack[black, :: max(1, frames.stack.shape[1] // 64)].astype(np.float32)
        second = dark[:, 2:] - 2 * dark[:, 1:-1] + dark[:, :-2]
        if not second.size:
            return 0.0
        far = 4 * max(1.4826 * float(np.median(np.abs(second))), 1.0)
        return float(np.sqrt(np.mean(np.square(second[np.abs(second) <= far])) / 6))
    flat = frames.stack.reshape(len(frames.stack), -1)
    starts = np.linspace(0, max(0, flat.shape[1] - RUN), RUNS).astype(np.int64)
    sample = np.concatenate([flat[:, start : start + RUN] for start in starts], axis=1).astype(np.float32)
    sample = sample[:, sample[white] < np.iinfo(frames.stack.dtype).max]
    if sample.shape[1] < 16:
        return 0.0
    bits, plus, minus = frame_indices(frames.patterns)
    pairs = [(plus[axis, bit], minus[axis, bit]) for axis in range(2) for bit in range(bits[axis])]
    swing = sample[white] - sample[black]
    swing -= swing.mean()
    rest = np.stack([sample[p] + sample[n] for p, n in pairs]) - sample[white] - sample[black]
    sign = np.stack([sample[p] - sample[n] for p, n in pairs])
    # flicker of the light adds shares of white minus black and of pattern minus inverse
    for part in (rest, sign):
        part -= part.mean(axis=1, keepdims=True)
        part -= np.outer(part @ swing / max(float(swing @ swing), 1.0), swing)
    rest -= ((rest * sign).sum(axis=1) / np.maximum((sign * sign).sum(axis=1), 1.0))[:, np.newaxis] * sign
    # whole counts make a median coarse: it only says what is an outlier
    far = 4 * max(1.4826 * float(np.median(np.abs(rest))), 1.0)
    return float(np.sqrt(np.mean(np.square(rest[np.abs(rest) <= far]))) / 2)
