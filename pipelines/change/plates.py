"""Plates between cracks: how far each one's rim has risen, turned and bent since the baseline, tilt taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .curl import EDGE_BAND_MM, INTERIOR_SHARE, LEAST_CELLS, LEAST_PLATE_MM2, SHARED_ERROR_CELLS, crack_distance
from .parts import by_part, part_sums, parts
from .plate_sums import band_sums, cells_of
from .ranks import MAD_TO_SIGMA
from .values import Change, Comparison, Measurement

__all__ = ["CURVED_MM", "Plate", "find_plates", "rim_slope"]

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

CURVED_MM = 0.05, 0.65
"""Distance from the crack's edge over which the curvature is that of a parabola."""
TELLS_TILT = 0.1
"""Share of the plate's extent that cells of one distance must span in a direction before tilt that way is told from
curl; a plate with one straight edge says nothing of tilt across it."""

ENOUGH_CELLS = 20_000
"""Tilt and spread are those of some so many cells of a larger plate."""


@dataclass(frozen=True, slots=True)
class Plate:
    """One plate of one scan.

    Parameters
    ----------
    label : int
        Its number in the labels, from 1; the largest is 1.
    x_mm, y_mm : float
        Its centre, site frame.
    area : Measurement
        mm2.
    lift : Measurement
        Mean rise of the edge band (0.05 to 0.25 mm from the crack) over the interior, mm; + curls up.
    angle : Measurement
        By how much the rim has turned up: slope of the edge band across the edge, now less then, degrees.
    curvature : Measurement
        Second derivative of the rise against the distance from the edge (0.05 to 0.65 mm), 1/mm; + is concave up.
    edge_cells : int
        Cells of the edge band that both scans measured.
    edge_seen : float
        Share of the edge band that they are.
    tilt_removed : (bool, bool)
        Whether tilt could be told from curl along each of two directions; False of a plate with one straight edge.
    """

    label: int
    x_mm: float
    y_mm: float
    area: Measurement
    lift: Measurement
    angle: Measurement
    curvature: Measurement
    edge_cells: int
    edge_seen: float
    tilt_removed: tuple[bool, bool]


def find_plates(
    comparison: Comparison, crack: Mask, baseline_crack: Mask, distance: npt.NDArray[np.float32] | None = None
) -> tuple[npt.NDArray[np.int32], tuple[Plate, ...]]:
    """Measure the curl of each plate.

    Plates are the parts, four-connected, into which the cracks of now and of the baseline divide the region, of 1 mm2
    or more. d is the distance of a cell to the nearest edge of a crack of now or then. On each plate a plane's slope
    is taken out of dz first. It is the slope that dz has among cells of one distance d, which no curl that goes by d
    changes. ::

        lift       mean dz over 0.05 mm < d < 0.25 mm  -  mean dz over d > 0.6 of the greatest d
        angle      arctan(s + t) - arctan(t), s and t the slopes towards the crack of the lines of least squares through
                   dz and through the baseline's heights against d in that band
        curvature  2 c of the parabola a + b d + c d^2 through dz against d, 0.05 mm < d < 0.65 mm

    All of it is told of cells that lie still: a plate that slid sideways by more than its grains are wide
    brings the grains' own slopes into the angle.

    Uncertainties are of the spread of dz about its profile along d, 25 neighbouring cells sharing each error, and of
    the crack's edge, which is known to a cell.

    Parameters
    ----------
    comparison : Comparison
    crack, baseline_crack : ndarray of bool, shape (rows, columns)
        As `crack_mask` gives them.
    distance : ndarray of float32, shape (rows, columns), optional
        To both, as `crack_distance` gives it; worked out if left out.

    Returns
    -------
    labels : ndarray of int32, shape (rows, columns)
        0 where no plate is.
    plates : tuple of Plate
        Largest first; those without 30 cells measured in both the edge band and the interior are left out, but keep
        their label. None without a crack.
    """
    region, grid = comparison.region, comparison.scan.grid
    now, then = crack & region, baseline_crack & region
    ground = region & ~now & ~then
    labels, count = _parted(ground, comparison.change)
    sizes = part_sums(labels, count, ground)
    order = np.argsort(-sizes, kind="stable")[: int((sizes * grid.cell_mm2 >= LEAST_PLATE_MM2).sum())]
    rank = np.zeros(count + 1, dtype=np.int32)
    rank[order] = np.arange(1, order.size + 1)
    labels = by_part(labels, rank)
    if not (now | then).any() or not order.size:
        return labels, ()
    distance = crack_distance(now | then, grid.pitch_mm) if distance is None else distance
    found = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        plate = _measured(comparison, labels, label, box, distance)
        if plate is not None:
            found.append(plate)
    return labels, tuple(found)


def _parted(ground: Mask, change: Change) -> tuple[npt.NDArray[np.int32], int]:
    """Number the parts of the ground, four-connected.

    At the map's border a scan that was moved has cells that it does not reach, and no crack is seen there: they part
    nothing and join nothing, and belong to what lies beside them further in.
    """
    margin = 1 + int(np.ceil(np.abs(change.motion.shift_mm[:2]).max() / change.grid.pitch_mm))
    beyond = ~np.isfinite(change.dz)
    beyond[margin:-margin, margin:-margin] = False
    labels, count = parts(ground & ~beyond, diagonal=False)
    inward = np.ix_(*(np.clip(np.arange(n), margin, n - 1 - margin) for n in labels.shape))
    return np.where(ground & beyond, labels[inward], labels), count


