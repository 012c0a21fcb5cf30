"""Two scans of a store against each other, as the findings that the sections of a report show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from configs import InputError
from pipelines import Measurement
from pipelines.change import METRICS, compare, measure
from storage import Store, scan_table

from .campaign_text import settings_of
from .findings import Findings, Period, quality_of
from .metric_names import name_metric
from .places import places_of
from .region import Region

__all__ = ["gather_comparison"]


def gather_comparison(store: Store, before: int, after: int, region: Region | None = None) -> Findings:
    """Compare two scans directly, whatever baseline the store compared them with.

    Parameters
    ----------
    store : Store
    before, after : int
        Their numbers; the earlier one comes first in the findings.
    region : Region, optional
        Part of the surface whose cells count.

    Returns
    -------
    Findings
        With the earlier scan as `first`; the later as `last`, its change against the earlier; a series of these two,
        whose later row holds the metrics of that change.

    Raises
    ------
    InputError
        If both are one scan, or cannot be laid on each other.
    """
    first, last = (store[number] for number in sorted((before, after)))
    about, grid = store.about, store.about.grid
    if first.number == last.number:
        raise InputError(f"{about.location}: both are scan {first.number}: choose two different ones")
    assert grid is not None  # there are scans
    places = places_of(settings_of(about.campaign))
    counted, stable = places.counted_cells(grid), places.stable_cells(grid)
    if region is not None:
        counted &= region.cells(grid)
    found = compare(last.scan, first.scan, stable if stable.any() else None, counted, about.noise)
    if found.change.motion.verdict == "failed":
        raise InputError(
            f"{about.location}: scans {first.number} and {last.number} cannot be laid on each other: "
            f"{found.change.motion.reason}"
        )
    named = tuple(name_metric(name, unit) for name, unit in about.metrics.items() if name in METRICS)
    measured = measure(found, [metric.name for metric in named])
    changed = replace(last, baseline=first.number, change=found.change)
    period = Period(first.scan.time, last.scan.time)
    series = store.series().iloc[[first.number, last.number]]
    return Findings(
        about=about,
        scans=2,
        first=first,
        last=changed,
        between=(changed,),
        series=_series(series, measured),
        times=np.array([first.scan.time, last.scan.time], dtype="datetime64[ns]"),
        metrics=named,
        limits=(),
        visits=(),
        events=store.events,
        quality=(quality_of(replace(first, change=None)), quality_of(changed)),
        table=scan_table(store),
        counted=counted,
        period=period,
        region=region,
        places=places,
    )


def _series(stored: pd.DataFrame, measured: dict[str, Measurement]) -> pd.DataFrame:
    """Keep what the store has of both scans, and put beside it what was measured between them."""
    series = stored.copy()
    for name, value in measured.items():
        series[f"between_{name}"], series[f"between_{name}_sigma"] = [np.nan, value.value], [np.nan, value.sigma]
    units = dict(stored.attrs["units"])
    series.attrs["units"] = units | {f"between_{name}": units[name] for name in measured}
    return series
