"""Objects that stand on a surface: what rises above the substrate, each with place, footprint and volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

from ..grid import Grid
from ..scan import Scan
from ..slabs import in_slabs
from .parts import parts
from .ranks import median
from .smoothing import local_mean
from .squares import grown, shrunk
from .substrate import Substrate
from .values import Measurement

__all__ = ["Expected", "ObjectRule", "StandingObject", "find_objects"]

BESIDE_MM = 0.1
"""An object is expected in the part that is no farther from its place."""
SHARED_ERROR_CELLS = 9.0
"""Neighbouring cells that share each error of a height (as for volumes)."""
BODY = 0.25
"""What rises above this share of an object's height tells where its middle is."""
SWEEPS = 60
"""So many rounds fill what a steep side hides, some ten cells wide."""


@dataclass(frozen=True, slots=True)
class ObjectRule:
    """What counts as an object.

    Parameters
    ----------
    least_height_mm : float
        Its top rises so far above the substrate.
    least_area_mm2 : float
        Smaller ones are dropped.
    noise : float
        Its cells rise by so many standard uncertainties, of the mean over 3 x 3 cells.
    """

    least_height_mm: float = 0.05
    least_area_mm2: float = 0.03
    noise: float = 3.0


@dataclass(frozen=True, slots=True)
class Expected:
    """Where an object is expected and how it lies: the middle, mm, and the second moments of its footprint, mm2."""

    x_mm: float
    y_mm: float
    xx_mm2: float
    xy_mm2: float
    yy_mm2: float


@dataclass(frozen=True, slots=True)
class StandingObject:
    """One object on a surface, at one time.

    Parameters
    ----------
    label : int
        Its number in the labels.
    x_mm, y_mm : float
        Its middle, site frame: the centre of mass of what rises above a quarter of its height. Farther down noise,
        shadow, and what was since eaten of the ground beside it decide where the rim is.
    z_mm : float
        Height of its top.
    height_mm : float
        Top above the substrate, a mean over 3 x 3 cells.
    area_mm2, volume_mm3 : Measurement
        Footprint; what lies between its surface and the substrate.
    length_mm, width_mm : float
        Axes of the ellipse with the footprint's second moments.
    axis : float
        Direction of the long one, radians from +x, -pi/2 to pi/2.
    moments_mm2 : (float, float, float)
        Second moments xx, xy, yy of the footprint.
    at_border : bool
        It reaches the border of the grid: there may be more of it.
    expected : int or None
        Which of the expected ones it is, if it was cut by their places.
    """

    label: int
    x_mm: float
    y_mm: float
    z_mm: float
    height_mm: float
    area_mm2: Measurement
    volume_mm3: Measurement
    length_mm: float
    width_mm: float
    axis: float
    moments_mm2: tuple[float, float, float]
    at_border: bool
    expected: int | None = None


def find_objects(
    scan: Scan, substrate: Substrate, rule: ObjectRule | None = None, expected: Sequence[Expected] = ()
) -> tuple[npt.NDArray[np.int32], tuple[StandingObject, ...]]:
    """Tell apart the objects that stand on a substrate.

    Cells whose 3 x 3 mean rises above the substrate by more than the noise form parts, eight-connected; cells not
    measured inside a part (the side in shadow) belong to it and take its mean height. A part in which
    several expected objects lie is several that touch: each of its cells goes to the one to whose ellipse it is nearest
    (Mahalanobis distance).

    Parameters
    ----------
    scan : Scan
    substrate : Substrate
        On the same grid.
    rule : ObjectRule, optional
    expected : sequence of Expected
        Where objects are expected, from the scans before.

    Returns
    -------
    labels : ndarray of int32, shape (rows, columns)
        0 where no object is.
    objects : tuple of StandingObject
        Largest volume first.

    Raises
    ------
    ValueError
        If scan and substrate are not on one grid.
    """
    rule = ObjectRule() if rule is None else rule
    if substrate.level.shape != scan.height.shape:
        raise ValueError(f"a scan of {scan.height.shape} cells, but the substrate has {substrate.level.shape}")
    rise, sigma = (np.empty(scan.height.shape, dtype=np.float32) for _ in range(2))
    given = scan.height, substrate.level, scan.sigma, substrate.sigma, rise, sigma
    in_slabs(len(rise), lambda first, last: _risen(*given, first, last), least=256)
    smooth = local_mean(rise, 3)
    typical = float(np.nan_to_num(median(sigma)))
    # cells share errors: a mean over 3 x 3 is hardly better than one of them
    high = smooth > max(rule.noise * typical, 0.2 * rule.least_height_mm)
    high = grown(shrunk(high))
    high |= shrunk(grown(high, 2), 2) & ~np.isfinite(rise)
    labels, count = parts(high, diagonal=True)
    origin = _cut(labels, count, scan.grid, expected)
    found = [
        one
        for number, box in enumerate(ndimage.find_objects(labels), start=1)
        if box is not None
        and (one := _measured(labels, number, box, rise, smooth, scan, typical, origin.get(number), rule)) is not None
    ]
    keep = np.zeros(int(labels.max(initial=0)) + 1, dtype=np.bool_)
    keep[[one.label for one in found]] = True
    in_slabs(len(labels), lambda first, last: _dropped(labels, keep, first, last), least=256)
    return labels, tuple(sorted(found, key=lambda one: -one.volume_mm3.value))


