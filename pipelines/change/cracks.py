"""Cracks on a height map: valleys that are deep for their width, and the shadows between measured edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

from ..scan import Scan
from ..slabs import in_slabs
from .distance import inner_distance
from .extremes import greatest, least
from .parts import by_part, part_greatest, part_sums, parts, spread
from .ranks import median
from .smoothing import local_median
from .squares import grown, shrunk

__all__ = ["CrackRule", "crack_mask"]


@dataclass(frozen=True, slots=True)
class CrackRule:
    """What counts as a crack.

    Parameters
    ----------
    max_width_mm : float
        Wider valleys are relief.
    least_aspect : float
        Depth over width that a valley must reach.
    wall_slope : float
        Rise over run of a wall: the crack reaches as far up as its sides are at least this steep.
    noise : float
        Depth and wall must exceed this many standard uncertainties of the height.
    least_length_mm : float
        Smaller specks are dropped.
    least_elongation : float
        Length over width of a part; below it is a pit or a pebble's shadow.
    """

    max_width_mm: float = 1.2
    least_aspect: float = 0.5
    wall_slope: float = 2.0
    noise: float = 6.0
    least_length_mm: float = 0.8
    least_elongation: float = 5.0


LEAST_WALL = 0.8
"""Share of a crack's rim that is a wall: a dip between two bumps has gentle sides."""
EIGHT = np.ones((3, 3), dtype=np.bool_)


def crack_mask(scan: Scan, rule: CrackRule | None = None) -> npt.NDArray[np.bool_]:
    """Mark the cells that belong to a crack.

    A cell is a sure part of a crack where some window of width s (5 cells, doubling up to the greatest width)
    finds a valley deeper than ``least_aspect * s`` and than the noise: depth is the closing by a square of side s (the
    height that the valley's lower rim reaches) less the height. Cells not measured are a sure part where they are
    bounded by measured ones on two opposite sides no further apart than the greatest width, and touch a valley or
    form a long strip: a floor that the camera or the projector does not see. From there the crack grows over
    valley cells and up its walls, as far as they are steep. Parts that are short or not elongated are dropped.

    Parameters
    ----------
    scan : Scan
    rule : CrackRule, optional

    Returns
    -------
    ndarray of bool, shape (rows, columns)
    """
    rule = CrackRule() if rule is None else rule
    pitch = scan.grid.pitch_mm
    z = scan.height
    if not np.isfinite(z).any():
        return np.zeros(z.shape, dtype=np.bool_)
    noise = rule.noise * float(np.nan_to_num(median(scan.sigma)))

    widest = round(rule.max_width_mm / pitch)
    sure = np.zeros(z.shape, dtype=np.bool_)
    maybe = np.zeros(z.shape, dtype=np.bool_)
    deepest = np.zeros(z.shape, dtype=np.float32)
    top, side = z, 1
    for cells in _windows(widest):
        # the greatest of a window is that of smaller windows in it
        top, side = greatest(top, cells - side + 1), cells
        enough = max(noise, rule.least_aspect * cells * pitch)
        bounds = np.float32(enough), np.float32(max(noise, 0.5 * enough))
        given = z, least(top, cells), *bounds, deepest, sure, maybe
        in_slabs(len(z), lambda *rows, given=given: _deepened(*given, *rows), least=256)
    hidden, asymmetry = _hidden(z, widest, pitch)
    sure |= _strips(hidden, asymmetry, sure, rule, pitch)
    core = spread(sure, sure | maybe)
    # up the walls, but not away along a step: a step is thin where a wall that needs more than two cells is not
    steep = np.zeros(z.shape, dtype=np.bool_)
    for reach in (1, 2):  # one cell finds the top of a wall, two find it in noise
        steep |= greatest(z, 2 * reach + 1) - z > max(noise, rule.wall_slope * reach * pitch)
    thick = grown(shrunk(steep | core)) & steep
    near = grown(core, 2) & steep
    reach = max(2, round(rule.max_width_mm / 4 / pitch))
    found = spread(core, core | thick | near, reach)
    found = _long_parts(_without_pinholes(found), rule, pitch)
    found = _below_ground(found, z, deepest, 2 * widest | 1)
    return _walled(found, steep, np.isfinite(z))


