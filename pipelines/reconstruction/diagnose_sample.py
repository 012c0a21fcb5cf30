"""What `diagnose` looks at: tiles of pixels from all over the frames, and how light, dark and noisy they are."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
import numpy.typing as npt

from .patterns import FrameRole, PatternSet

__all__ = ["Sample", "quantile", "take_sample"]

Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float32]

TILE = (24, 32)
TILES = 32
ROUNDING = 0.29
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""
LIT_SDS = 6 * sqrt(2)
"""`decode` calls a pixel lit if its swing exceeds so many standard deviations of its noise."""
DIM = 0.1
"""Swing of a lit pixel, as a share of the strongest: less belongs to shadow and background."""
CLIPPED_BINS = 5
DRAWN = 8  # different counts in all frames: no more, and a program drew them; a camera's noise and blur make others


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Tiles of a stack, and what can be said of them without knowing the order of the frames.

    Parameters
    ----------
    patterns : PatternSet
    tiles : ndarray of float32, shape (frame, tile, row, column)
        Counts.
    low, swing : ndarray of float32, shape (tile, row, column)
        Dark level of each pixel and its light less dark, counts: a low and a high order statistic over the frames, so
        that a few broken frames do not matter.
    lit : ndarray of bool, shape (tile, row, column)
        Swing above the noise and a tenth of the strongest, and never saturated.
    share : ndarray of float32, shape (frame, pixel)
        Of the lit pixels: 0 at the dark level, 1 at the light one.
    noise : float
        Standard deviation of a pixel's value, counts, as the dark frame scatters.
    top : float
        The count at which the camera clips.
    saturated : ndarray of float64, shape (frame,)
        Share of the pixels at `top` among those that are bright enough to measure.
    strong : float
        Swing of the strongest tenth of the pixels, counts.
    """

    patterns: PatternSet
    tiles: Floats
    low: Floats
    swing: Floats
    lit: npt.NDArray[np.bool_]
    share: Floats
    noise: float
    top: float
    saturated: npt.NDArray[np.float64]
    strong: float

    @property
    def roles(self) -> tuple[FrameRole, ...]:
        """What the pattern set says that each frame shows."""
        return self.patterns.roles


def take_sample(stack: Stack, patterns: PatternSet) -> Sample:
    """Cut tiles out of the frames.

    Parameters
    ----------
    stack : ndarray of uint8 or uint16, shape (frame, row, column)
        Of any number of frames.
    patterns : PatternSet

    Returns
    -------
    Sample
    """
    tiles = _tiles(stack)
    rank = len(tiles) // 8
    low, high = _ranked(tiles, rank)
    swing = high - low
    noise = max(_noise(tiles), ROUNDING)
    strong = quantile(swing, 0.9)
    top, clipped = _top(tiles, np.iinfo(stack.dtype).max)
    bright = swing > max(LIT_SDS * noise, DIM * strong)
    # a frame that clips is at the top; what is too bright in white has clipped in half of all frames
    saturated = (tiles[:, bright] >= top).mean(axis=1) if clipped and bright.any() else np.zeros(len(tiles))
    lit = bright & (high < top) if clipped else bright
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (tiles[:, lit] - low[lit]) / swing[lit]
    return Sample(patterns, tiles, low, swing, lit, share, noise, top, np.asarray(saturated, np.float64), strong)


def quantile(values: Floats, share: float = 0.5) -> float:
    """Give a quantile, by default the median, as numpy does but ten times as fast: sorting uses wide registers."""
    ordered = np.sort(values, axis=None)
    place = share * (ordered.size - 1)
    low, high = float(ordered[int(place)]), float(ordered[ceil(place)])
    return low + (high - low) * (place - int(place))


def _tiles(stack: Stack) -> Floats:
    count, rows, columns = stack.shape
    high, wide = min(TILE[0], rows), min(TILE[1], columns)
    across = max(1, min(columns // wide, round(sqrt(TILES * columns / rows))))
    down = max(1, min(rows // high, -(-TILES // across)))
    # staggered, so that a line along the image's rows or columns meets some tile wherever it lies
    tops, lefts = (rows - high) / down, (columns - wide) / across
    tiles = np.empty((count, down * across, high, wide), np.float32)
    for number, (i, j) in enumerate((i, j) for i in range(down) for j in range(across)):
        top = round((i + (j + 0.5) / across) * tops)
        left = round((j + (i + 0.5) / down) * lefts)
        tiles[:, number] = stack[:, top : top + high, left : left + wide]
    return tiles


def _ranked(tiles: Floats, rank: int) -> tuple[Floats, Floats]:
    """Give the `rank`-th lowest and highest value of each pixel over the frames."""
    last = len(tiles) - 1
    # sorting rows whole takes a tenth of the time of a partition: it uses the processor's wide registers
    ordered = np.sort(np.ascontiguousarray(tiles.reshape(len(tiles), -1).T), axis=1)
    shape = tiles.shape[1:]
    return ordered[:, rank].reshape(shape), ordered[:, last - rank].reshape(shape)


def _noise(tiles: Floats) -> float:
    """Scatter of the darkest frame along rows, counts: needs no order, and sees no pattern."""
    dark = tiles[int(np.argmin(tiles.mean(axis=(1, 2, 3))))]
    second = dark[:, :, 2:] - 2 * dark[:, :, 1:-1] + dark[:, :, :-2]
    if not second.size:
        return 0.0
    far = 4 * max(1.4826 * quantile(np.abs(second)), 1.0)  # whole counts make a median coarse
    return float(np.sqrt(np.mean(np.square(second[np.abs(second) <= far])) / 6))


def _top(tiles: Floats, greatest: int) -> tuple[float, bool]:
    """Give the highest count, and whether values pile up there: cameras clip at 255, at 235, at 4095 x 16."""
    top = float(tiles.max())
    if top == greatest:
        return top, True
    step = max(1.0, greatest / 255)
    counts, _ = np.histogram(tiles, bins=CLIPPED_BINS, range=(top - CLIPPED_BINS * step, top + 1e-3))
    at_top = int((tiles == top).sum())
    piled = at_top > 64 and at_top > 4 * counts[:-1].mean() and top > 0.5 * greatest
    return top, piled and len(np.unique(tiles[:, ::7])) > DRAWN