def _cut(labels: npt.NDArray[np.int32], count: int, grid: Grid, expected: Sequence[Expected]) -> dict[int, int]:
    """Cut parts in which several expected objects lie, in place; gives the expected one of each cut label."""
    rows, columns = labels.shape
    inside: dict[int, list[int]] = {}
    if not expected or not count:
        return {}
    away, nearest = ndimage.distance_transform_edt(labels == 0, return_indices=True)
    for k, one in enumerate(expected):
        row, column = round((one.y_mm - grid.y0_mm) / grid.pitch_mm), round((one.x_mm - grid.x0_mm) / grid.pitch_mm)
        if 0 <= row < rows and 0 <= column < columns and away[row, column] * grid.pitch_mm <= BESIDE_MM:
            inside.setdefault(int(labels[tuple(nearest[:, row, column])]), []).append(k)
    origin: dict[int, int] = {}
    boxes = ndimage.find_objects(labels)
    for label, those in inside.items():
        if len(those) < 2:
            continue
        box = boxes[label - 1]
        r, c = np.nonzero(labels[box] == label)
        x = grid.x0_mm + (c + box[1].start) * grid.pitch_mm
        y = grid.y0_mm + (r + box[0].start) * grid.pitch_mm
        distance = np.stack([_mahalanobis(expected[k], x, y) for k in those])
        nearest = distance.argmin(axis=0)
        for n, k in enumerate(those):
            number = label if n == 0 else (count := count + 1)
            mine = nearest == n
            labels[box][r[mine], c[mine]] = number
            origin[number] = k
    return origin