def rim_slope(height: npt.NDArray[np.floating], distance: npt.NDArray[np.floating]) -> float:
    """Slope across the edge of some cells of a rim, degrees: + where it rises towards the crack; NaN of fewer than 3.

    Parameters
    ----------
    height, distance : ndarray, shape (n,)
        Heights of cells of the edge band, and how far from the crack each lies, mm.
    """
    known = np.isfinite(height)
    if known.sum() < 3:
        return float("nan")
    return float(np.rad2deg(np.arctan(-_line(np.asarray(distance[known]), np.asarray(height[known])))))


def _measured(
    comparison: Comparison,
    labels: npt.NDArray[np.int32],
    label: int,
    box: tuple[slice, slice],
    distance: npt.NDArray[np.float32],
) -> Plate | None:
    grid = comparison.scan.grid
    cells = cells_of(labels, label, box, (comparison.change.dz, distance, comparison.baseline.height))
    dz, d, then = cells.values
    x, y = grid.x0_mm + cells.column * grid.pitch_mm, grid.y0_mm + cells.row * grid.pitch_mm
    low, high = EDGE_BAND_MM
    rim = (d > low) & (d < high)
    known = np.isfinite(dz)
    interior = known & (d > max(INTERIOR_SHARE * float(d.max()), high))
    edge = known & rim
    if edge.sum() < LEAST_CELLS or interior.sum() < LEAST_CELLS:
        return None
    some = np.flatnonzero(known)[:: max(1, int(known.sum()) // ENOUGH_CELLS) | 1]
    tilt, told = _tilt(x[some], y[some], dz[some], d[some], grid.pitch_mm)
    dz = dz - tilt[0] * (x - x.mean()) - tilt[1] * (y - y.mean())
    lift = float(dz[edge].mean() - dz[interior].mean())
    spread = _spread(dz[some], d[some], grid.pitch_mm)

    # the crack's edge is known to a cell (uniform): what each number would be a cell further in
    def turned(shift: float) -> float:
        sums = band_sums(d, dz, then, low + shift, high + shift)
        rise, slope = -sums.slope_now, -sums.slope_then
        return float(np.rad2deg(np.arctan(slope + rise) - np.arctan(slope)))

    def bent(shift: float) -> float:
        return 2 * band_sums(d, dz, then, CURVED_MM[0] + shift, CURVED_MM[1] + shift).bend

    shifted = known & (d > low + grid.pitch_mm) & (d < high + grid.pitch_mm)
    lift_placed = float(dz[shifted].mean() - dz[edge].mean()) if shifted.any() else 0.0
    angle, curvature = turned(0.0), bent(0.0)
    shared = SHARED_ERROR_CELLS
    band = d[edge]
    lever = float(np.sqrt(((band - band.mean()) ** 2).sum()))
    bend = float(np.sqrt(band_sums(d, dz, then, *CURVED_MM).bend_lever))
    root3 = np.sqrt(3)
    return Plate(
        label=label,
        x_mm=float(x.mean()),
        y_mm=float(y.mean()),
        area=Measurement(x.size * grid.cell_mm2, cells.outline * grid.cell_mm2 / np.sqrt(12)),
        lift=Measurement(
            lift,
            float(np.hypot(spread * np.sqrt(shared * (1 / edge.sum() + 1 / interior.sum())), lift_placed / root3)),
        ),
        angle=Measurement(
            angle,
            float(
                np.hypot(
                    np.rad2deg(spread * np.sqrt(shared) / max(lever, 1e-9)), (turned(grid.pitch_mm) - angle) / root3
                )
            ),
        ),
        curvature=Measurement(
            curvature,
            float(np.hypot(2 * spread * np.sqrt(shared) / max(bend, 1e-9), (bent(grid.pitch_mm) - curvature) / root3)),
        ),
        edge_cells=int(edge.sum()),
        edge_seen=float(edge.sum() / rim.sum()),
        tilt_removed=told,
    )


def _by_distance(d: Floats, pitch: float) -> tuple[npt.NDArray[np.intp], Floats]:
    """Which ring each cell is of, a cell wide, and how many cells each ring has (at least 1, for divisions)."""
    ring = (d / pitch).astype(np.intp)
    return ring, np.maximum(np.bincount(ring), 1).astype(np.float64)


def _tilt(x: Floats, y: Floats, dz: Floats, d: Floats, pitch: float) -> tuple[Floats, tuple[bool, bool]]:
    """Slope of dz along x and y among cells of one distance from the crack, where those say it."""
    ring, count = _by_distance(d, pitch)

    def about(values: Floats) -> Floats:
        rest: Floats = values - (np.bincount(ring, weights=values) / count)[ring]
        return rest

    place = np.stack([about(x), about(y)])
    whole = np.stack([x - x.mean(), y - y.mean()])
    within, axes = np.linalg.eigh(place @ place.T)
    total = ((axes.T @ whole) ** 2).sum(axis=1)
    told = within > TELLS_TILT**2 * np.maximum(total, 1e-12)
    along = axes.T @ (place @ about(dz))
    slope = np.where(told, along / np.where(told, within, 1.0), 0.0)
    return axes @ slope, (bool(told[0]), bool(told[1]))


def _spread(dz: Floats, d: Floats, pitch: float) -> float:
    """Robust spread of dz about its mean in each ring."""
    ring, count = _by_distance(d, pitch)
    rest = dz - (np.bincount(ring, weights=dz) / count)[ring]
    return float(MAD_TO_SIGMA * np.median(np.abs(rest)))


def _line(d: Floats, z: Floats) -> float:
    """Slope of the line of least squares; NaN of too few cells."""
    if d.size < 3:
        return float("nan")
    about = d - d.mean()
    lever = float(about @ about)
    return float(about @ (z - z.mean())) / lever if lever > 0 else float("nan")