@njit(cache=True, nogil=True)
def _deepened(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    z, closed, enough, half, deepest, sure, maybe, first, last
):
    """Take one window's valleys in: how far each cell lies below the lower rim."""
    for i in range(first, last):
        for j in range(z.shape[1]):
            depth = closed[i, j] - z[i, j]  # NaN where not measured: deeper than nothing
            deepest[i, j] = depth if depth > deepest[i, j] else deepest[i, j]
            sure[i, j] |= depth > enough
            maybe[i, j] |= depth > half


def _walled(
    mask: npt.NDArray[np.bool_], steep: npt.NDArray[np.bool_], measured: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Drop the parts that end gently: less than LEAST_WALL of their rim is steep or beside a floor not seen."""
    labels, count = parts(mask, diagonal=True)
    if count == 0:
        return mask
    rim = mask & grown(~mask)
    sharp = rim & (steep | grown(mask & ~measured))
    keep = part_sums(labels, count, sharp) >= LEAST_WALL * part_sums(labels, count, rim)
    return by_part(labels, keep)


def _below_ground(
    mask: npt.NDArray[np.bool_], z: npt.NDArray[np.float32], depth: npt.NDArray[np.float32], window: int
) -> npt.NDArray[np.bool_]:
    """Drop the parts whose floor is level with the ground around: a gap between two bumps, not a crack.

    The floor (cells deeper than half the part's deepest) must lie below the median of a wide window by half its
    depth. A part whose floor was not seen is kept.
    """
    labels, count = parts(mask, diagonal=True)
    if count == 0:
        return mask
    known = np.where(np.isfinite(z), depth, np.float32(0))  # a floor is deeper than that
    floor = known > 0.5 * by_part(labels, part_greatest(labels, count, known))
    low, deep = part_sums(labels, count, local_median(z, window) - z, floor), part_sums(labels, count, known, floor)
    return by_part(labels, (deep == 0) | (low > 0.5 * deep))


def _without_pinholes(mask: npt.NDArray[np.bool_], most: int = 25) -> npt.NDArray[np.bool_]:
    """Fill holes of at most `most` cells: noise on a crack's floor, not an island."""
    outside = ~mask
    labels, count = parts(outside, diagonal=False)
    return mask | by_part(labels, part_sums(labels, count, outside) <= most)


def _strips(
    hidden: npt.NDArray[np.bool_],
    asymmetry: npt.NDArray[np.float32],
    valleys: npt.NDArray[np.bool_],
    rule: CrackRule,
    pitch: float,
) -> npt.NDArray[np.bool_]:
    """Missing parts that are a crack's unseen floor, and not a bump's shadow or a dropout.

    They lie beside a valley for a fifth of their rim, or are long and thin: 6 times, where both rims are about
    level (a bump's shadow has its higher side over the lower), 10 times in any case.
    """
    labels, count = ndimage.label(hidden, structure=EIGHT)
    if count == 0:
        return hidden
    area = np.bincount(labels.ravel(), minlength=count + 1).astype(np.float64)
    width, length = _width_and_length(labels, count, area)
    rim = ndimage.grey_dilation(labels, size=(3, 3)) * ~hidden
    around = np.bincount(rim.ravel(), minlength=count + 1)
    beside = np.bincount(rim[valleys], minlength=count + 1)
    tilt = np.bincount(labels.ravel(), weights=asymmetry.ravel(), minlength=count + 1) / np.maximum(area, 1)
    thin = (length > 10 * width) | ((length > 6 * width) & (tilt < 0.5))
    keep = (beside > 0.2 * around) & (area > 4) | thin & (length * pitch > rule.least_length_mm)
    keep[0] = False
    return keep[labels]  # type: ignore[no-any-return]  # scipy ships no types


def _long_parts(mask: npt.NDArray[np.bool_], rule: CrackRule, pitch: float) -> npt.NDArray[np.bool_]:
    """Drop the parts that are short or not elongated, as they are on a map mirrored at its borders.

    A part at the border was cut by it: its mirror image stands for what is beyond, of one in a corner twice.
    """
    labels, count = ndimage.label(mask, structure=EIGHT)
    if count == 0:
        return mask
    area = np.bincount(labels.ravel(), minlength=count + 1).astype(np.float64)
    for one, other in ((labels[0], labels[-1]), (labels[:, 0], labels[:, -1])):
        area[np.unique(np.concatenate([one, other]))] *= 2
    width, length = _width_and_length(labels, count, area)
    keep = (length * pitch >= rule.least_length_mm) & (length >= rule.least_elongation * width)
    keep[0] = False
    return keep[labels]  # type: ignore[no-any-return]  # scipy ships no types


def _width_and_length(
    labels: npt.NDArray[np.int32], count: int, area: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Width and length of each part of an area, cells: a strip of width w has a mean distance to its edge of w / 4."""
    inside = inner_distance(labels > 0)
    total = np.bincount(labels.ravel(), weights=inside.ravel(), minlength=count + 1)
    width = np.maximum(1.0, 4 * total / np.maximum(np.bincount(labels.ravel(), minlength=count + 1), 1) - 1)
    return width, area / width


def _windows(widest: int) -> list[int]:
    sizes = [5]
    while sizes[-1] * 2 < widest:
        sizes.append(sizes[-1] * 2 + 1)
    if widest | 1 > sizes[-1]:
        sizes.append(widest | 1)
    return sizes


def _hidden(
    z: npt.NDArray[np.float32], widest: int, pitch: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
    """Missing cells with measured ones on both sides, along a row or a column, at most `widest` cells apart.

    With them, for each, how far the two sides differ in height over how far they are apart; 0 elsewhere.
    """
    hidden = np.zeros(z.shape, dtype=np.bool_)
    asymmetry = np.zeros(z.shape, dtype=np.float32)
    shortest = np.full(z.shape, widest + 1, dtype=np.int32)
    given = z, widest, pitch, hidden, asymmetry, shortest
    in_slabs(z.shape[1], lambda first, last: _hidden_along_columns(*given, first, last))
    in_slabs(z.shape[0], lambda first, last: _hidden_along_rows(*given, first, last))
    return hidden, asymmetry


@njit(cache=True, nogil=True)
def _hidden_along_columns(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    z, widest, pitch, hidden, asymmetry, shortest, first, last
):
    seen = np.full(last - first, -1)
    for i in range(z.shape[0]):
        for j in range(first, last):
            if not np.isfinite(z[i, j]):
                continue
            before, gap = seen[j - first], i - seen[j - first] - 1
            seen[j - first] = i
            if before < 0 or gap < 1 or gap > widest:
                continue
            for k in range(before + 1, i):
                hidden[k, j] = True
                if gap < shortest[k, j]:
                    asymmetry[k, j] = abs(z[i, j] - z[before, j]) / (gap * pitch)
                    shortest[k, j] = gap


@njit(cache=True, nogil=True)
def _hidden_along_rows(  # type: ignore[no-untyped-def]  # as above
    z, widest, pitch, hidden, asymmetry, shortest, first, last
):
    for i in range(first, last):
        before = -1
        for j in range(z.shape[1]):
            if not np.isfinite(z[i, j]):
                continue
            gap = j - before - 1
            if before >= 0 and 1 <= gap <= widest:
                for k in range(before + 1, j):
                    hidden[i, k] = True
                    if gap < shortest[i, k]:
                        asymmetry[i, k] = abs(z[i, j] - z[i, before]) / (gap * pitch)
            before = j
