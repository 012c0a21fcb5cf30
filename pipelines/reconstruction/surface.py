"""Points to a height map, in bands of image rows: what falls into each cell, edges kept sharp, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..instant import Instant
from ..scan import LEVEL_NONE, Scan
from ..slabs import in_slabs
from .clean import background_border
from .clean_kernels import drop_mixed, keep_dense, take_points
from .frames import Frames
from .grid_kernels import STEEPEST, drop_beyond, fill
from .gridding import field_mm, pixel_mm
from .height_doubt import add_rows, doubt_mm, doubt_of_cells
from .lay_kernels import lay, to_site
from .mend_kernels import mend
from .pixel_maps import Decoded, PointMap, Shared
from .reconstruct import check_projector
from .rig_model import Calibration
from .shared_error import carrier, left_by_mean, shared_mm2
from .smooth_cells import reach_of, tell_smooth
from .subpixel import locate
from .triangulate import triangulate_bands

__all__ = ["Laid", "Sharing", "fill_cells", "scan_decoded", "scan_frames", "sharing", "to_scan"]

F32 = npt.NDArray[np.float32]
Source = Callable[[int, int, F32], None]
"""Writes x, y, z (camera frame) and sigma of some image rows into planes, (4, row, column)."""
Samples = tuple[F32, F32, F32]

# Widths of the finest stripe that share an error. Edges err independently, one a stripe; a position between two of them
# has (1 - t)^2 + t^2 of their variance, two thirds in the mean: so many stripes are worth that share of them.
SHARED = 1.5
USELESS = 0.01  # of the field of view: a point less certain than that tells nothing of a surface
PIXEL_ROWS = 64  # image rows that are worked on at once: their points stay in the cache
CELL_ROWS = 16  # rows of the grid, likewise
MEND_ROWS = 256  # rows of the grid that are mended at once
HALO = 6  # image rows beside a band: two for mixed pixels, two for lone ones, two for neighbours
RASTER = 256  # image rows, about, that the background is looked for in


def to_scan(
    points: PointMap,
    calibration: Calibration,
    grid: Grid,
    time: Instant,
    *,
    remove_background: bool = True,
) -> Scan:
    """Clean a point map and put it on a grid of the site frame.

    Points that are less certain than a hundredth of the field of view, and lone ones, are left out. Each cell takes
    the mean of its points, weighted by their inverse variance and moved to the cell's centre along the slope of the
    surface, which the neighbours of each point in the image give. Where a cell holds two surfaces (the rim and the
    floor of a crack) the one with more points wins, the upper one in a tie; nothing is averaged across.

    A pixel covers what it sees of the surface, to the middle between it and its neighbours. A cell is measured if at
    least half of its area is covered, or if points lie in it and nearly all around: so outlines are where they are,
    whatever the pitch. A covered cell without a point of its own (of a pitch finer than the pixels) takes the
    planes of the pixels that cover it. Single holes in a surface are filled from opposite neighbours; wider gaps, and
    narrow ones that go on, stay NaN.

    Neighbouring points are placed between the same edges of stripes, so n points of a cell are worth
    (1 + (sqrt(n) - 1) / s)^2 independent ones, s being `SHARED` widths of the stripes in camera pixels: along the lines
    by geometry, and across them because relief, texture and blur reach about as far there. Noise alone is independent
    from line to line: on smooth surfaces the heights themselves show it (`smooth_cells.tell_smooth`). What all lines
    share (`shared_error`) goes down less, and what the calibration leaves open they share altogether.

    Parameters
    ----------
    points : PointMap
    calibration : Calibration
    grid : Grid
    time : Instant
    remove_background : bool
        Remove a background that stands well apart (K-means), as the paper does.

    Returns
    -------
    Scan
    """

    def source(first: int, last: int, planes: F32) -> None:
        take_points(points.xyz[first:last], points.sigma_z[first:last], planes)

    laid = _lay(source, points.level.shape, calibration, grid, mixed=False, background=not remove_background)
    some = stripe_samples(points.projector[..., 0], points.projector[..., 1])
    return _sum_up(laid, points.texture, points.level, some, points.shared, calibration, grid, time)


def scan_frames(
    frames: Frames,
    calibration: Calibration,
    grid: Grid,
    *,
    remove_background: bool = True,
    local_integration: bool = False,
) -> Scan:
    """Go the whole way from frames to a height map: `reconstruct` and `to_scan` in bands of rows, with half the memory.

    Raises
    ------
    ValueError
        If the images or the patterns are not of the size that was calibrated.
    """
    check_projector(frames, calibration)
    decoded = locate(frames, local_integration=local_integration)
    return scan_decoded(decoded, calibration, grid, frames.time, remove_background=remove_background)


def scan_decoded(
    decoded: Decoded, calibration: Calibration, grid: Grid, time: Instant, *, remove_background: bool = True
) -> Scan:
    """Triangulate, reject mixed pixels and do what `to_scan` does, band by band: no map of all points is ever made.

    Raises
    ------
    ValueError
        As `triangulate`.
    """
    source = triangulate_bands(decoded, calibration)
    laid = _lay(source, decoded.level.shape, calibration, grid, mixed=True, background=not remove_background)
    some, shared = stripe_samples(decoded.column, decoded.row), shared_mm2(decoded.shared, calibration)
    return _sum_up(laid, decoded.texture, decoded.level, some, shared, calibration, grid, time)


class Sharing(NamedTuple):
    """What the points of a cell share of their errors, as the kernels take it."""

    apart: float
    """Points along a line of which errors are shared as if they were one."""
    within: float = 0.0
    beside: float = 0.0
    """As of `Shared`, mm squared."""
    left: float = 1.0
    """The share of these that is left in the mean of a whole cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """Where each camera pixel lies on the grid; the arrays are those of `lay_kernels.lay`."""

    cell: npt.NDArray[np.int32]
    above: F32
    sigma: F32
    local: npt.NDArray[np.int8]
    slope: npt.NDArray[np.int16]
    reach: npt.NDArray[np.int32]

    @staticmethod
    def room(size: tuple[int, int]) -> Laid:
        """Arrays to be filled, for an image of that size."""
        return Laid(
            np.empty(size, np.int32),
            np.empty(size, np.float32),
            np.empty(size, np.float32),
            np.empty((*size, 4), np.int8),
            np.empty((*size, 2), np.int16),
            np.empty((size[0], 2), np.int32),
        )

    @property
    def arrays(self) -> tuple[npt.NDArray[np.generic], ...]:
        """All of them, as the kernels take them."""
        return self.cell, self.above, self.sigma, self.local, self.slope, self.reach


