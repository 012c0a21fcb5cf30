"""Are the frames in the order that the pattern set says? The frames themselves tell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from math import sqrt

import numpy as np
import numpy.typing as npt

from .decode import decode
from .frames import Frames
from .patterns import PatternSet

__all__ = ["suggest_order"]

Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

ROWS = 32
"""Image rows that are looked at."""
GOOD = 0.97
"""An order that decodes this share of the lit pixels is right without comparing it."""
BETTER = 0.05
"""Another order must decode so much more of the lit pixels, as a share of them."""
JUMP = 0.02
"""Neighbours along a row that differ by more than this share of the projector do not lie on one surface."""


def suggest_order(frames: Frames) -> str:
    """Say which order of frames fits, if it is not that of the pattern set.

    The right order decodes to positions on the projector that vary smoothly along the image's rows; with a wrong one
    most pixels are unlit, in doubt or scattered. Columns and rows that are swapped show only where the words of one
    axis lie outside the other: not on a square projector, nor if only its upper left part is seen.

    Parameters
    ----------
    frames : Frames

    Returns
    -------
    str
        One line that names the order that fits; empty if none fits better than that of the pattern set.
    """
    height = frames.stack.shape[1]
    rows = np.unique(np.linspace(0, height - 1, ROWS).astype(np.int64))
    stack: Stack = frames.stack[:, rows]
    noise = _noise(stack)
    span = (stack.max(axis=0) - stack.min(axis=0)).astype(np.float32)
    lit = span > max(0.1 * float(np.percentile(span, 99)), 12 * noise)
    if not lit.any():
        return ""
    own = _share(replace(frames, stack=stack), lit, noise)
    if own >= GOOD:
        return ""
    best, fits = own, frames.patterns
    for patterns in _candidates(frames.patterns):
        share = _share(Frames(stack, frames.time, patterns), lit, noise)
        if share > best:
            best, fits = share, patterns
    if best < own + BETTER:
        return ""
    return (
        f"the frames are not in the order {_name(frames.patterns)} of the pattern set: {_name(fits)} decodes "
        f"{100 * best:.0f} % of the lit pixels instead of {100 * own:.0f} %; correct the pattern file or the file names"
    )


def _share(frames: Frames, lit: npt.NDArray[np.bool_], noise: float) -> float:
    """Share of the lit pixels that decode next to a neighbour that decodes to nearly the same place."""
    decoded = decode(frames, noise=noise)
    good = lit[:, 1:].copy()
    for place, length, bits in zip(
        (decoded.column, decoded.row), frames.patterns.size, frames.patterns.bits, strict=True
    ):
        if bits:
            good &= np.abs(np.diff(place, axis=1)) <= max(2.0, JUMP * length)  # NaN is never good
    return float(good.sum() / max(1, lit[:, 1:].sum()))


def _candidates(patterns: PatternSet) -> Iterator[PatternSet]:
    for order in permutations(patterns.order):
        for msb_first in (True, False):
            if (order, msb_first) != (patterns.order, patterns.msb_first):
                yield replace(patterns, order=order, msb_first=msb_first)


def _name(patterns: PatternSet) -> str:
    return f"[{', '.join(patterns.order)}]{'' if patterns.msb_first else ' with msb_first: false'}"


def _noise(stack: Stack) -> float:
    """Scatter of the darkest frame along rows, counts: needs no order."""
    dark = stack[int(np.argmin(stack.mean(axis=(1, 2))))].astype(np.float32)
    second = dark[:, 2:] - 2 * dark[:, 1:-1] + dark[:, :-2]
    return float(1.4826 * np.median(np.abs(second)) / sqrt(6)) if second.size else 0.0
