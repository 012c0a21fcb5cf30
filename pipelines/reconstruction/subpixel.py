"""Sub-pixel positions: pattern minus inverse crosses zero at the edges of a cell; between them it is linear."""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt

from .cells import AxisCells, Cells, spread_of_contrast
from .decode import decode
from .edge_kernels import REACH, Pictures, along_columns, along_rows
from .frames import Frames
from .light import ROUNDING, Light, frame_indices, frame_of, read_light
from .patterns import AXES
from .pixel_maps import Decoded
from .slabs import in_slabs
from .threshold import edge_levels

__all__ = ["every", "line_pictures", "locate", "raster", "refine"]

# What the frames' noise does not explain, projector px: flicker of the light leaves FLAT_PX, and a straight line
# through an edge that is not straight BENT_PX times the square of projector px per camera px (cells that the camera
# hardly resolves; of the whole capture: the local one is measured between the very edges that may be misplaced).
# Read off a rendered capture with known answers.
FLAT_PX, BENT_PX = 0.02, 0.12
RUNS = 24  # of 64 pixels, which the light is read from

HalfSteps = npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float32]
Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def locate(frames: Frames) -> Decoded:
    """Decode a capture and place each pixel within its cell: `decode`, then `refine`."""
    return refine(frames, decode(frames))


def refine(frames: Frames, decoded: Decoded) -> Decoded:
    """Place each decoded pixel within its cell.

    Along the image direction in which an axis grows faster, the two edges of the pixel's cell are where the bit that
    flips there crosses zero, to a fraction of a camera pixel; between them the position is linear. Pixels without an
    edge on both sides keep the middle of their cell and its sigma. Stripes and phase sets are placed by `decode`
    already and left alone.

    White stripes look wider than black ones through gamma and blur. Pattern minus inverse does not know it: at the end
    of a stripe both are as bright, whatever the curve. Without inverses the level of the edges is measured
    (`threshold.edge_levels`).

    Parameters
    ----------
    frames : Frames
    decoded : Decoded
        Of these frames.

    Returns
    -------
    Decoded
        With arrays of its own: the frames need not be kept.
    """
    if not isinstance(decoded, Cells):
        return decoded
    light = read_light(frames, RUNS)
    found: list[tuple[Floats, Floats]] = []
    for number, cells in enumerate(decoded.axes):
        place, sigma = (np.empty(frames.stack.shape[1:], np.float32) for _ in range(2))
        if cells is None:
            place[:] = sigma[:] = np.nan
        else:
            _between_edges(frames, number, cells, decoded, light, place, sigma)
        found.append((place, sigma))
    (column, sigma_column), (row, sigma_row) = found
    return Decoded(
        column, row, sigma_column, sigma_row, decoded.level.copy(), decoded.texture.copy(), decoded.contrast.copy()
    )


def _between_edges(
    frames: Frames,
    axis: int,
    cells: AxisCells,
    decoded: Cells,
    light: Light,
    place: Floats,
    sigma: Floats,
) -> None:
    """Fill the positions and sigmas of one axis."""
    steps = decoded.steps[axis]
    tilt = light.tilt[axis] if frames.patterns.complementary else edge_levels(frames, AXES[axis], cells, steps)
    stack = cast(Stack, np.ascontiguousarray(frames.stack))
    down, pictures, reach = line_pictures(frames, stack, axis, cells, every(steps), light.noise, tilt)
    run = along_columns if down else along_rows

    def slab(first: int, last: int) -> None:
        run(pictures, steps, decoded.contrast, first, last, reach, place, sigma)

    in_slabs(steps.shape[1 if down else 0], slab)


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
        tilt=(scale * tilt)[cells.flips].astype(np.float32),
        edge=cells.edge,
        centre=centre,
        width=cells.widths(),
        unsure=np.square(unsure),
        noise=np.float32(noise * np.sqrt(2 if patterns.complementary else 6)),
        flat=np.float32(FLAT_PX**2 + (BENT_PX * density**2) ** 2),
    )
    return down, pictures, max(0, min(round(1 / max(density, 1e-3)), REACH, (min(shape) - 1) // 2))


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
