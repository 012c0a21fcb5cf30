"""METRICS: every number that is followed through time, with its unit, its definition and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ..slabs import side_by_side
from .crack_lines import length_sigma
from .crack_widths import opening_sigma
from .curl import edge_lift
from .roughness_metrics import ROUGHNESS_METRICS
from .shared_results import crack_of, cracked, depths_of, forget, openings_of, plates_of, volumes_of
from .values import Comparison, Measurement, Metric

__all__ = ["METRICS", "measure"]

FAMILIES = ("crack_",), ("net_", "gained_", "lost_"), ("roughness_",), ("plate_", "curl_", "edge_"), ("",)
"""How names begin of metrics that rest on the same long work; families are worked out side by side, in this order."""
NOT_MEASURED = Measurement(float("nan"), float("nan"))
OF_PLATE = (
    "That plate's: spread of dz about its profile from the edge, 25 cells sharing each error; the edge, to a cell."
)
OF_PLATES = "Mean of the plates' own, weighted by area: they are not taken to cancel."


def _gained(comparison: Comparison) -> Measurement:
    return volumes_of(comparison).gained


def _lost(comparison: Comparison) -> Measurement:
    return volumes_of(comparison).lost


def _net(comparison: Comparison) -> Measurement:
    return volumes_of(comparison).net


def _crack_area(comparison: Comparison) -> Measurement:
    grid = comparison.scan.grid
    if not np.isfinite(comparison.scan.height).any():
        return NOT_MEASURED
    area = float(np.count_nonzero(crack_of(comparison))) * grid.cell_mm2
    openings = openings_of(comparison)
    length = float(openings.lines.step.sum()) * grid.pitch_mm
    return Measurement(area, max(length * opening_sigma(openings, grid.pitch_mm), grid.cell_mm2))


def _crack_length(comparison: Comparison) -> Measurement:
    pitch = comparison.scan.grid.pitch_mm
    if not np.isfinite(comparison.scan.height).any():
        return NOT_MEASURED
    lines = openings_of(comparison).lines
    length = float(lines.step.sum()) * pitch
    return Measurement(length, length_sigma(length, lines.free_ends, lines.end_width * pitch, pitch))


SEEN_SHARE = 0.5
"""Of the region's cells: ground of which less was measured may hide a crack."""


def _uncracked(comparison: Comparison) -> bool:
    """Whether the region was seen and holds no crack: then there is nothing to measure, which is not unmeasured."""
    cells = np.count_nonzero(comparison.region)
    seen = np.count_nonzero(np.isfinite(comparison.scan.height) & comparison.region)
    return bool(0 < cells <= seen / SEEN_SHARE) and not crack_of(comparison).any()


def _crack_opening(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm)
    openings = openings_of(comparison)
    known = np.isfinite(openings.opening_mm)
    if not known.any():
        return NOT_MEASURED
    mean = float(np.average(openings.opening_mm[known], weights=openings.step_mm[known]))
    return Measurement(mean, opening_sigma(openings, comparison.scan.grid.pitch_mm))


def _crack_depth(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm)
    return depths_of(comparison).mean


def _crack_volume(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm**3)
    return depths_of(comparison).volume


def _crack_seen(comparison: Comparison) -> Measurement:
    return Measurement(depths_of(comparison).seen, 0.0)


def _edge_lift(comparison: Comparison) -> Measurement:
    crack, distance = cracked(comparison)
    return edge_lift(comparison.change.dz, crack, comparison.region, comparison.scan.grid.pitch_mm, distance)


def _mean_of_plates(name: str) -> Callable[[Comparison], Measurement]:
    def mean(comparison: Comparison) -> Measurement:
        values, sigmas, areas = _of_plates(comparison, name)
        if not values.size:
            return NOT_MEASURED
        # every plate's edge is placed by one raster and one definition: their errors are not taken to cancel
        return Measurement(float(np.average(values, weights=areas)), float(np.average(sigmas, weights=areas)))

    return mean


