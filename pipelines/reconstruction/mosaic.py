"""Tiles of a large area: where each lies, from the offsets between neighbours, and how well they meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csgraph

from ..scan import Scan

__all__ = ["Offset", "Placement", "Seam", "place_tiles", "seam_between"]

Floats = npt.NDArray[np.float64]
ROUNDS = 30
TUKEY = 4.685
LEAST_WEIGHT = 0.1
LEAST_SEAM_CELLS = 50


@dataclass(frozen=True, slots=True)
class Offset:
    """How far one tile lies from another: position of `second` less that of `first`, mm, and how sure that is."""

    first: int
    second: int
    shift_mm: tuple[float, float, float]
    sigma_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the tiles lie.

    Parameters
    ----------
    position_mm : ndarray of float64, shape (tiles, 3)
        The first tile stays where it was commanded to.
    sigma_mm : ndarray of float64, shape (tiles, 3)
        Standard uncertainty against the first tile.
    weight : ndarray of float64, shape (offsets,)
        1 for an offset that the others confirm, down to 0 for one that contradicts them.
    residual_mm : ndarray of float64, shape (offsets, 3)
        Offset less the difference of the adjusted positions.
    group : ndarray of int, shape (tiles,)
        Tiles that offsets which count join have the same number; between groups only the stage's coordinates tell.
    """

    position_mm: Floats
    sigma_mm: Floats
    weight: Floats
    residual_mm: Floats
    group: npt.NDArray[np.int32]

    @property
    def counts(self) -> npt.NDArray[np.bool_]:
        """Which offsets count: the others contradict them."""
        return self.weight > LEAST_WEIGHT


@dataclass(frozen=True, slots=True)
class Seam:
    """How two placed tiles meet: second less first over their common cells; NaN where fewer than 50 are common."""

    cells: int
    bias_mm: float
    sd_mm: float
    """Robust: 1.4826 times the median absolute deviation."""
    over_sigma: float
    """Robust sd of the difference over what the tiles' sigmas predict: 1 where these are right."""


def place_tiles(
    commanded_mm: Floats, offsets: Sequence[Offset], stage_sigma_mm: tuple[float, float, float]
) -> Placement:
    """Adjust the positions of all tiles to the offsets between neighbours, by robust least squares.

    The commanded positions are observations too, as uncertain as the stage is: they decide for a tile that no offset
    reaches, and hardly count elsewhere. Offsets that contradict the others lose their weight (Tukey's biweight,
    begun at the solution of least absolute deviations). Where offsets scatter more than their sigmas say, the
    uncertainties grow by that factor.

    Parameters
    ----------
    commanded_mm : ndarray of float64, shape (tiles, 3)
    offsets : sequence of Offset
    stage_sigma_mm : (float, float, float)
        Standard uncertainty of a commanded position along x, y, z.

    Returns
    -------
    Placement
    """
    tiles = len(commanded_mm)
    count = len(offsets)
    first = np.array([one.first for one in offsets], dtype=np.intp)
    second = np.array([one.second for one in offsets], dtype=np.intp)
    shift = np.array([one.shift_mm for one in offsets], dtype=np.float64).reshape(count, 3)
    sigma = np.array([one.sigma_mm for one in offsets], dtype=np.float64).reshape(count, 3)
    redundant = 3 * (count - tiles + len(set(_groups(tiles, first, second).tolist())))
    weight = np.ones(count)
    position, spread = commanded_mm.astype(np.float64), np.zeros((tiles, 3))
    residual = np.zeros((count, 3))
    for turn in range(ROUNDS if redundant > 0 else 1):
        before = position
        position, spread = _solve(commanded_mm, stage_sigma_mm, first, second, shift, sigma, weight)
        residual = shift - (position[second] - position[first])
        if redundant <= 0:
            break
        size = np.sqrt(((residual / sigma) ** 2).mean(axis=1))
        # residuals of a fit are smaller than the errors: by the share of observations that is not fitted
        scale = max(1.0, float(np.median(size)) * np.sqrt(3 * count / redundant))
        if turn < ROUNDS // 3:
            weight = 1 / np.maximum(size / scale, 1.0)
        else:
            weight = np.maximum(1 - (size / (TUKEY * scale)) ** 2, 0) ** 2
            if np.abs(position - before).max() < 1e-7:
                break
    kept = weight > LEAST_WEIGHT
    if redundant > 0 and count:
        chi2 = float(((residual[kept] / sigma[kept]) ** 2).sum()) / max(1, redundant - 3 * int((~kept).sum()))
        spread = spread * max(1.0, np.sqrt(chi2))
    return Placement(position, spread, weight, residual, _groups(tiles, first[kept], second[kept]))


