"""Frames to the projector position that each camera pixel sees."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from .codebook import MAX_BITS
from .frames import Frames
from .kernels import decode_words
from .patterns import AXES, PatternSet
from .pixel_maps import Decoded

__all__ = ["decode"]

SAMPLES = 20_000
"""Pixels that the noise of a capture is estimated from."""


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
    shape = frames.stack.shape[1:]
    stack = np.ascontiguousarray(frames.stack).reshape(len(frames.stack), -1)
    sd = max(noise_counts(frames) if noise is None else noise, 0.3)  # 0.3: rounding to whole counts
    bits, plus, minus = frame_indices(patterns)
    size = 2 ** int(bits.max())
    position = np.full((2, size), np.nan, dtype=np.float32)
    spread = np.full((2, size), np.nan, dtype=np.float32)
    forbidden = np.zeros((2, size), dtype=np.uint16)
    for number, axis in enumerate(AXES):
        if not bits[number]:
            continue
        book = patterns.codebook(axis)
        known = np.flatnonzero(book.cell >= 0)
        position[number, known] = book.centre[book.cell[known]]
        spread[number, known] = book.width[book.cell[known]]
        for bit in range(book.bits):
            across = book.cell[known ^ (1 << bit)]
            bad = np.abs(across - book.cell[known]) != 1
            forbidden[number, known[bad | (across < 0)]] |= np.uint16(1 << bit)
    pixels = stack.shape[1]
    out = np.empty((2, pixels), dtype=np.float32)
    sigma = np.empty((2, pixels), dtype=np.float32)
    level, texture, contrast = (np.empty(pixels, dtype=np.uint8) for _ in range(3))
    order = [(role.what, role.axis) for role in patterns.roles]
    decode_words(
        stack, order.index(("white", "")), order.index(("black", "")), plus, minus, bits, position, spread, forbidden,
        relative, 3 * np.sqrt(2) * sd, 6 * np.sqrt(2) * sd, np.sqrt(2) * sd, 8 * (stack.itemsize - 1),
        out, sigma, level, texture, contrast,
    )  # fmt: skip
    for number in range(2):
        if not bits[number]:
            out[number] = sigma[number] = np.nan
    good = np.ones(pixels, dtype=np.bool_)
    for number in range(2):
        if bits[number]:
            good &= np.isfinite(out[number])
    level[:] = np.where(good, 0, LEVEL_NONE)
    return Decoded(
        column=out[0].reshape(shape),
        row=out[1].reshape(shape),
        sigma_column=sigma[0].reshape(shape),
        sigma_row=sigma[1].reshape(shape),
        level=level.reshape(shape),
        texture=texture.reshape(shape),
        contrast=contrast.reshape(shape),
    )


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
    flat = frames.stack.reshape(len(frames.stack), -1)
    step = max(1, flat.shape[1] // SAMPLES)
    order = [(role.what, role.axis) for role in frames.patterns.roles]
    white = flat[order.index(("white", "")), ::step].astype(np.float64)
    black = flat[order.index(("black", "")), ::step].astype(np.float64)
    if not frames.patterns.complementary:
        dark = frames.stack[order.index(("black", ""))].astype(np.float64)
        second = dark[:, 2:] - 2 * dark[:, 1:-1] + dark[:, :-2]
        return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6))
    bits, plus, minus = frame_indices(frames.patterns)
    full = float(np.iinfo(frames.stack.dtype).max)
    scatter = []
    swing = white - black
    for axis in range(2):
        for bit in range(bits[axis]):
            both = flat[plus[axis, bit], ::step].astype(np.float64) + flat[minus[axis, bit], ::step]
            keep = white < full
            rest = (both - white - black)[keep]
            if rest.size < 16:
                continue
            slope = np.dot(rest - rest.mean(), swing[keep]) / max(
                np.dot(swing[keep], swing[keep] - swing[keep].mean()), 1
            )
            rest = rest - slope * swing[keep]
            scatter.append(1.4826 * np.median(np.abs(rest - np.median(rest))) / 2)
    return float(np.median(scatter)) if scatter else 0.0
