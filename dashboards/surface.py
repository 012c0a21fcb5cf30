"""A height map as a lit surface: triangles once per grid, then positions, normals and three colourings per scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines import Change, Grid, Scan

from .palette import CHANGE_SCALE, HEIGHT_SCALE, LEVEL_SCALE, NOT_MEASURED, Rgb, colour_table
from .raster import Range, above_detection, block_mean, shrink_factor, tone
from .scales import Scales

__all__ = ["Surface", "surface", "triangles"]

Vectors = npt.NDArray[np.float32]
Colours = npt.NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Vertices of one scan, row by row.

    Parameters
    ----------
    positions : ndarray of float32, shape (vertices, 3)
        mm, site frame; z is NaN where not measured, which leaves a hole.
    normals : ndarray of float32, shape (vertices, 3)
        Unit vectors.
    by_height, by_change, by_level : ndarray of uint32, shape (vertices,)
        Colours as 0xRRGGBBAA.
    """

    positions: Vectors
    normals: Vectors
    by_height: Colours
    by_change: Colours
    by_level: Colours


def triangles(grid: Grid, most: int) -> npt.NDArray[np.uint32]:
    """Join the vertices of `surface` to triangles, counter-clockwise seen from +z, shape (triangles, 3)."""
    factor = shrink_factor(grid.rows, grid.columns, most)
    rows, columns = -(-grid.rows // factor), -(-grid.columns // factor)
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    here, right, above, across = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    lower = np.stack([here, right, across], axis=-1).reshape(-1, 3)
    upper = np.stack([here, across, above], axis=-1).reshape(-1, 3)
    return np.concatenate([lower, upper])


def surface(scan: Scan, change: Change | None, scales: Scales) -> Surface:
    """Turn a scan into at most ``scales.detail.vertices`` vertices.

    Blocks of cells are averaged where the grid is finer, so that noise falls rather than aliases. A baseline, which
    has no change, is drawn as unchanged.
    """
    grid = scan.grid
    factor = shrink_factor(grid.rows, grid.columns, scales.detail.vertices)
    height = block_mean(scan.height, factor)
    pitch = grid.pitch_mm * factor
    x = grid.x0_mm + (factor - 1) / 2 * grid.pitch_mm + pitch * np.arange(height.shape[1])
    y = grid.y0_mm + (factor - 1) / 2 * grid.pitch_mm + pitch * np.arange(height.shape[0])
    positions = np.empty((*height.shape, 3), dtype=np.float32)
    positions[..., 0] = x
    positions[..., 1] = y[:, None]
    positions[..., 2] = height
    normals = np.empty_like(positions)
    normals[..., 0] = -_slope(height, 1) / pitch
    normals[..., 1] = -_slope(height, 0) / pitch
    normals[..., 2] = 1
    normals /= np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))[..., None]
    limit = max(scales.change_limit_mm, 1e-6)
    moved = np.where(np.isfinite(height), np.float32(0), np.float32(np.nan))
    if change is not None:
        moved = block_mean(above_detection(change.dz, change.lod), factor)
    return Surface(
        positions.reshape(-1, 3),
        normals.reshape(-1, 3),
        _packed(HEIGHT_SCALE)[tone(height, scales.height)].ravel(),
        _packed(CHANGE_SCALE)[tone(moved, Range(-limit, limit))].ravel(),
        _levels()[scan.level[::factor, ::factor]].ravel(),
    )


def _packed(scale: tuple[Rgb, ...]) -> Colours:
    """Give the colours of `tone`'s steps, the last that of a cell without a value."""
    return _rgba(np.concatenate([colour_table(scale), np.array([NOT_MEASURED], dtype=np.uint8)]))


def _levels() -> Colours:
    colours = np.full((256, 3), LEVEL_SCALE[-1], dtype=np.uint8)
    colours[: len(LEVEL_SCALE)] = LEVEL_SCALE
    colours[255] = NOT_MEASURED
    return _rgba(colours)


def _rgba(colours: npt.NDArray[np.uint8]) -> Colours:
    red, green, blue = colours.astype(np.uint32).T
    packed: Colours = (red << 24) | (green << 16) | (blue << 8) | np.uint32(255)
    return packed


def _slope(height: npt.NDArray[np.float32], axis: int) -> npt.NDArray[np.float32]:
    """Mean of the steps to both neighbours, of the one that was measured, or 0 where neither was."""
    step = np.diff(height, axis=axis)
    ends = [(0, 0), (0, 0)]
    ends[axis] = (0, 1)
    ahead = np.pad(step, ends, constant_values=np.nan)
    ends[axis] = (1, 0)
    behind = np.pad(step, ends, constant_values=np.nan)
    measured = np.isfinite(ahead).astype(np.float32) + np.isfinite(behind)
    total = np.nan_to_num(ahead) + np.nan_to_num(behind)
    return (total / np.maximum(measured, 1)).astype(np.float32)
