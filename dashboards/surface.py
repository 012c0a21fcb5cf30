"""A height map as a lit surface: triangles once per grid, then positions, normals and colours per scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines import Grid, Scan

from .palette import HEIGHT_SCALE, NOT_MEASURED, colour_table
from .raster import Range, block_mean, shrink_factor, tone

__all__ = ["MOST_VERTICES", "Surface", "surface", "triangles"]

MOST_VERTICES = 62_500
"""A viewer draws this many lit vertices per scan without lagging (19 ms and 1.5 MB a scan)."""

Vectors = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Vertices of one scan, row by row.

    Parameters
    ----------
    positions : ndarray of float32, shape (vertices, 3)
        mm, site frame; z is NaN where not measured, which leaves a hole.
    normals : ndarray of float32, shape (vertices, 3)
        Unit vectors.
    colours : ndarray of uint8, shape (vertices, 3)
    """

    positions: Vectors
    normals: Vectors
    colours: npt.NDArray[np.uint8]


def triangles(grid: Grid, most: int = MOST_VERTICES) -> npt.NDArray[np.uint32]:
    """Join the vertices of `surface` to triangles, counter-clockwise seen from +z, shape (triangles, 3)."""
    factor = shrink_factor(grid.rows, grid.columns, most)
    rows, columns = -(-grid.rows // factor), -(-grid.columns // factor)
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    here, right, above, across = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    lower = np.stack([here, right, across], axis=-1).reshape(-1, 3)
    upper = np.stack([here, across, above], axis=-1).reshape(-1, 3)
    return np.concatenate([lower, upper])


def surface(scan: Scan, span: Range, most: int = MOST_VERTICES) -> Surface:
    """Turn a scan into at most `most` vertices, coloured by height.

    Blocks of cells are averaged where the grid is finer, so that noise falls rather than aliases.
    """
    grid = scan.grid
    factor = shrink_factor(grid.rows, grid.columns, most)
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
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    colours = np.concatenate([colour_table(HEIGHT_SCALE), np.array([NOT_MEASURED], dtype=np.uint8)])
    return Surface(positions.reshape(-1, 3), normals.reshape(-1, 3), colours[tone(height, span)].reshape(-1, 3))


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