def _largest_of_plates(name: str, share: float = 1.0) -> Callable[[Comparison], Measurement]:
    """Largest value of any plate, or the one that plates of a share of the area do not exceed."""

    def largest(comparison: Comparison) -> Measurement:
        values, sigmas, areas = _of_plates(comparison, name)
        if not values.size:
            return NOT_MEASURED
        order = np.argsort(values, kind="stable")
        reached = np.cumsum(areas[order]) >= share * areas.sum() * (1 - 1e-12)
        at = order[int(np.argmax(reached))] if share < 1 else order[-1]
        return Measurement(float(values[at]), float(sigmas[at]))

    return largest


def _of_plates(comparison: Comparison, name: str) -> tuple[npt.NDArray[np.float64], ...]:
    plates = [plate for plate in plates_of(comparison) if np.isfinite(getattr(plate, name).value)]
    measured = [getattr(plate, name) for plate in plates]
    return (
        np.array([one.value for one in measured]),
        np.array([one.sigma for one in measured]),
        np.array([plate.area.value for plate in plates]),
    )


def _covered(comparison: Comparison) -> Measurement:
    total = np.count_nonzero(comparison.region)
    if total == 0:
        return NOT_MEASURED
    return Measurement(np.count_nonzero(np.isfinite(comparison.change.dz) & comparison.region) / total, 0.0)


def _coverage(comparison: Comparison) -> Measurement:
    return Measurement(comparison.scan.coverage, 0.0)


def _registration_residual(comparison: Comparison) -> Measurement:
    return Measurement(comparison.change.motion.residual_mm, 0.0)


METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        metric.name: metric
        for metric in (
            Metric(
                "net_volume",
                "mm3",
                "Net volume change",
                "Sum of dz times cell area over the region's cells measured in both scans; no threshold.",
                _net,
                "Errors of height that neighbours share, by FFT from stable ground; registration; cells at walls.",
            ),
            Metric(
                "gained_volume",
                "mm3",
                "Volume gained",
                "The part of the net volume where the mean of dz over 5 x 5 cells is positive; no threshold.",
                _gained,
                "That of the net volume, and what noise alone gives of gain where nothing changed.",
            ),
            Metric(
                "lost_volume",
                "mm3",
                "Volume lost",
                "Volume gained less net volume: where the mean of dz over 5 x 5 cells is negative, counted positive.",
                _lost,
                "That of the net volume, and what noise alone gives of loss where nothing changed.",
            ),
            Metric(
                "crack_area",
                "mm2",
                "Crack area",
                "Area of the crack cells in the region, an unseen floor included.",
                _crack_area,
                "Length of the cracks times the uncertainty of their opening; at least one cell.",
            ),
            Metric(
                "crack_length",
                "mm",
                "Crack length",
                "Length of the cracks' centre lines in the region, from end to end, spurs left out.",
                _crack_length,
                "A quarter of the width at each free end, 2.5 % for stairs, spurs and gaps, and a cell.",
            ),
            Metric(
                "crack_opening",
                "mm",
                "Crack opening",
                "Mean distance between a crack's edges across its centre line, weighted by length, clear of junctions; "
                "0 where the region was seen and has no crack.",
                _crack_opening,
                "Noise of the profiles; half a cell per seen edge, a cell per unseen one, which do not average out; a "
                "cell where there is no crack.",
            ),
            Metric(
                "crack_depth",
                "mm",
                "Crack depth",
                "Mean depth along the cracks' centre lines below the nearest rim, where the floor was seen; at least. "
                "0 where the region was seen and has no crack.",
                _crack_depth,
                "Noise of the cells, and how depth differs from cell to cell: the line may lie beside the deepest; a "
                "cell where there is no crack.",
            ),
            Metric(
                "crack_volume",
                "mm3",
                "Crack volume",
                "Volume of the cracks below their rims, where the floor was seen; at least. 0 where the region was "
                "seen and has no crack.",
                _crack_volume,
                "Noise of the cells with the errors that neighbours share, and the outline, uniform within a cell.",
            ),
            Metric(
                "crack_seen",
                "1",
                "Crack floor seen",
                "Share of the crack cells whose floor was measured: what crack depth and volume rest on.",
                _crack_seen,
                "None: a count of cells.",
            ),
            Metric(
                "edge_lift",
                "mm",
                "Edge lift",
                "Mean dz of the plates' edges (0.05 to 0.25 mm from the crack) less their interiors'; + curls up.",
                _edge_lift,
                "Scatter of dz on edges and interiors, and where within a cell the crack's edge lies.",
            ),
            Metric(
                "plate_lift_largest",
                "mm",
                "Largest lift of a plate",
                "Edge lift of the plate that curls most, its tilt taken out.",
                _largest_of_plates("lift"),
                OF_PLATE,
            ),
            Metric(
                "plate_lift_p95",
                "mm",
                "Lift that 95 % of plates stay below",
                "Edge lift that plates of 95 % of the plates' area do not exceed.",
                _largest_of_plates("lift", 0.95),
                OF_PLATE,
            ),
            Metric(
                "curl_angle",
                "degree",
                "Curl angle",
                "Mean angle by which the plates' edges have turned up since the baseline, weighted by area.",
                _mean_of_plates("angle"),
                OF_PLATES,
            ),
            Metric(
                "curl_angle_largest",
                "degree",
                "Largest curl angle of a plate",
                "Angle by which the edge of the plate that turned most has turned up since the baseline.",
                _largest_of_plates("angle"),
                OF_PLATE,
            ),
            Metric(
                "curl_angle_p95",
                "degree",
                "Curl angle that 95 % of plates stay below",
                "Curl angle that plates of 95 % of the plates' area do not exceed.",
                _largest_of_plates("angle", 0.95),
                OF_PLATE,
            ),
            Metric(
                "curl_curvature",
                "mm-1",
                "Curl curvature",
                "Mean curvature across the plates' edges since the baseline, weighted by area; + is concave up.",
                _mean_of_plates("curvature"),
                OF_PLATES,
            ),
            *ROUGHNESS_METRICS,
            Metric(
                "covered",
                "1",
                "Region measured in both scans",
                "Share of the region's cells on which volumes rest.",
                _covered,
                "None: a count of cells.",
            ),
            Metric(
                "coverage",
                "1",
                "Cells measured",
                "Share of the grid's cells that the scan measured.",
                _coverage,
                "None: a count of cells.",
            ),
            Metric(
                "registration_residual",
                "mm",
                "Registration residual",
                "Robust standard deviation (1.4826 MAD) of dz on the stable areas.",
                _registration_residual,
                "None: it is a spread itself.",
            ),
        )
    }
)
"""By name. Names are array names in the store."""


def measure(comparison: Comparison, names: Iterable[str]) -> dict[str, Measurement]:
    """Measure some of `METRICS`.

    Parameters
    ----------
    comparison : Comparison
    names : iterable of str

    Returns
    -------
    dict of str to Measurement
        In the order of `names`; NaN where something was not measured.

    Raises
    ------
    KeyError
        If a name is not in `METRICS`; the message lists those that are.
    """
    wanted = list(names)
    unknown = [name for name in wanted if name not in METRICS]
    if unknown:
        raise KeyError(f"no metric {unknown[0]!r}: choose from {', '.join(METRICS)}")
    families: dict[tuple[str, ...], list[str]] = {starts: [] for starts in FAMILIES}
    for name in wanted:
        families[next(starts for starts in FAMILIES if name.startswith(starts))].append(name)
    try:
        found: dict[str, Measurement] = {}
        for part in side_by_side(*(partial(_all_of, comparison, family) for family in families.values())):
            found |= part
    finally:
        forget()
    return {name: found[name] for name in wanted}


def _all_of(comparison: Comparison, names: list[str]) -> dict[str, Measurement]:
    return {name: METRICS[name].measure(comparison) for name in names}
