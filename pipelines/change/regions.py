"""Polygons to cells: the stable areas and the region of interest as masks on a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..grid import Grid

__all__ = ["polygon_mask"]


def polygon_mask(polygons: Sequence[Sequence[tuple[float, float]]], grid: Grid) -> npt.NDArray[np.bool_]:
    """Mark the cells whose centre lies inside at least one polygon.

    Parameters
    ----------
    polygons : sequence of sequences of (x_mm, y_mm)
        Corners in the site frame, in either sense; the last joins the first. A polygon that crosses
        itself counts by the even-odd rule.
    grid : Grid

    Returns
    -------
    ndarray of bool, shape (rows, columns)
        A centre on an edge belongs to the polygon on its right or above it, so that polygons which share
        an edge share no cell.

    Raises
    ------
    ValueError
        If a polygon has fewer than three corners or a corner is not finite.
    """
    inside = np.zeros(grid.shape, dtype=np.bool_)
    x, y = grid.x_mm[None, :], grid.y_mm[:, None]
    for number, polygon in enumerate(polygons, start=1):
        corners = np.asarray(polygon, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2 or not np.isfinite(corners).all():
            raise ValueError(f"polygon {number} needs at least three finite (x_mm, y_mm) corners")
        odd = np.zeros(grid.shape, dtype=np.bool_)
        for (xa, ya), (xb, yb) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if ya == yb:
                continue  # a level edge is crossed by no horizontal ray
            spans = (ya <= y) != (yb <= y)
            odd ^= spans & (x < xa + (y - ya) * (xb - xa) / (yb - ya))
        inside |= odd
    return inside
