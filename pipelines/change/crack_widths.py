"""How wide a crack is, point by point: the distance between its two edges on profiles across it, sub-cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..scan import Scan
from .crack_lines import CrackLines, crack_lines
from .cracks import CrackRule, crack_mask

__all__ = ["CrackOpenings", "crack_openings"]

STEP = 0.5
"""Distance of samples along a profile, cells."""
RIM_CELLS = 1.0, 5.0
"""The rim is the median height between these distances outside the mask's edge, cells."""
DROP_SHARE = 0.05
"""An edge is where the surface is this share of the crack's depth below its own rim."""
DROP_SIGMAS = 3.0


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
        Share of the edges that missing cells bound, 0 to 1: known to a cell, not to a part of one.
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
    right up to the rim (an unseen floor, an overhanging lip), the edge is where measurement begins. The two rims
    may stand at different heights: the opening is the horizontal gap that a viewer from above sees.

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
    sampled = [_profiles(scan.height, mask, row, column, sign * normal, distance) for sign in (1.0, -1.0)]
    floor = np.minimum(*[np.nanmin(np.where(inside, z, np.inf), axis=1) for z, inside in sampled])
    for z, inside in sampled:
        edge, sigma, crossed = _edge(z, inside, floor, distance, sigma_z)
        unseen.append(1.0 - float(crossed.mean()))
        edges.append(edge)
        sigmas.append(sigma)
    width = (edges[0] + edges[1]) * pitch
    middle = 0.5 * (edges[0] - edges[1])
    x = scan.grid.x0_mm + (column + middle * normal[:, 0]) * pitch
    y = scan.grid.y0_mm + (row + middle * normal[:, 1]) * pitch
    return CrackOpenings(x, y, width, np.hypot(*sigmas) * pitch, step, float(np.mean(unseen)), lines)


def _profiles(
    height: npt.NDArray[np.float32],
    mask: npt.NDArray[np.bool_],
    row: npt.NDArray[np.float64],
    column: npt.NDArray[np.float64],
    normal: npt.NDArray[np.float64],
    distance: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Heights and mask along rays, shape (points, samples): bilinear over measured cells, NaN where the nearest is."""
    at = np.stack([row[:, None] + normal[:, 1, None] * distance, column[:, None] + normal[:, 0, None] * distance])
    nearest = np.rint(at).astype(np.intp)
    outside = (nearest < 0).any(axis=0) | (nearest[0] >= height.shape[0]) | (nearest[1] >= height.shape[1])
    nearest[:, outside] = 0
    good = np.isfinite(height)
    weight = ndimage.map_coordinates(good.astype(np.float32), at, order=1, mode="nearest")
    total = ndimage.map_coordinates(np.where(good, height, np.float32(0)), at, order=1, mode="nearest")
    seen = good[nearest[0], nearest[1]] & ~outside & (weight > 0)
    z = np.where(seen, total / np.maximum(weight, 1e-6), np.nan)
    return z, mask[nearest[0], nearest[1]] & ~outside


def _edge(
    z: npt.NDArray[np.float64],
    inside: npt.NDArray[np.bool_],
    floor: npt.NDArray[np.float64],
    distance: npt.NDArray[np.float64],
    sigma_z: float,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Distance of the edge along each ray and its standard uncertainty, cells; NaN where there is none.

    With them, whether the surface was seen to cross the level; otherwise measurement just begins there.
    """
    count, samples = z.shape
    lead = np.arange(samples)
    # first sample at which the ray has left the mask
    left = np.where((~inside).any(axis=1), np.argmax(~inside, axis=1), samples)
    beyond = (lead >= (left + RIM_CELLS[0] / STEP)[:, None]) & (lead <= (left + RIM_CELLS[1] / STEP)[:, None])
    rim_cells = np.where(beyond & ~inside, z, np.nan)
    known = np.isfinite(rim_cells).sum(axis=1) >= 3
    rim = np.full(count, np.nan)
    rim[known] = np.nanmedian(rim_cells[known], axis=1)
    depth = np.where(np.isfinite(floor), rim - floor, 0.0)
    level = rim - np.maximum(DROP_SHARE * depth, DROP_SIGMAS * sigma_z)
    up = np.isfinite(z) & (z >= level[:, None]) & (lead >= (left - 4 / STEP)[:, None])
    found = up.any(axis=1) & known
    first = np.argmax(up, axis=1)
    take = np.arange(count)
    before = np.maximum(first - 1, 0)
    low, high = z[take, before], z[take, first]
    crossing = np.isfinite(low) & (low < level) & (first > 0)
    rise = np.where(crossing, high - low, np.nan)
    share = np.where(crossing, (level - low) / rise, 0.5)
    edge = distance[before] + share * STEP
    middle = 0.5 * (rim + np.where(np.isfinite(floor), floor, rim))
    edge = np.minimum(
        _without_ramp(edge, z, first, level, middle, rim, distance), _along_wall(edge, z, first, level, distance)
    )
    # a wall of slope m turns sigma_z into sigma_z / m; where measurement just begins, the edge is somewhere in a cell
    sigma = np.where(crossing, np.minimum(sigma_z / np.maximum(rise, 1e-9) * STEP, 1.0), 1 / np.sqrt(12))
    edge[~found] = np.nan
    return edge, np.where(found, sigma, np.nan), crossing


def _along_wall(
    edge: npt.NDArray[np.float64],
    z: npt.NDArray[np.float64],
    first: npt.NDArray[np.intp],
    level: npt.NDArray[np.float64],
    distance: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Draw the edge in to where the wall, carried on from inside as steep as it is there, meets the level.

    The cell in which a wall ends says only that it ends there; the two cells before say how steep it is.
    """
    cell = round(1 / STEP)
    take = np.arange(z.shape[0])
    inner = np.maximum(first - cell, 0)
    low, lower = z[take, inner], z[take, np.maximum(first - 2 * cell, 0)]
    with np.errstate(divide="ignore", invalid="ignore"):
        carried = distance[inner] + (level - low) / (low - lower)
    usable = (first >= 2 * cell) & (low > lower) & (low < level) & (carried < edge)
    return np.where(usable, carried, edge)


def _without_ramp(
    edge: npt.NDArray[np.float64],
    z: npt.NDArray[np.float64],
    first: npt.NDArray[np.intp],
    level: npt.NDArray[np.float64],
    middle: npt.NDArray[np.float64],
    rim: npt.NDArray[np.float64],
    distance: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Take off what interpolation adds to a wall that is steeper than a cell can show.

    Between the last low cell and the first high one a vertical wall becomes a ramp one cell long, whose middle is the
    wall's place. The distance from the wall's half height to its rim is shortened by the ramp's, in quadrature: all
    of it for a vertical wall, next to nothing for one several cells wide.
    """
    count, samples = z.shape
    lead = np.arange(samples)
    inner = lead < first[:, None]

    def last(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
        found: npt.NDArray[np.intp] = np.where(mask, lead, -1).max(axis=1)
        return found

    low, gap = last(inner & (z < middle[:, None])), last(inner & ~np.isfinite(z))
    seen = low > gap
    take = np.arange(count)
    at = np.clip(low, 0, samples - 2)
    below, above = z[take, at], z[take, at + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        half = distance[at] + (middle - below) / (above - below) * STEP
        ramp = np.clip((level - middle) / (2 * (rim - middle)), 0, 0.5)
        wall = edge - half
        shorter = half + np.sqrt(np.maximum(0.0, wall**2 - ramp**2))
    return np.where(seen & np.isfinite(shorter) & (wall > 0), shorter, edge)
