"""How wide a crack is, point by point: the distance between its two edges on profiles across it, sub-cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from .crack_edges import RIM_CELLS, STEP, crack_edges
from .crack_lines import CrackLines, crack_lines
from .crack_profiles import crack_profiles
from .crack_shadows import shadow_edges
from .cracks import CrackRule, crack_mask

__all__ = ["CrackOpenings", "crack_openings", "opening_sigma"]

SLANTED, SLANTED_CELLS = 1.5, 3.0
"""A profile longer than so many widths of the mask, and so many cells, does not lie across the crack."""


@dataclass(frozen=True, slots=True, eq=False)
class CrackOpenings:
    """Local widths of the cracks of one scan.

    Parameters
    ----------
    x_mm, y_mm : ndarray of float64, shape (n,)
        Middle between the two edges, site frame.
    opening_mm : ndarray of float64, shape (n,)
        Distance between the edges as seen from above; NaN where an edge was not found.
    sigma_mm : ndarray of float64, shape (n,)
        Standard uncertainty of one local width.
    step_mm : ndarray of float64, shape (n,)
        Length of crack that each point stands for.
    unseen_edges : float
        Share of the edges that missing cells bound and no light tells, 0 to 1: known to a cell, not to a part of one.
    lines : CrackLines
        All centre lines; the points above are those of them that are clear of junctions and ends.
    """

    x_mm: npt.NDArray[np.float64]
    y_mm: npt.NDArray[np.float64]
    opening_mm: npt.NDArray[np.float64]
    sigma_mm: npt.NDArray[np.float64]
    step_mm: npt.NDArray[np.float64]
    unseen_edges: float
    lines: CrackLines


def crack_openings(
    scan: Scan,
    mask: npt.NDArray[np.bool_] | None = None,
    *,
    across: tuple[float, float] | None = None,
    rule: CrackRule | None = None,
) -> CrackOpenings:
    """Measure cracks across their centre lines.

    On a profile through each point of the centre line the surface is followed from the middle outward on both
    sides. An edge is the first place where it comes within max(5 % of the depth, 3 sigma) of that side's own rim, the
    median height 1 to 5 cells beyond the mask; linear between samples half a cell apart, drawn in to where the
    wall's own slope leads and by the ramp that a cell makes of a vertical wall. Where cells are missing
    right up to the rim (an unseen floor, an overhanging lip), the edge is where the texture falls to half of the rim's
    light, and where it does not, where measurement begins. The two rims may stand at different heights: the opening is
    the horizontal gap that a viewer from above sees.

    Parameters
    ----------
    scan : Scan
    mask : ndarray of bool, shape (rows, columns), optional
        As `crack_mask` gives it; computed if left out.
    across : (x, y), optional
        Fixed direction of the profiles; perpendicular to the centre line if left out.
    rule : CrackRule, optional

    Returns
    -------
    CrackOpenings
    """
    rule = CrackRule() if rule is None else rule
    mask = crack_mask(scan, rule) if mask is None else mask
    lines = crack_lines(mask)
    # a fixed direction crosses the crack up to its very end, where the perpendicular of the skeleton turns away
    use = lines.inner if across is None else lines.off_junction
    pitch = scan.grid.pitch_mm
    row, column, step = lines.row[use], lines.column[use], lines.step[use] * pitch
    normal = lines.normal[use]
    if across is not None:
        normal = np.broadcast_to(np.asarray(across, dtype=np.float64) / np.hypot(*across), normal.shape)
    if row.size == 0:
        empty = np.zeros(0)
        return CrackOpenings(empty, empty, empty, empty, empty, 0.0, lines)
    reach = rule.max_width_mm / pitch * (1.0 if across is None else 1.5) + RIM_CELLS[1]
    distance = np.arange(0.0, reach + STEP, STEP)
    edges, sigmas, unseen = [], [], []
    sigma_z = float(np.nanmedian(scan.sigma)) if np.isfinite(scan.sigma).any() else 0.0
    light = np.where(np.isfinite(scan.height), scan.texture, np.float32(np.nan))
    ways = [sign * normal for sign in (1.0, -1.0)]
    sampled = [crack_profiles(scan.height, mask, row, column, way, distance) for way in ways]
    floor = np.minimum(*[np.nanmin(np.where(inside, z, np.inf), axis=1) for z, inside in sampled])
    for way, (z, inside) in zip(ways, sampled, strict=True):
        edge, sigma, known = crack_edges(z, inside, floor, sigma_z)
        dark = ~known
        if dark.any():
            lit, _ = crack_profiles(light, mask, row[dark], column[dark], way[dark], distance)
            by_light = shadow_edges(lit, inside[dark], edge[dark])
            known[dark] = np.isfinite(by_light)
            edge[dark] = np.where(known[dark], by_light, edge[dark])
        unseen.append(1.0 - float(known.mean()))
        edges.append(edge)
        sigmas.append(sigma)
    cells = edges[0] + edges[1]
    if across is None:
        # half the mask's width is the circle that fits in: a profile so much longer runs along the crack, into a fork
        cells[cells > SLANTED * 2 * lines.half_width[use] + SLANTED_CELLS] = np.nan
    width = cells * pitch
    middle = 0.5 * (edges[0] - edges[1])
    x = scan.grid.x0_mm + (column + middle * normal[:, 0]) * pitch
    y = scan.grid.y0_mm + (row + middle * normal[:, 1]) * pitch
    return CrackOpenings(x, y, width, np.hypot(*sigmas) * pitch, step, float(np.mean(unseen)), lines)


def opening_sigma(
    openings: CrackOpenings, pitch_mm: float, where: npt.NDArray[np.bool_] | slice = slice(None)
) -> float:
    """Standard uncertainty of the mean opening of some points: the profiles' own, and what the raster leaves, mm."""
    sigma, known = openings.sigma_mm[where], np.isfinite(openings.opening_mm[where])
    # profiles closer than 5 cells read the same cells
    independent = max(1.0, float(known.sum()) / 5)
    random = float(np.sqrt(np.mean(sigma[known] ** 2) / independent)) if known.any() else pitch_mm
    # whatever the noise, a seen edge is known to half a cell and one where measurement just begins to a cell (both
    # uniform), the same way all along the crack: no averaging helps
    raster = pitch_mm * np.sqrt(2 * ((1 - openings.unseen_edges) / 12 + openings.unseen_edges / 3))
    return float(np.hypot(random, raster))
