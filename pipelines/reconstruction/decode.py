"""Frames to the projector position that each camera pixel sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from .cells import AxisCells, Cells, gray_cells
from .fallback import fall_back
from .frames import Frames
from .kernels import TILE, decode_gray
from .light import ROUNDING, frame_indices, frame_of, read_light
from .patterns import AXES, Axis, PatternSet
from .phase import decode_phase
from .pixel_maps import Decoded
from .stray_light import refuse_strays
from .stripes import decode_stripes
from .surface_light import show_light
from .threshold import edge_level

__all__ = ["LEAST_SWING", "SURE_BIT", "SURE_LIT", "GrayPass", "decode", "decode_steps", "ends_of"]

LEAST_SWING = 0.1
"""Least swing of a certain bit, of white minus black."""
SURE_BIT, SURE_LIT = 3, 6
"""Standard deviations of its noise that a certain bit, and white minus black of a lit pixel, must exceed."""
MOST_LEVEL = 0.9
"""Of white minus black by which stripes may end above or below the middle: beyond it the frames are clipped."""


def decode(
    frames: Frames, *, relative: float = LEAST_SWING, noise: float | None = None, into: Decoded | None = None
) -> Decoded:
    """Decode a capture.

    A pixel is lit if white minus black exceeds six standard deviations of its noise. A bit is certain if pattern
    minus inverse exceeds `relative` of white minus black and three standard deviations of its noise. Without inverses
    stripes need not end half between white and black: where they do is measured, and the frames are then decoded by
    that (`threshold.edge_level`). One bit may be uncertain where flipping it leads to the cell next door: that is the
    edge it lies on. Where the finest stripes of a Gray code are not resolved, in tiles of 16 pixels of which more than
    half are not certain of them, the next coarser ones are used, and `level` says so. There the coarser patterns must
    be strong (light from elsewhere weakens them, a lens does not), and surfaces that jump wherever they meet finer
    cells are refused (`stray_light.refuse_strays`: shadow that is lit by a wall).
    Of stripes and phase sets places are found to sub-pixel at once (`stripes.decode_stripes`, `phase.decode_phase`).

    Parameters
    ----------
    frames : Frames
    relative : float
        Least swing of a certain bit, of white minus black.
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
    if into is not None and into.texture.shape != (rows, columns):
        raise ValueError(f"frames are {columns}x{rows}, `into` is {into.texture.shape[1]}x{into.texture.shape[0]}")
    sd = max(read_light(frames).noise if noise is None else noise, ROUNDING)
    if patterns.kind != "gray":
        into = _room(rows, columns) if into is None or isinstance(into, Cells) else into
        show_light(frames, into)
        (decode_stripes if patterns.kind == "stripes" else decode_phase)(frames, sd, into)
        return into
    return _cells(GrayPass(frames, relative, sd), rows, columns, into if isinstance(into, Cells) else None)


