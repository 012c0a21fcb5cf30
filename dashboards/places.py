"""Places: the polygons that a campaign names, what counts and what holds still, as cells and as outlines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import Grid
from pipelines.change import polygon_mask

__all__ = ["Places", "Polygon", "cut_to", "places_of"]

Mask = npt.NDArray[np.bool_]
Polygon = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Places:
    """Polygons of (x, y) in the site frame, mm.

    Parameters
    ----------
    region : Polygon
        What counts in the metrics; empty where everything does.
    stable : tuple of Polygon
        What does not move, by which scans are laid on each other; it counts in no metric.
    """

    region: Polygon = ()
    stable: tuple[Polygon, ...] = ()

    @property
    def named(self) -> tuple[tuple[str, Polygon], ...]:
        """Each polygon with its name."""
        numbered = len(self.stable) > 1
        stable = [(f"stable {number}" if numbered else "stable", each) for number, each in enumerate(self.stable, 1)]
        return (*([("region", self.region)] if self.region else []), *stable)

    def stable_cells(self, grid: Grid) -> Mask:
        """Mark the cells that hold still, shape (rows, columns)."""
        return polygon_mask(self.stable, grid)

    def counted_cells(self, grid: Grid) -> Mask:
        """Mark the cells that count, shape (rows, columns): the region, less what holds still."""
        inside = polygon_mask([self.region], grid) if self.region else np.ones(grid.shape, dtype=np.bool_)
        return inside & ~self.stable_cells(grid)


def places_of(settings: Mapping[str, Any]) -> Places:
    """Read the polygons of a campaign's settings; what is none is left out, as where a rig's options have changed."""
    register = settings.get("register")
    given = register.get("stable_mm") if isinstance(register, dict) else None
    stable = [_polygon(each) for each in given] if isinstance(given, list) else []
    return Places(_polygon(settings.get("region_mm")), tuple(stable) if all(stable) else ())


def _polygon(value: object) -> Polygon:
    """Read three corners or more; empty where they are none."""
    try:
        corners = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return ()
    if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        return ()
    return tuple((float(x), float(y)) for x, y in corners)


def cut_to(polygon: Polygon, grid: Grid) -> npt.NDArray[np.float64]:
    """Cut a polygon at the edges of a grid: its corners, shape (n, 2), mm; none where it lies beside the grid.

    Sutherland and Hodgman, "Reentrant polygon clipping", CACM 17 (1974): one edge of the rectangle after the other.
    """
    corners = np.asarray(polygon, dtype=np.float64).reshape(-1, 2)
    x_low, x_high, y_low, y_high = grid.extent_mm
    for axis, end, side in ((0, x_low, 1), (0, x_high, -1), (1, y_low, 1), (1, y_high, -1)):
        beyond = side * (corners[:, axis] - end)
        kept = []
        for here, there, a, b in zip(corners, np.roll(corners, -1, 0), beyond, np.roll(beyond, -1), strict=True):
            if a >= 0:
                kept.append(here)
            if (a >= 0) != (b >= 0):
                kept.append(here + a / (a - b) * (there - here))
        corners = np.array(kept).reshape(-1, 2)
    return corners
