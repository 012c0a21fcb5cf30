"""Frames to the projector position that each camera pixel sees."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from .codebook import MAX_BITS, Codebook
from .frames import Frames
from .kernels import decode_words
from .patterns import AXES, PatternSet
from .pixel_maps import Decoded
from .refine_kernels import reject_loners, unwrap_phase

__all__ = ["decode"]

RUNS, RUN = 64, 64
"""Noise is estimated from this many runs of this many neighbouring pixels (scattered single ones cost a cache miss)."""
ROUNDING = 0.29
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""
AGREE_CELLS = 4
"""Neighbours along a row agree if they differ by at most so many of the widest cells."""


def decode(frames: Frames, *, relative: float = 0.1, noise: float | None = None) -> Decoded:
    """Decode a capture.

    A pixel is lit if white minus black exceeds six standard deviations of its noise. A bit is certain if pattern
    minus inverse (without inverses: twice the pattern minus white and black) exceeds `relative` of white minus
    black and three standard deviations of its noise. One bit may be uncertain where flipping it leads to the cell
    next door: that is the edge it lies on.

    Parameters
    ----------
    frames : Frames
    relative : float
        Least swing of a certain bit, of white minus black.
    noise : float, optional
        Standard deviation of a pixel's value, in the frames' own counts; estimated from the frames if absent.

    Returns
    -------
    Decoded

    Raises
    ------
    ValueError
        If `relative` or `noise` is out of range.
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
    place = np.empty((2, rows * columns), dtype=np.float32)
    sigma = np.empty_like(place)
    maps = np.empty((3, rows * columns), dtype=np.uint8)
    decode_words(
        stack,
        frame_of(patterns, "white"),
        frame_of(patterns, "black"),
        plus,
        minus,
        bits,
        (round(256 * relative), min(ceil(3 * sqrt(2) * sd), top), min(ceil(6 * sqrt(2) * sd), top)),
        np.array([_gray_cells(book, length) for book, length in zip(books, patterns.size, strict=True)], np.float32),
        np.stack([_table(book, 2 ** int(bits.max())) for book in books]),
        sqrt(2) * sd,
        place,
        sigma,
        maps,
    )
    level, texture, contrast = maps.reshape(3, rows, columns)
    place, sigma = place.reshape(2, rows, columns), sigma.reshape(2, rows, columns)
    if patterns.kind != "gray":
        for number, axis in enumerate(AXES):
            book = books[number]
            if book is None:
                continue
            if patterns.kind == "phase":
                steps = np.array(
                    [n for n, role in enumerate(patterns.roles) if (role.what, role.axis) == ("phase", axis)]
                )
                flat, flat_sigma = place[number].reshape(-1), sigma[number].reshape(-1)
                unwrap_phase(stack, steps, patterns.period_px(axis), patterns.size[number], sd, flat, flat_sigma)
            else:
                reject_loners(place[number], sigma[number], AGREE_CELLS * float(book.width.max()))
            level[np.isnan(place[number])] = LEVEL_NONE
    return Decoded(
        column=place[0],
        row=place[1],
        sigma_column=sigma[0],
        sigma_row=sigma[1],
        level=level,
        texture=texture,
        contrast=contrast,
    )


def _gray_cells(book: Codebook | None, length: int) -> tuple[float, float, float]:
    """Cells of a Gray code as px per cell, centre of word 0, length; 0 px per cell if these do not describe it."""
    if book is None:
        return 0, 0, 0
    number = book.word.astype(np.int64)
    for shift in (1, 2, 4, 8):
        number ^= number >> shift
    width = int(book.width[0])
    if np.any(book.width != width) or np.any(np.diff(number) != 1):
        return 0, 0, 0
    return width, float(book.centre[0]) - float(number[0]) * width, length


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
    (a share of white minus black, regressed out); without, that of the black frame's second differences along rows.

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
        return float(1.4826 * np.median(np.abs(second)) / sqrt(6)) if second.size else 0.0
    flat = frames.stack.reshape(len(frames.stack), -1)
    starts = np.linspace(0, max(0, flat.shape[1] - RUN), RUNS).astype(np.int64)
    sample = flat[:, np.unique((starts[:, np.newaxis] + np.arange(RUN)).clip(max=flat.shape[1] - 1))].astype(np.float32)
    sample = sample[:, sample[white] < np.iinfo(frames.stack.dtype).max]
    if sample.shape[1] < 16:
        return 0.0
    bits, plus, minus = frame_indices(frames.patterns)
    pairs = [(plus[axis, bit], minus[axis, bit]) for axis in range(2) for bit in range(bits[axis])]
    swing = sample[white] - sample[black]
    rest = np.stack([sample[p] + sample[n] for p, n in pairs]) - sample[white] - sample[black]
    swing -= swing.mean()
    rest -= np.outer(rest @ swing / max(float(swing @ swing), 1.0), swing)
    rest -= np.median(rest, axis=1, keepdims=True)
    return float(1.4826 * np.median(np.abs(rest)) / 2)
