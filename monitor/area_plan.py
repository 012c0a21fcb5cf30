"""Area plan: where the stage goes at every visit of a campaign, and the one grid that all its scans lie on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from configs import Area, InputError
from pipelines import Grid

from .stage_axes import in_site
from .tiles import Tile, plan_tiles

__all__ = ["AXES_NEEDED", "AreaPlan", "check_reach", "plan_area"]

AXES_NEEDED = (
    "needs axes, such as [-x, y]: all scans of a schedule lie on one grid, which must be known before the first. "
    "`microrelief area CAMPAIGN --out DIR` finds and prints them, once"
)
MOST_BEYOND = 0.1
"""A plan may leave the store's grid by this share of the field of view: each calibration sees a little more or less."""


@dataclass(frozen=True, slots=True)
class AreaPlan:
    """The tiles of an area, and where they lie in the site frame.

    Parameters
    ----------
    area : Area
    tiles : tuple of Tile
        In the order in which they are visited.
    footprint : Grid
        Of one tile as it is captured, the sample wherever the stage has carried it.
    grid : Grid
        Of them all in the sample's own frame: the site frame while the stage stands at its zero.
    """

    area: Area
    tiles: tuple[Tile, ...]
    footprint: Grid
    grid: Grid

    @property
    def least(self) -> int:
        """So many tiles make a scan."""
        return math.ceil(self.area.least_tiles * len(self.tiles) - 1e-9)


def plan_area(area: Area, footprint: Grid) -> AreaPlan:
    """Plan the tiles of an area, and the grid that covers them where the stage is told to go.

    Nothing in it comes from a capture, so the grid is the same at every scan, whatever fails in any of them.

    Parameters
    ----------
    area : Area
        With its axes.
    footprint : Grid
        What camera and projector both see of the reference plane.

    Raises
    ------
    InputError
        It is not said how the stage's axes lie.
    """
    if area.axes is None:
        raise InputError(f"area: {AXES_NEEDED}")
    pitch = footprint.pitch_mm
    tiles = plan_tiles(area, (footprint.columns * pitch, footprint.rows * pitch))
    moved = in_site(np.array([(tile.x_mm, tile.y_mm) for tile in tiles]), area.axes)
    cells = np.round(-moved / pitch, 6)  # a sample that was moved by +1 mm shows at x what lies at x - 1 in its frame
    low, high = np.floor(cells.min(axis=0)).astype(int), np.ceil(cells.max(axis=0)).astype(int)
    grid = Grid(
        rows=footprint.rows + int(high[1] - low[1]),
        columns=footprint.columns + int(high[0] - low[0]),
        pitch_mm=pitch,
        x0_mm=footprint.x0_mm + float(low[0]) * pitch,
        y0_mm=footprint.y0_mm + float(low[1]) * pitch,
    )
    return AreaPlan(area, tiles, footprint, grid)


def check_reach(plan: AreaPlan, grid: Grid, store: str | Path) -> None:
    """Refuse a plan of another area than a store's.

    Raises
    ------
    InputError
        Saying how far both reach.
    """
    field_mm = min(plan.footprint.shape) * plan.footprint.pitch_mm
    apart = np.abs(np.subtract(plan.grid.extent_mm, grid.extent_mm)).max()
    if apart > MOST_BEYOND * field_mm:
        ours, theirs = (
            f"{left:.1f} to {right:.1f} mm in x and {low:.1f} to {high:.1f} mm in y"
            for left, right, low, high in (plan.grid.extent_mm, grid.extent_mm)
        )
        raise InputError(
            f"area: its height maps would reach from {ours}, those of the store {store} reach from {theirs}: "
            "leave the area as it was, or give store.path another name"
        )