@dataclass(frozen=True, slots=True)
class GrayPass:
    """What a pass over the frames of a Gray code is given.

    Parameters
    ----------
    frames : Frames
    relative : float
        Least swing of a certain bit, of white minus black.
    sd : float
        Noise of a pixel, counts.
    least : float
        White minus black that a lit pixel must have, whatever its noise.
    direct : float, optional
        Least swing at first sight, if more than `relative`: tiles that fail it are read by `relative`, where in turn
        coarser patterns must be strong.
    """

    frames: Frames
    relative: float
    sd: float
    least: float = 0.0
    direct: float | None = None

    @property
    def stack(self) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
        """The frames as (frame, pixel)."""
        return self.frames.stack.reshape(len(self.frames.stack), -1)

    @property
    def numbers(self) -> tuple[Any, ...]:
        """White, black, plus, minus, bits, relative and limits, as the kernels take them."""
        patterns = self.frames.patterns
        bits, plus, minus = frame_indices(patterns)
        swing = sqrt(2 if patterns.complementary else 6) * self.sd
        limits = SURE_BIT * swing, max(SURE_LIT * sqrt(2) * self.sd, self.least)
        most = 256**self.frames.stack.itemsize - 1
        white, black = frame_of(patterns, "white"), frame_of(patterns, "black")
        share = self.share(self.relative)
        return white, black, plus, minus, bits, share, tuple(min(ceil(limit), most) for limit in limits)

    def share(self, of: float) -> npt.NDArray[Any]:
        """A share of white minus black in 256ths, twice as wide as a pixel."""
        return np.array([round(256 * of)], dtype=np.uint32 if self.frames.stack.itemsize == 2 else np.uint16)

    @property
    def axes(self) -> tuple[AxisCells | None, AxisCells | None]:
        """Cells of both axes; None where one was not projected."""
        column, row = (_axis_cells(self.frames.patterns, axis) for axis in AXES)
        return column, row

    @property
    def noise(self) -> float:
        """Standard deviation of a pixel's value, counts of 8 bits."""
        return self.sd if self.frames.stack.itemsize == 1 else self.sd / 256

    def levels(self, steps: tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16]]) -> tuple[float, float]:
        """Where the stripes end, seen in what was decoded by half of white and black (`threshold.edge_level`)."""
        if self.frames.patterns.complementary:
            return 0.0, 0.0
        column, row = (
            edge_level(self.frames, axis, cells, step) if cells else 0.0
            for axis, cells, step in zip(AXES, self.axes, steps, strict=True)
        )
        return column, row

    def texture(self, rows: int, columns: int) -> npt.NDArray[np.uint8]:
        """Give the white frame in 8 bits: itself, if it has no more."""
        white = self.stack[frame_of(self.frames.patterns, "white")].reshape(rows, columns)
        return np.asarray(white if white.itemsize == 1 else white >> 8, np.uint8)


def ends_of(levels: tuple[float, float]) -> npt.NDArray[np.int64]:
    """Where stripes end, as the kernels take it: 256ths of the way from black to white."""
    return np.asarray(np.rint(128 * (1 + np.clip(levels, -MOST_LEVEL, MOST_LEVEL))), np.int64)


def _cells(given: GrayPass, rows: int, columns: int, into: Cells | None) -> Cells:
    """Decode Gray code; once more where its stripes turn out not to end half between white and black."""
    steps = into.steps if into else (np.empty((rows, columns), np.uint16), np.empty((rows, columns), np.uint16))
    contrast = into.contrast if into else np.empty((rows, columns), np.uint8)
    coarse = decode_steps(given, (0.0, 0.0), steps, contrast)
    levels = given.levels(steps)
    if any(levels):
        coarse = decode_steps(given, levels, steps, contrast)
    if coarse:
        refuse_strays(*steps)
    return Cells(steps, given.axes, levels, given.noise, given.texture(rows, columns), contrast)


def decode_steps(
    given: GrayPass,
    levels: tuple[float, float],
    steps: tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16]],
    contrast: npt.NDArray[np.uint8],
) -> int:
    """Fill steps and contrast; gives how many tiles fell back to coarser stripes."""
    rows, columns = contrast.shape
    numbers = np.array([(axis.lowest, axis.highest) if axis else (0, 0) for axis in given.axes])
    suspects = np.zeros((2, -(-rows // TILE), columns // TILE * TILE), np.uint8)
    white, black, plus, minus, bits, share, limits = given.numbers
    ends = ends_of(levels)
    decode_gray(
        given.stack, white, black, plus, minus, bits, given.share(given.direct or given.relative),
        ends.astype(share.dtype), limits, numbers, *steps,
        contrast.reshape(-1), suspects,
    )  # fmt: skip
    stack = given.stack.reshape(-1, rows, columns)
    coarse = 0
    for n, step in enumerate(steps):
        if bits[n] > 1:
            coarse += fall_back(
                stack, white, black, plus[n], minus[n], int(bits[n]), int(share[0]), int(ends[n]), limits, numbers[n],
                suspects[n].view(np.uint64), step,
            )  # fmt: skip
    return coarse


@lru_cache(maxsize=64)
def _axis_cells(patterns: PatternSet, axis: Axis) -> AxisCells | None:
    return gray_cells(patterns.codebook(axis)) if patterns.bits[AXES.index(axis)] else None


def _room(rows: int, columns: int) -> Decoded:
    column, row, sigma_column, sigma_row = (np.empty((rows, columns), np.float32) for _ in range(4))
    level, texture, contrast = (np.empty((rows, columns), np.uint8) for _ in range(3))
    return Decoded(column, row, sigma_column, sigma_row, level, texture, contrast)
