"""Points to a height map: where the cells lie, and what falls into each, edges kept sharp."""

from __future__ import annotations

import math

import numpy as np

from ..grid import Grid
from ..instant import Instant
from ..scan import Scan
from .clean import background_border, remove_lone
from .grid_kernels import STEEPEST, bridge, fill, lay
from .height_doubt import doubt_of_cells, narrowed
from .pinhole import Floats, project
from .pixel_maps import PointMap
from .rig_model import Calibration
from .sight import in_front, on_plane
from .slabs import in_slabs

__all__ = ["footprint_grid", "on_reference", "to_scan"]

SHARED = 1.5  # widths of the finest stripe over which neighbouring pixels share the errors of its edges
USELESS = 0.01  # of the field of view: a point less certain than that tells nothing of a surface
BAND = 32  # rows of the grid that are worked on at once: what is summed up of them stays in the cache


def footprint_grid(calibration: Calibration, pitch_mm: float | None = None) -> Grid:
    """Give the grid that covers what both camera and projector see of the reference plane.

    Parameters
    ----------
    calibration : Calibration
    pitch_mm : float, optional
        Side of a cell; by default the median camera pixel on the reference plane, rounded to 1-2-5.

    Returns
    -------
    Grid
        Cell edges at multiples of the pitch.

    Raises
    ------
    ValueError
        If the two fields of view do not overlap on the reference plane.
    """
    columns, rows = calibration.camera.size
    u, v = np.linspace(0, columns - 1, 97), np.linspace(0, rows - 1, 97)
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    points = on_reference(calibration, pixels)
    aside = on_reference(calibration, pixels + np.array([1.0, 0.0]))
    below = on_reference(calibration, pixels + np.array([0.0, 1.0]))
    pixel_mm2 = np.linalg.norm(np.cross(aside - points, below - points), axis=-1)
    lit = points @ calibration.R.T + calibration.t_mm
    where = project(calibration.projector, lit)
    wide, high = calibration.projector.size
    inside = in_front(calibration.projector, lit) & in_front(calibration.camera, points)
    inside &= (where[..., 0] >= -0.5) & (where[..., 0] <= wide - 0.5)
    inside &= (where[..., 1] >= -0.5) & (where[..., 1] <= high - 0.5)
    if not inside.any():
        raise ValueError(
            "camera and projector see no common part of the reference plane: choose another reference pose"
        )
    pitch = round_125(float(np.sqrt(np.median(pixel_mm2[inside])))) if pitch_mm is None else pitch_mm
    site = points[inside] @ calibration.reference[:, :3].T + calibration.reference[:, 3]
    half_step = 0.5 * np.sqrt(np.median(pixel_mm2[inside])) * max(columns, rows) / 96  # the samples are this coarse
    low = np.floor((site[:, :2].min(axis=0) - half_step) / pitch)
    high_ = np.ceil((site[:, :2].max(axis=0) + half_step) / pitch)
    count = np.maximum(high_ - low, 1).astype(int)
    return Grid(
        rows=int(count[1]),
        columns=int(count[0]),
        pitch_mm=pitch,
        x0_mm=float((low[0] + 0.5) * pitch),
        y0_mm=float((low[1] + 0.5) * pitch),
    )


def round_125(value: float) -> float:
    """Round to 1, 2 or 5 times a power of ten, by ratio."""
    power = 10.0 ** math.floor(math.log10(value))
    choice = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / (step * power))))
    return float(f"{choice * power:.12g}")


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
    floor of a crack) the one with more points wins, the upper one in a tie; nothing is averaged across. Single empty
    cells between two measured ones of the same surface are filled; wider gaps stay NaN.

    Neighbouring points are placed between the same edges of stripes, seen through the same blur, so n points of a cell
    are worth (1 + (sqrt(n) - 1) / s)^2 independent ones, s being `SHARED` widths of the stripes in camera pixels. What
    the calibration leaves open they share altogether.

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
    keep = remove_lone(points, USELESS * _field_mm(calibration))
    farthest = background_border(points, keep) if remove_background else np.inf
    shape = grid.shape
    level, texture = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    height, sigma = np.empty(shape, np.float32), np.empty(shape, np.float32)
    raw = np.empty(shape, np.float32)
    steepest = STEEPEST * grid.pitch_mm
    shared = max(1.0, SHARED * _stripe_px(points))
    pixels = keep.shape
    cell, above = np.empty(pixels, np.int32), np.empty(pixels, np.float32)
    offset, slope = np.empty((*pixels, 2), np.int8), np.empty((*pixels, 2), np.int16)
    reach = np.empty((len(keep), 2), np.int32)
    reference = np.ascontiguousarray(calibration.reference)
    own = narrowed(points, calibration)
    place = (grid.x0_mm, grid.y0_mm, grid.pitch_mm)

    in_slabs(
        len(keep),
        lambda first, last: lay(
            points.xyz, keep, farthest, reference, place, shape, cell, above, offset, slope, reach, first, last
        ),
    )
    in_slabs(
        grid.rows,
        lambda first, last: fill(
            cell, above, offset, slope, reach, own.sigma_z, points.texture, points.level,
            steepest, grid.pitch_mm, shared, raw, sigma, texture, level, first, last,
        ),
        step=BAND,
    )  # fmt: skip
    in_slabs(grid.rows, lambda first, last: bridge(raw, height, sigma, texture, level, steepest, first, last))
    doubt_of_cells(sigma, grid, calibration)
    return Scan(grid, time, height, sigma, texture, level, calibration.id)


def _stripe_px(points: PointMap) -> float:
    """Camera pixels per projector pixel, along the axis that is seen more coarsely."""
    step = max(1, len(points.projector) // 200)
    lines = points.projector[::step]
    below = points.projector[1::step]
    width = 1.0
    for axis in range(2):
        along = np.abs(np.diff(lines[..., axis], axis=1))
        down = np.abs(below[: len(lines), :, axis] - lines[: len(below), :, axis])
        both = [float(np.nanmedian(change)) if np.isfinite(change).any() else 0.0 for change in (along, down)]
        growth = math.hypot(*both)
        width = max(width, 1 / growth) if growth > 0 else width
    return width


def _field_mm(calibration: Calibration) -> float:
    """Shorter side of what the camera sees of the reference plane."""
    columns, rows = calibration.camera.size
    edges = np.array([[0, rows / 2], [columns, rows / 2], [columns / 2, 0], [columns / 2, rows]])
    left, right, top, bottom = on_plane(calibration.camera, calibration.reference, edges)
    return float(min(np.linalg.norm(right - left), np.linalg.norm(bottom - top)))


def on_reference(calibration: Calibration, pixels: Floats) -> Floats:
    """Points of the reference plane (camera frame, mm) that camera pixels see."""
    return on_plane(calibration.camera, calibration.reference, pixels)
