"""Points to a height map: where the cells lie, and what falls into each, edges kept sharp."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from ..grid import Grid
from ..instant import Instant
from ..scan import LEVEL_NONE, Scan
from .clean import background, remove_lone
from .pinhole import Floats, project, undistort
from .pixel_maps import PointMap
from .rig_model import Calibration

__all__ = ["footprint_grid", "to_scan"]

STEEPEST = 3.0  # two points of one cell further apart in height than this many cells are two surfaces


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
    points = _on_reference(calibration, pixels)
    aside = _on_reference(calibration, pixels + np.array([1.0, 0.0]))
    below = _on_reference(calibration, pixels + np.array([0.0, 1.0]))
    pixel_mm2 = np.linalg.norm(np.cross(aside - points, below - points), axis=-1)
    lit = points @ calibration.R.T + calibration.t_mm
    where = project(calibration.projector, lit)
    wide, high = calibration.projector.size
    inside = (lit[..., 2] > 0) & (points[..., 2] > 0)
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

    Each cell takes the mean of its points, weighted by their inverse variance. Where a cell holds two surfaces (the
    rim and the floor of a crack) the one with more points wins, the upper one in a tie; nothing is averaged across.
    Single empty cells between two measured ones of the same surface are filled; wider gaps stay NaN.

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
    reference = np.ascontiguousarray(calibration.reference)
    keep = remove_lone(points)
    if remove_background:
        keep &= ~background(points, keep)
    shape = grid.shape
    height, sigma = np.empty(shape, np.float32), np.empty(shape, np.float32)
    texture, level = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    _splat(
        points.xyz, points.sigma_z, points.texture, points.level, keep, reference,
        grid.x0_mm, grid.y0_mm, grid.pitch_mm, STEEPEST * grid.pitch_mm, height, sigma, texture, level,
    )  # fmt: skip
    _bridge(height, sigma, texture, level, STEEPEST * grid.pitch_mm)
    return Scan(grid, time, height, sigma, texture, level, calibration.id)


def _on_reference(calibration: Calibration, pixels: Floats) -> Floats:
    """Points of the reference plane (camera frame, mm) that camera pixels see."""
    flat = undistort(calibration.camera, pixels)
    rays = np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)
    normal, offset = calibration.reference[2, :3], calibration.reference[2, 3]
    points: Floats = rays * (-offset / (rays @ normal))[..., None]
    return points


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _splat(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    xyz, sigma_z, texture_in, level_in, keep, M, x0, y0, pitch, gap, height, sigma, texture, level
):
    rows, columns = height.shape
    H, W = sigma_z.shape
    top = np.full((rows, columns), -np.inf, np.float32)
    bottom = np.full((rows, columns), np.inf, np.float32)
    cell = np.full((H, W), -1, np.int32)
    z_site = np.empty((H, W), np.float32)
    along, across = np.empty((H, W), np.float32), np.empty((H, W), np.float32)
    for i in range(H):
        for j in range(W):
            if not keep[i, j]:
                continue
            x, y, z = xyz[i, j, 0], xyz[i, j, 1], xyz[i, j, 2]
            a = (M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3] - x0) / pitch
            b = (M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3] - y0) / pitch
            column, row = int(np.floor(a + 0.5)), int(np.floor(b + 0.5))
            if 0 <= row < rows and 0 <= column < columns:
                h = np.float32(M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3])
                z_site[i, j] = h
                along[i, j], across[i, j] = a - column, b - row
                cell[i, j] = row * columns + column
                top[row, column] = max(top[row, column], h)
                bottom[row, column] = min(bottom[row, column], h)
    # Points of the upper and of the lower surface of each cell, told apart only where the cell spans more than `gap`.
    upper, lower = np.zeros((rows, columns), np.uint16), np.zeros((rows, columns), np.uint16)
    for i in range(H):
        for j in range(W):
            if cell[i, j] >= 0:
                row, column = cell[i, j] // columns, cell[i, j] % columns
                if top[row, column] - bottom[row, column] > gap:
                    if 2 * z_site[i, j] > top[row, column] + bottom[row, column]:
                        upper[row, column] += 1
                    else:
                        lower[row, column] += 1
    weight, total = np.zeros((rows, columns), np.float64), np.zeros((rows, columns), np.float64)
    bright, count = np.zeros((rows, columns), np.uint32), np.zeros((rows, columns), np.uint16)
    level[:] = 0
    for i in range(H):
        for j in range(W):
            if cell[i, j] < 0:
                continue
            row, column = cell[i, j] // columns, cell[i, j] % columns
            if upper[row, column] + lower[row, column] > 0:
                high = 2 * z_site[i, j] > top[row, column] + bottom[row, column]
                if high != (upper[row, column] >= lower[row, column]):
                    continue
            w = 1.0 / (sigma_z[i, j] * sigma_z[i, j])
            weight[row, column] += w
            total[row, column] += w * z_site[i, j]
            bright[row, column] += texture_in[i, j]
            count[row, column] += 1
            level[row, column] = max(level[row, column], level_in[i, j])
    for row in range(rows):
        for column in range(columns):
            n = count[row, column]
            if n == 0:
                height[row, column] = np.nan
                sigma[row, column] = np.nan
                texture[row, column] = 0
                level[row, column] = LEVEL_NONE
            else:
                height[row, column] = total[row, column] / weight[row, column]
                sigma[row, column] = 1.0 / np.sqrt(weight[row, column])
                texture[row, column] = bright[row, column] // n


@nb.njit(cache=True, nogil=True)
def _bridge(height, sigma, texture, level, gap):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill single empty cells between two opposite measured ones of the same surface."""
    rows, columns = height.shape
    source = height.copy()
    steps = ((0, 1), (1, 0), (1, 1), (1, -1))
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            if source[row, column] == source[row, column]:
                continue
            total, spread, bright, worst, n = 0.0, 0.0, 0, 0, 0
            for a, b in steps:
                one, two = source[row - a, column - b], source[row + a, column + b]
                if abs(one - two) <= gap:  # false where either is NaN
                    total += one + two
                    spread = max(spread, sigma[row - a, column - b], sigma[row + a, column + b])
                    bright += int(texture[row - a, column - b]) + int(texture[row + a, column + b])
                    worst = max(worst, level[row - a, column - b], level[row + a, column + b])
                    n += 2
            if n > 0:
                height[row, column] = total / n
                sigma[row, column] = spread
                texture[row, column] = bright // n
                level[row, column] = worst
