"""Tiles that found their places become one height map: laid on a common raster, faded into each other, averaged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipelines import Grid, Scan
from pipelines import reconstruction as rec

__all__ = ["laid", "united"]

FADE = 32
"""Cells over which a tile fades at its border."""


def laid(scans: Sequence[Scan], placement: rec.Placement, centre_mm: tuple[float, float]) -> list[Scan]:
    """Put each tile on its own part of a common raster, in the sample's frame.

    Parameters
    ----------
    scans : sequence of Scan
        Of one pitch, each in the site frame of its rig.
    placement : Placement
        How far the sample had been moved at each.
    centre_mm : (float, float)
        Centre of any cell of the raster.
    """
    placed = []
    for scan, position in zip(scans, placement.position_mm, strict=True):
        matrix = np.eye(4)
        matrix[:3, 3] = -position
        placed.append(rec.regrid(scan, matrix, rec.covering_grid([scan], [matrix], scan.grid.pitch_mm, centre_mm)))
    return placed


def united(placed: Sequence[Scan], placement: rec.Placement, bow_mm: float, grid: Grid) -> rec.Merged:
    """Merge tiles that were laid; what lies beyond the grid is left out.

    Parameters
    ----------
    placed : sequence of Scan
        As `laid` gives them.
    placement : Placement
        Its uncertainties become part of each cell's sigma.
    bow_mm : float
        The part of the tiles' sigma that all of them share.
    grid : Grid
        Of the same raster.
    """
    fade = min(FADE, *(min(each.grid.shape) // 8 for each in placed))
    views = [
        rec.View(each, float(sigma[2]), float(sigma[0]), bow_mm, rec.edge_weight(each, fade))
        for each, sigma in zip(placed, placement.sigma_mm, strict=True)
    ]
    return rec.merge(views, grid)