def _mahalanobis(one: Expected, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    dx, dy = x - one.x_mm, y - one.y_mm
    size = max(one.xx_mm2 * one.yy_mm2 - one.xy_mm2**2, 1e-12)
    found: npt.NDArray[np.float64] = (one.yy_mm2 * dx * dx - 2 * one.xy_mm2 * dx * dy + one.xx_mm2 * dy * dy) / size
    return found


@njit(cache=True, nogil=True)
def _risen(now, level, sigma, spread, rise, both, first, last):  # type: ignore[no-untyped-def]  # numba infers the types
    for i in range(first, last):
        for j in range(now.shape[1]):
            rise[i, j] = now[i, j] - level[i, j]
            both[i, j] = np.sqrt(sigma[i, j] ** 2 + spread[i, j] ** 2)


@njit(cache=True, nogil=True)
def _dropped(labels, keep, first, last):  # type: ignore[no-untyped-def]  # as above
    for i in range(first, last):
        for j in range(labels.shape[1]):
            if not keep[labels[i, j]]:
                labels[i, j] = 0


@njit(cache=True, nogil=True)
def _moments(part):  # type: ignore[no-untyped-def]  # as above
    """Variances and covariance of the marked cells' columns and rows: columns, both, rows."""
    n = r = c = cc = rc = rr = 0
    for i in range(part.shape[0]):
        for j in range(part.shape[1]):
            if part[i, j]:
                n += 1
                r += i
                c += j
                cc += j * j
                rc += i * j
                rr += i * i
    row, column = r / n, c / n
    return cc / n - column * column, rc / n - row * column, rr / n - row * row


@njit(cache=True, nogil=True)
def _middle(rise, part, least):  # type: ignore[no-untyped-def]  # as above
    """Mean row and column of the marked cells, each as heavy as it rises above `least`.

    Cells not measured are bridged from those around (Laplace's equation, by relaxation): without them, a side in shadow
    weighs nothing.
    """
    rows, columns = part.shape
    z = np.empty((rows, columns))
    hidden = 0
    for i in range(rows):
        for j in range(columns):
            known = np.isfinite(rise[i, j])
            z[i, j] = rise[i, j] if known else 0.0
            hidden += part[i, j] and not known
    for _ in range(SWEEPS if hidden else 0):
        for i in range(1, rows - 1):
            for j in range(1, columns - 1):
                if not np.isfinite(rise[i, j]):
                    z[i, j] = (z[i - 1, j] + z[i + 1, j] + z[i, j - 1] + z[i, j + 1]) / 4
    weight = row = column = 0.0
    for i in range(rows):
        for j in range(columns):
            w = z[i, j] - least
            if part[i, j] and w > 0:
                weight += w
                row += w * i
                column += w * j
    return row / weight, column / weight


def _measured(
    labels: npt.NDArray[np.int32],
    number: int,
    box: tuple[slice, slice],
    rise: npt.NDArray[np.float32],
    smooth: npt.NDArray[np.float32],
    scan: Scan,
    sigma: float,
    expected: int | None,
    rule: ObjectRule,
) -> StandingObject | None:
    grid = scan.grid
    part = labels[box] == number
    # the rim that rises less than the noise is part of the volume: two cells more, where nothing else is
    wider = tuple(slice(max(0, s.start - 2), s.stop + 2) for s in box)
    mine = labels[wider] == number
    rim = grown(mine, 2) & (labels[wider] == 0)
    area = float(np.count_nonzero(part)) * grid.cell_mm2
    tops = smooth[box][part]
    tops = tops[np.isfinite(tops)]
    if area < rule.least_area_mm2 or not tops.size or tops.max() < rule.least_height_mm:
        return None
    height = float(np.quantile(tops, 0.99))
    own = rise[wider][mine]
    known = np.isfinite(own)
    beside = rise[wider][rim]
    beside = beside[np.isfinite(beside)]
    filled = float(own[known].mean(dtype=np.float64)) * own.size + float(
        np.maximum(beside, 0).sum(dtype=np.float64) / 2
    )
    cells = own.size + beside.size
    outline = float(np.count_nonzero(part) - np.count_nonzero(shrunk(part)))
    raster = outline * grid.cell_mm2 / np.sqrt(12)
    volume = Measurement(
        filled * grid.cell_mm2,
        float(
            np.hypot(
                sigma * grid.cell_mm2 * np.sqrt(cells * SHARED_ERROR_CELLS),
                (1 - known.mean()) * abs(filled) * grid.cell_mm2,
            )
        ),
    )
    moments = _moments(part)
    row, column = _middle(rise[wider], mine, BODY * height)
    cell = grid.cell_mm2
    xx, xy, yy = (each * cell for each in moments)
    xx, yy = xx + cell / 12, yy + cell / 12
    half = np.hypot((xx - yy) / 2, xy)
    rows, columns = labels.shape
    top = scan.height[box][part]
    return StandingObject(
        label=number,
        x_mm=grid.x0_mm + (column + wider[1].start) * grid.pitch_mm,
        y_mm=grid.y0_mm + (row + wider[0].start) * grid.pitch_mm,
        z_mm=float(np.nanquantile(top, 0.99)),
        height_mm=height,
        area_mm2=Measurement(area, raster),
        volume_mm3=volume,
        length_mm=float(4 * np.sqrt((xx + yy) / 2 + half)),
        width_mm=float(4 * np.sqrt(max((xx + yy) / 2 - half, 0.0))),
        axis=float(0.5 * np.arctan2(2 * xy, xx - yy)),
        moments_mm2=(xx, xy, yy),
        at_border=box[0].start == 0 or box[1].start == 0 or box[0].stop == rows or box[1].stop == columns,
        expected=expected,
    )