def _lay(
    source: Source, size: tuple[int, int], calibration: Calibration, grid: Grid, *, mixed: bool, background: bool
) -> Laid:
    """Clean the points and lay them on the grid, in bands of image rows."""
    rows, columns = size
    laid = Laid.room(size)
    worst = USELESS * field_mm(calibration)
    reference = np.ascontiguousarray(calibration.reference)
    place = (grid.x0_mm, grid.y0_mm, grid.pitch_mm)
    usual, coarse = _usual(calibration, grid), doubt_mm(calibration)
    step = max(1, min(size) // RASTER)
    some = np.empty((3, -(-rows // step), -(-columns // step)), np.float32)

    def stretch(begin: int, end: int) -> None:
        most = min(rows, PIXEL_ROWS + 2 * HALO)
        room = np.empty((4, most, columns), np.float32)
        flags, kept = np.empty((most, columns), np.uint8), np.empty((most, columns), np.bool_)
        for first in range(begin, end, PIXEL_ROWS):
            last = min(first + PIXEL_ROWS, end)
            low, high = max(first - HALO, 0), min(last + HALO, rows)
            planes, keep = room[:, : high - low], kept[: high - low]
            source(low, high, planes)
            if mixed:
                drop_mixed(planes, flags, max(first - 4, 0) - low, min(last + 4, rows) - low)
            near = max(first - 2, 0) - low, min(last + 2, rows) - low
            keep_dense(planes, worst, keep, *near)
            raster = np.arange(-(-first // step) * step, last, step)
            some[:, raster // step] = planes[:3, raster - low, ::step]
            some[2, raster // step] = np.where(keep[raster - low, ::step], some[2, raster // step], np.nan)
            add_rows(planes[3], coarse, -1.0, planes[3], low, rows)  # what is left are errors that means make less
            to_site(planes, keep, reference, *near)
            out = (array[first:last] for array in laid.arrays)
            lay(planes, first - low, last - low, place, grid.shape, usual, *out)

    in_slabs(rows, stretch)
    farthest = np.inf if background else background_border(some)
    if np.isfinite(farthest):
        drop_beyond(farthest, reference, place, grid.columns, laid.cell, laid.above, laid.local)
    return laid


def _sum_up(
    laid: Laid,
    texture: npt.NDArray[np.uint8],
    level: npt.NDArray[np.uint8],
    some: Sequence[Samples],
    shared: Shared,
    calibration: Calibration,
    grid: Grid,
    time: Instant,
) -> Scan:
    usual, stripe = _usual(calibration, grid), stripe_px(some)
    height, sigma, *light = fill_cells(
        laid, texture, level, grid, usual, sharing(stripe, some, shared, calibration, usual)
    )
    tell_smooth(height, sigma, reach_of(stripe, usual))
    doubt_of_cells(sigma, grid, calibration)
    return Scan(grid, time, height, sigma, light[0], light[1], calibration.id)


def fill_cells(
    laid: Laid,
    texture_in: npt.NDArray[np.uint8],
    level_in: npt.NDArray[np.uint8],
    grid: Grid,
    usual: tuple[float, float],
    sharing: Sharing,
) -> tuple[F32, F32, npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Fill the cells, in bands of rows of the grid: height, sigma, texture and level.

    `usual` are the half sides of a usual footprint, cells.
    """
    out = (
        np.empty(grid.shape, np.float32),
        np.empty(grid.shape, np.float32),
        np.empty(grid.shape, np.uint8),
        np.empty(grid.shape, np.uint8),
    )
    band = partial(fill, laid.arrays, texture_in, level_in, usual, grid.pitch_mm, sharing, *out)
    in_slabs(grid.rows, band, step=CELL_ROWS)
    _mend(out, np.float32(STEEPEST * grid.pitch_mm))
    return out


def _mend(out: tuple[npt.NDArray[Any], ...], gap: np.float32) -> None:
    """Mend the grid in stretches of rows, each of which needs the rows beside it as they are now."""
    rows = len(out[0])
    rims = []
    for first in range(0, rows, MEND_ROWS):
        beside = first - 1, min(first + MEND_ROWS, rows)
        inside = np.array([0 <= row < rows for row in beside])
        rims.append(tuple(array[np.clip(beside, 0, rows - 1)] for array in out))
        for array, beyond in zip(rims[-1], (np.nan, np.nan, 0, LEVEL_NONE), strict=True):
            array[~inside] = beyond
    in_slabs(rows, lambda first, last: mend(*out, rims[first // MEND_ROWS], gap, first, last), step=MEND_ROWS)


def _usual(calibration: Calibration, grid: Grid) -> tuple[float, float]:
    """Half sides of a pixel's usual footprint, cells."""
    x, y = pixel_mm(calibration)
    return x / grid.pitch_mm / 2, y / grid.pitch_mm / 2


def sharing(
    stripe: float, some: Sequence[Samples], shared: Shared, calibration: Calibration, usual: tuple[float, float]
) -> Sharing:
    """What the points of a cell share, by the width of stripes (px), samples of both axes, and what lines share."""
    apart = max(1.0, SHARED * stripe)
    side_px = 0.5 / math.sqrt(usual[0] * usual[1])
    return Sharing(apart, *shared, left_by_mean(side_px, apart, *some[carrier(calibration)]))


def stripe_samples(column: F32, row: F32) -> tuple[Samples, ...]:
    """Of each axis positions at a raster of pixels, and at the next ones along and down the image."""
    rows, columns = stripe_raster(column.shape)
    return tuple((place[:-1:rows, :-1:columns], place[:-1:rows, 1::columns], place[1::rows, :-1:columns])
                 for place in (column, row))  # fmt: skip


def stripe_raster(shape: tuple[int, ...]) -> list[int]:
    """Steps along rows and columns at which the stripes are measured."""
    return [max(1, side // 200) for side in shape]


def stripe_px(some: Sequence[Samples]) -> float:
    """Camera pixels per projector pixel, along the axis that is seen more coarsely; at least 1."""
    width = 1.0
    for here, aside, below in some:
        both = [float(np.median(change[np.isfinite(change)])) if np.isfinite(change).any() else 0.0
                for change in (np.abs(aside - here), np.abs(below - here))]  # fmt: skip
        growth = math.hypot(*both)
        width = max(width, 1 / growth if growth > 0 else 0.0)
    return width
