"""Scales: what all scans of a review are drawn by, so that a colour means the same from the first to the last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines import Grid
from storage import Store, Stored

from .raster import Range, height_ends, round_limit, shrink_factor

__all__ = ["FULL", "OVERVIEW", "Detail", "Scales", "choose_scales", "sample", "still_fit"]


@dataclass(frozen=True, slots=True)
class Detail:
    """How fine scans are drawn: at most so many vertices of a surface, and cells of a map."""

    vertices: int
    cells: int


OVERVIEW = Detail(40_000, 250_000)
"""What a year of scans is looked through with: 3 MB a scan of 1000x1000."""

FULL = Detail(250_000, 4_000_000)
"""For chosen scans: every cell of 1000x1000."""


@dataclass(frozen=True, slots=True)
class Scales:
    """What colours and sizes mean.

    Parameters
    ----------
    grid : Grid
    height : Range
        Ends of the height scale, mm.
    change_limit_mm : float
        Ends of the change scale, mm; 0 where no scan has a change.
    sigma_limit_mm : float
        Upper end of the uncertainty scale, mm.
    exaggeration : float
        How many times heights are drawn taller than they are.
    detail : Detail
    """

    grid: Grid
    height: Range
    change_limit_mm: float
    sigma_limit_mm: float
    exaggeration: float
    detail: Detail = OVERVIEW

    @property
    def factor(self) -> int:
        """Cells along one side of a map's pixel."""
        return shrink_factor(self.grid.rows, self.grid.columns, self.detail.cells)

    @property
    def map_shape(self) -> tuple[int, int]:
        """Rows and columns of a map on the screen."""
        return -(-self.grid.rows // self.factor), -(-self.grid.columns // self.factor)

    def to_json(self) -> dict[str, Any]:
        """Give what `from_json` reads."""
        return asdict(self)

    @staticmethod
    def from_json(kept: dict[str, Any]) -> Scales:
        """Read what `to_json` gave. Raises KeyError, TypeError or ValueError of anything else."""
        made = {"grid": Grid, "height": Range, "detail": Detail}
        return Scales(**{name: made[name](**value) if name in made else value for name, value in kept.items()})


def sample(store: Store) -> list[Stored]:
    """Give the first, the middle and the newest scan: what scales are chosen by."""
    total = len(store)
    return [store[number] for number in sorted({0, total // 2, total - 1})]


def choose_scales(chosen: Sequence[Stored], detail: Detail = OVERVIEW) -> Scales:
    """Choose scales that hold for scans such as some chosen ones, of which the last is the newest."""
    span = height_ends(np.concatenate([_some(stored.scan.height) for stored in chosen]))
    moved = max((_moved(stored) for stored in chosen), default=0.0)
    sigmas = np.concatenate([_some(stored.scan.sigma) for stored in chosen])
    grid = chosen[-1].scan.grid
    return Scales(
        grid,
        span,
        round_limit(moved) if any(stored.change is not None for stored in chosen) else 0.0,
        round_limit(float(np.percentile(sigmas, 95)) if sigmas.size else 0.0),
        _exaggeration(span, grid.extent_mm),
        detail,
    )


def still_fit(scales: Scales, newest: Stored) -> bool:
    """Whether the scales that earlier scans were drawn by can show the newest one too.

    Colours are part of what was drawn: where a campaign outgrows its scale by half a height scale or by twice
    the change, all of it is drawn again; that happens a few times in its life.
    """
    if newest.scan.grid != scales.grid:
        return False
    if newest.change is not None and _moved(newest) > 2 * scales.change_limit_mm:
        return False
    heights = _some(newest.scan.height)
    if not heights.size:
        return True
    low, high = np.percentile(heights, (2, 98))
    slack = 0.5 * (scales.height.high - scales.height.low)
    return bool(low >= scales.height.low - slack and high <= scales.height.high + slack)


def _some(cells: Any) -> Any:
    """Measured cells, every one of a small map and some 100,000 of a large one."""
    step = max(1, int(np.sqrt(cells.size / 100_000)))
    thin = cells[::step, ::step]
    return thin[np.isfinite(thin)]


def _moved(stored: Stored) -> float:
    """How far 95 % of the cells have moved at most, mm."""
    moved = np.abs(_some(stored.change.dz)) if stored.change is not None else np.zeros(0)
    return float(np.percentile(moved, 95)) if moved.size else 0.0


def _exaggeration(span: Range, extent: tuple[float, float, float, float]) -> float:
    """How much taller to draw heights so that relief is seen: a tenth of the width, at most 50 times."""
    wanted = 0.1 * max(extent[1] - extent[0], extent[3] - extent[2]) / (span.high - span.low)
    return float(max((step for step in (1, 2, 5, 10, 20, 50) if step <= wanted), default=1))
