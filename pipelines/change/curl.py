"""Curl: how far the edges of the plates between cracks have risen over their middles since the baseline."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .distance import inner_distance
from .parts import by_part, part_greatest, part_sums, parts
from .ranks import MAD_TO_SIGMA
from .values import Measurement

__all__ = [
    "EDGE_BAND_MM",
    "INTERIOR_SHARE",
    "LEAST_CELLS",
    "LEAST_PLATE_MM2",
    "SHARED_ERROR_CELLS",
    "crack_distance",
    "edge_lift",
]

EDGE_BAND_MM = 0.05, 0.25
"""Distance from the crack's edge of the cells that are "the edge"; closer ones may be the wall, resampled."""
INTERIOR_SHARE = 0.6
"""The interior of a plate: further from its edge than this share of its greatest distance."""
LEAST_PLATE_MM2 = 1.0
LEAST_CELLS = 30
SHARED_ERROR_CELLS = 25.0


def crack_distance(crack: npt.NDArray[np.bool_], pitch_mm: float) -> npt.NDArray[np.float32]:
    """Distance of each cell's centre to the nearest crack cell's side, mm; half a cell less than to its centre."""
    distance = inner_distance(~crack).astype(np.float32)
    distance -= np.float32(0.5)
    np.maximum(distance, 0, out=distance)
    distance *= np.float32(pitch_mm)
    return distance


def edge_lift(
    dz: npt.NDArray[np.float32],
    crack: npt.NDArray[np.bool_],
    region: npt.NDArray[np.bool_],
    pitch_mm: float,
    distance: npt.NDArray[np.float32] | None = None,
) -> Measurement:
    """Mean rise of the plates' edges over their interiors.

    Plates are the parts of the region that cracks divide. On each, d is the distance to the side of the nearest crack
    cell, the edge is 0.05 mm < d < 0.25 mm, the interior d > 0.6 of the plate's greatest d, and

        lift = mean(dz over the edge) - mean(dz over the interior)

    weighted over plates by their number of edge cells. dz is a height difference to the baseline, so relief cancels
    and lift is 0 at the baseline; + is concave-up. Settlement, a wrong offset and tilt of a whole plate cancel too.
    For a lift that decays as exp(-d / L) from the edge the value is smaller than the lift at the very edge: 0.83 of it
    for L = 0.8 mm, less what is left in the interior.

    Parameters
    ----------
    dz : ndarray of float32, shape (rows, columns)
        mm; NaN where not measured.
    crack : ndarray of bool, shape (rows, columns)
        Crack at the later scan or at the baseline.
    region : ndarray of bool, shape (rows, columns)
    pitch_mm : float
    distance : ndarray of float32, shape (rows, columns), optional
        As `crack_distance` gives it; worked out if left out.

    Returns
    -------
    Measurement
        NaN where there is no crack or no plate of 1 mm2 with 30 edge and 30 interior cells.
    """
    nothing = Measurement(float("nan"), float("nan"))
    if not crack.any():
        return nothing
    plates, count = parts(region & ~crack, diagonal=False)
    if count == 0:
        return nothing
    distance = crack_distance(crack, pitch_mm) if distance is None else distance
    known = np.isfinite(dz)
    inner = np.maximum(INTERIOR_SHARE * part_greatest(plates, count, distance), EDGE_BAND_MM[1])
    interior = known & (distance > by_part(plates, inner.astype(np.float32, copy=False)))

    def sums(mask: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        return part_sums(plates, count, dz, mask), part_sums(plates, count, mask)

    def band(offset_mm: float) -> npt.NDArray[np.bool_]:
        low, high = EDGE_BAND_MM[0] + offset_mm, EDGE_BAND_MM[1] + offset_mm
        within: npt.NDArray[np.bool_] = known & (distance > low) & (distance < high)
        return within

    edge = band(0.0)
    edge_sum, edge_count = sums(edge)
    inner_sum, inner_count = sums(interior)
    size = part_sums(plates, count, region) * pitch_mm**2
    valid = (size >= LEAST_PLATE_MM2) & (edge_count >= LEAST_CELLS) & (inner_count >= LEAST_CELLS)
    valid[0] = False
    if not valid.any():
        return nothing
    edges, inners = edge_count[valid], inner_count[valid]
    lifts = edge_sum[valid] / edges - inner_sum[valid] / inners
    lift = float(np.average(lifts, weights=edges))
    # the crack's edge is known to a cell (uniform): what a band one cell further in would give tells what that is worth
    shifted_sum, shifted_count = sums(band(pitch_mm))
    shift = shifted_sum[valid] / np.maximum(shifted_count[valid], 1) - edge_sum[valid] / edges
    placed = float(np.average(shift, weights=edges)) / np.sqrt(3)
    # the spread about each plate's own edge level holds noise and the real differences along the edge
    about = edge_sum / np.maximum(edge_count, 1)
    keep = by_part(plates, valid) & edge
    spread = float(MAD_TO_SIGMA * np.median(np.abs(dz[keep] - about[plates[keep]])))
    share = edges / edges.sum()
    variance = spread**2 * SHARED_ERROR_CELLS * float((share**2 * (1 / edges + 1 / inners)).sum())
    return Measurement(lift, float(np.hypot(np.sqrt(variance), placed)))