def _groups(tiles: int, first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]) -> npt.NDArray[np.int32]:
    """Number the sets of tiles that pairs join."""
    joins = np.zeros((tiles, tiles), dtype=np.bool_)
    joins[first, second] = True
    group: npt.NDArray[np.int32] = csgraph.connected_components(joins, directed=False)[1]
    return group


def _solve(
    commanded: Floats,
    stage_sigma: tuple[float, float, float],
    first: npt.NDArray[np.intp],
    second: npt.NDArray[np.intp],
    shift: Floats,
    sigma: Floats,
    weight: Floats,
) -> tuple[Floats, Floats]:
    """Positions and their standard uncertainties against the first tile, each axis for itself."""
    tiles = len(commanded)
    position, spread = np.zeros((tiles, 3)), np.zeros((tiles, 3))
    for axis in range(3):
        normal = np.diag(np.full(tiles, 1 / stage_sigma[axis] ** 2))
        right = commanded[:, axis] / stage_sigma[axis] ** 2
        strength = weight / sigma[:, axis] ** 2
        np.add.at(normal, (first, first), strength)
        np.add.at(normal, (second, second), strength)
        np.add.at(normal, (first, second), -strength)
        np.add.at(normal, (second, first), -strength)
        np.add.at(right, second, strength * shift[:, axis])
        np.add.at(right, first, -strength * shift[:, axis])
        position[0, axis] = commanded[0, axis]
        if tiles > 1:
            position[1:, axis] = np.linalg.solve(normal[1:, 1:], right[1:] - normal[1:, 0] * commanded[0, axis])
            spread[1:, axis] = np.sqrt(np.diag(np.linalg.inv(normal[1:, 1:])))
    return position, spread


def seam_between(first: Scan, second: Scan) -> Seam:
    """Compare two placed tiles over their common cells.

    Parameters
    ----------
    first, second : Scan
        On grids whose cells fall on each other.
    """
    pitch = first.grid.pitch_mm
    row = round((second.grid.y0_mm - first.grid.y0_mm) / pitch)
    column = round((second.grid.x0_mm - first.grid.x0_mm) / pitch)
    rows = slice(max(row, 0), min(first.grid.rows, row + second.grid.rows))
    columns = slice(max(column, 0), min(first.grid.columns, column + second.grid.columns))
    nan = float("nan")
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return Seam(0, nan, nan, nan)
    there = (slice(rows.start - row, rows.stop - row), slice(columns.start - column, columns.stop - column))
    difference = second.height[there].astype(np.float64) - first.height[rows, columns]
    both = np.isfinite(difference)
    if both.sum() < LEAST_SEAM_CELLS:
        return Seam(int(both.sum()), nan, nan, nan)
    expected = np.hypot(second.sigma[there], first.sigma[rows, columns])[both]
    difference = difference[both]
    bias = float(np.median(difference))
    away = np.abs(difference - bias)
    ratio = 1.4826 * float(np.median(away / expected)) if np.isfinite(expected).all() else nan
    return Seam(int(both.sum()), bias, 1.4826 * float(np.median(away)), ratio)
