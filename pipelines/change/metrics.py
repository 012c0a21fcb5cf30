"""METRICS: every number that is followed through time, with its unit, its definition and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from ..slabs import side_by_side
from .crack_depths import CrackDepths, crack_depths
from .crack_lines import length_sigma
from .crack_widths import CrackOpenings, crack_openings, opening_sigma
from .cracks import crack_mask
from .curl import edge_lift
from .plates import Plate, find_plates
from .roughness_metrics import ROUGHNESS_METRICS, forget_roughness
from .values import Comparison, Measurement, Metric
from .volume import Volumes, volumes

__all__ = ["METRICS", "measure"]

NOT_MEASURED = Measurement(float("nan"), float("nan"))
OF_PLATE = (
    "That plate's: spread of dz about its profile from the edge, 25 cells sharing each error; the edge, to a cell."
)
OF_PLATES = "Mean of the plates' own, weighted by area: they are not taken to cancel."


# Several metrics need the same intermediate result of one comparison. Each cache holds one, keyed by identity
# (Comparison has no equality), and `measure` empties them, so that no scan outlives its tick.
@lru_cache(maxsize=1)
def _volumes(comparison: Comparison) -> Volumes:
    return volumes(comparison.change, comparison.region, comparison.stable, comparison.noise)


@lru_cache(maxsize=1)
def _crack(comparison: Comparison) -> npt.NDArray[np.bool_]:
    return crack_mask(comparison.scan) & comparison.region


@lru_cache(maxsize=1)
def _baseline_crack(baseline: Scan) -> npt.NDArray[np.bool_]:
    # not emptied: the same baseline comes back with every scan of an epoch
    return crack_mask(baseline)


@lru_cache(maxsize=1)
def _openings(comparison: Comparison) -> CrackOpenings:
    return crack_openings(comparison.scan, _crack(comparison))


@lru_cache(maxsize=1)
def _depths(comparison: Comparison) -> CrackDepths:
    return crack_depths(comparison.scan, _crack(comparison), _openings(comparison).lines)


def _gained(comparison: Comparison) -> Measurement:
    return _volumes(comparison).gained


def _lost(comparison: Comparison) -> Measurement:
    return _volumes(comparison).lost


def _net(comparison: Comparison) -> Measurement:
    return _volumes(comparison).net


def _crack_area(comparison: Comparison) -> Measurement:
    grid = comparison.scan.grid
    if not np.isfinite(comparison.scan.height).any():
        return NOT_MEASURED
    area = float(_crack(comparison).sum()) * grid.cell_mm2
    openings = _openings(comparison)
    length = float(openings.lines.step.sum()) * grid.pitch_mm
    return Measurement(area, max(length * opening_sigma(openings, grid.pitch_mm), grid.cell_mm2))


def _crack_length(comparison: Comparison) -> Measurement:
    pitch = comparison.scan.grid.pitch_mm
    if not np.isfinite(comparison.scan.height).any():
        return NOT_MEASURED
    lines = _openings(comparison).lines
    length = float(lines.step.sum()) * pitch
    return Measurement(length, length_sigma(length, lines.free_ends, lines.end_width * pitch, pitch))


SEEN_SHARE = 0.5
"""Of the region's cells: ground of which less was measured may hide a crack."""


def _uncracked(comparison: Comparison) -> bool:
    """Whether the region was seen and holds no crack: then there is nothing to measure, which is not unmeasured."""
    seen = np.isfinite(comparison.scan.height[comparison.region])
    return bool(seen.size) and float(seen.mean()) >= SEEN_SHARE and not _crack(comparison).any()


def _crack_opening(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm)
    openings = _openings(comparison)
    known = np.isfinite(openings.opening_mm)
    if not known.any():
        return NOT_MEASURED
    mean = float(np.average(openings.opening_mm[known], weights=openings.step_mm[known]))
    return Measurement(mean, opening_sigma(openings, comparison.scan.grid.pitch_mm))


def _crack_depth(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm)
    return _depths(comparison).mean


def _crack_volume(comparison: Comparison) -> Measurement:
    if _uncracked(comparison):
        return Measurement(0.0, comparison.scan.grid.pitch_mm**3)
    return _depths(comparison).volume


def _crack_seen(comparison: Comparison) -> Measurement:
    return Measurement(_depths(comparison).seen, 0.0)


def _edge_lift(comparison: Comparison) -> Measurement:
    # only within the region: the seam of a holder beside it is no crack
    crack = _crack(comparison) | (_baseline_crack(comparison.baseline) & comparison.region)
    return edge_lift(comparison.change.dz, crack, comparison.region, comparison.scan.grid.pitch_mm)


@lru_cache(maxsize=1)
def _plates(comparison: Comparison) -> tuple[Plate, ...]:
    return find_plates(comparison, _crack(comparison), _baseline_crack(comparison.baseline))[1]


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
    plates = [plate for plate in _plates(comparison) if np.isfinite(getattr(plate, name).value)]
    measured = [getattr(plate, name) for plate in plates]
    return (
        np.array([one.value for one in measured]),
        np.array([one.sigma for one in measured]),
        np.array([plate.area.value for plate in plates]),
    )


def _covered(comparison: Comparison) -> Measurement:
    total = int(comparison.region.sum())
    if total == 0:
        return NOT_MEASURED
    return Measurement(float(np.isfinite(comparison.change.dz[comparison.region]).sum() / total), 0.0)


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
    try:
        # what takes longest does not need each other; the caches hold it for the metrics
        if {"net_volume", "crack_length"} <= set(wanted):
            side_by_side(partial(_volumes, comparison), partial(_openings, comparison))
        return {name: METRICS[name].measure(comparison) for name in wanted}
    finally:
        for cached in (_volumes, _crack, _openings, _depths, _plates):
            cached.cache_clear()
        forget_roughness()
