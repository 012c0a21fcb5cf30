"""Along which lines of the image the edges of an axis are looked for, and what the kernels need to do so."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .cells import AxisCells, spread_of_contrast
from .edge_kernels import REACH, Pictures
from .frames import Frames
from .light import ROUNDING, frame_indices, frame_of

__all__ = ["Stack", "every", "line_pictures", "raster"]

NARROWEST_PX, WIDEST_PX = 1.25, 6.0
"""Stripes that are waves and no single edges, camera px: wider ones have room between their edges, whatever the blur;
of narrower ones a camera sees a pattern of its own."""

HalfSteps = npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float32]
Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def every(steps: HalfSteps) -> HalfSteps:
    """The raster of an image that says along which direction an axis grows, and how fast."""
    rows, columns = raster(steps.shape)
    return steps[::rows, ::columns]


def raster(shape: tuple[int, ...]) -> list[int]:
    """Steps of that raster along rows and columns."""
    return [max(1, side // 200) for side in shape]


def line_pictures(
    frames: Frames, stack: Stack, axis: int, cells: AxisCells, coarse: HalfSteps, count_noise: float, tilt: Floats
) -> tuple[bool, Pictures, int]:
    """What the kernels are given for one axis.

    Parameters
    ----------
    frames : Frames
    stack : ndarray, shape (frame, row, column)
        The frames' own, wherever the kernels read them.
    axis : int
    cells : AxisCells
    coarse : ndarray of uint16
        Half steps on a `raster`.
    count_noise : float
        Standard deviation of a pixel's value, counts.
    tilt : ndarray of float32, shape (MAX_BITS,)
        As of `Light`, or the level of the edges.

    Returns
    -------
    down : bool
        Whether the axis grows down the image.
    pictures : Pictures
    reach : int
        Camera px over which the bend of the map is taken.
    """
    patterns, shape = frames.patterns, frames.stack.shape[1:]
    _, plus, minus = frame_indices(patterns)
    none = cells.flips < 0
    centre = cells.centres()
    down, density = _growth(centre[coarse], raster(shape))
    scale = 256.0 ** (frames.stack.itemsize - 1)  # of contrast
    noise = max(count_noise, ROUNDING)
    unsure = spread_of_contrast(np.sqrt(2) * noise / scale)
    pictures = Pictures(
        stack=stack,
        white=frame_of(patterns, "white"),
        black=frame_of(patterns, "black"),
        plus=np.where(none, -1, plus[axis][cells.flips]).astype(np.int32),
        minus=np.where(none, -1, minus[axis][cells.flips]).astype(np.int32),
        tilt=tilt[cells.flips].astype(np.float32),
        wave=_waves(patterns.bits[axis] - cells.flips, float(np.diff(cells.edge).max()) / max(density, 1e-6)),
        edge=cells.edge,
        centre=centre,
        width=cells.widths(),
        unsure=np.square(unsure),
        noise=np.float32((noise / scale) ** 2 * (2 if patterns.complementary else 6)),
        scale=np.float32(1 / scale),
    )
    return down, pictures, max(0, min(round(1 / max(density, 1e-3)), REACH, (min(shape) - 1) // 2))


def _waves(doublings: npt.NDArray[np.int32], cell_px: float) -> Floats:
    """As of `Pictures`, of stripes that are 2 to the so manieth cells wide."""
    turn = np.pi / (cell_px * 2.0**doublings)
    wave = np.stack([1 / turn, np.tan(turn / 2)], axis=-1)
    wave[(turn < np.pi / WIDEST_PX) | (turn > np.pi / NARROWEST_PX)] = 0
    return wave.astype(np.float32)


def _growth(coarse: Floats, skip: list[int]) -> tuple[bool, float]:
    """Whether an axis grows faster down the image than along its rows, and by how many px per camera px."""
    growth = []
    for axis in (1, 0):
        change = np.abs(np.diff(coarse, axis=axis))
        change = change[np.isfinite(change)]
        if len(change):  # whole cells: a mean and no median, but without the edges of surfaces
            change = change[change <= np.quantile(change, 0.98)]
        growth.append(float(change.mean()) / skip[axis] if len(change) else 0.0)
    return growth[1] > growth[0], max(growth)
