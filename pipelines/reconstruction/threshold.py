"""Where the threshold of a pattern lies that has no inverse: measured at the capture's own edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .cells import AxisCells
from .frames import Frames
from .kernels import NO_CELL
from .light import Light, frame_indices, frame_of
from .patterns import AXES, Axis

__all__ = ["edge_level", "tilt_of"]

ROWS = 200
"""Rows of the image that are looked at, at most."""
FEW = 200
"""Pixels that a level is read from, at least."""


def edge_level(frames: Frames, axis: Axis, cells: AxisCells, steps: npt.NDArray[np.uint16]) -> float:
    """By how much twice the pattern exceeds white and black where its stripes end, as a share of white minus black.

    White looks wider than black through a projector whose gamma is above 1 and a lens that blurs, and half between
    white and black is not where a stripe ends. With inverses it does not matter: both are as high there. Without, the
    level is the median over the pixels of the two cells that meet at an edge, of all edges and bits. Half of them lie
    on the white side, however the cells themselves are misjudged: the two edges around are of opposite direction and
    displaced by as much, both outwards or both inwards.

    Parameters
    ----------
    frames : Frames
        Without inverses.
    axis : {"columns", "rows"}
    cells : AxisCells
    steps : ndarray of uint16, shape (row, column)
        Half step of each pixel, decoded by half of white and black.

    Returns
    -------
    float
        One level for all bits; 0 where it does not exceed two standard errors.
    """
    every = slice(None, None, max(1, len(steps) // ROWS))
    step = steps[every].astype(np.int64)
    known = step != NO_CELL
    half = (step & -step)[known]
    white, black = (frames.stack[frame_of(frames.patterns, what)][every][known] for what in ("white", "black"))
    both, light = white.astype(np.float32) + black, np.maximum(white.astype(np.float32) - black, 1)
    edges = [(step[known] + side * half) >> 1 for side in (-1, 1)]
    bits, plus, _ = frame_indices(frames.patterns)
    number = AXES.index(axis)
    swings, ends = [np.empty(0, np.float32)], 0
    for bit in range(bits[number]):
        meets = np.zeros(len(half), np.bool_)
        for edge in edges:
            meets |= cells.flips[edge, 0] == bit
        ends += len(np.unique(edges[1][meets]))
        seen = frames.stack[plus[number, bit]][every][known][meets].astype(np.float32)
        swings.append((2 * seen - both[meets]) / light[meets])
    swing = np.concatenate(swings)
    if len(swing) < FEW:
        return 0.0
    middle = float(np.median(swing))
    error = 1.2533 * float(swing.std()) / np.sqrt(ends)  # pixels along an edge tell the same
    return middle if abs(middle) > 2 * error else 0.0


def tilt_of(axis: int, levels: tuple[float, float], light: Light) -> npt.NDArray[np.float32]:
    """What pattern minus inverse is where stripes end, of white minus black, by bit: uneven light, or the level."""
    return np.asarray(light.tilt[axis] + np.float32(levels[axis]), np.float32)
