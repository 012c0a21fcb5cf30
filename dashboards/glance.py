"""Glance: a store's newest maps, trends and events for a status page, read in a moment however long the campaign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipelines import Event, Measurement
from storage import Store, Stored

from .alarm_limits import alarm_limits
from .charts import Trend, trend_svg
from .maps import change_map, height_map
from .metric_names import name_metric
from .quantities import day_and_time, with_uncertainty
from .raster import change_limit, height_ends, texture_png
from .section import Figure
from .visits import Visit, visits

__all__ = ["Glance", "glance", "newest_picture"]

RECENT = 400
"""Scans whose values are drawn."""

EVENTS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Glance:
    """A store at a glance.

    Parameters
    ----------
    number : int or None
        The newest scan; None in an empty store.
    maps, trends : tuple of Figure
        Height and change of the newest scan; the newest values of each metric.
    events : tuple of Event
        The newest first.
    newest : dict of str to str
        Each metric's title and newest value with its uncertainty, in words.
    """

    number: int | None
    maps: tuple[Figure, ...]
    trends: tuple[Figure, ...]
    events: tuple[Event, ...]
    newest: dict[str, str]


def glance(store: Store) -> Glance:
    """Read what a status page shows."""
    events = tuple(reversed(store.events[-EVENTS:]))
    if not len(store):
        return Glance(None, (), (), events, {})
    last = store[-1]
    trends, newest = _trends(store)
    return Glance(last.number, _maps(last), trends, events, newest)


def newest_picture(store: Store) -> bytes | None:
    """Give the camera's picture of the newest scan as PNG, largest y on top; None in an empty store."""
    return texture_png(store[-1].scan.texture, 300_000) if len(store) else None


def _maps(last: Stored) -> tuple[Figure, ...]:
    when = day_and_time(last.scan.time)
    figures = []
    if np.isfinite(last.scan.height).any():
        svg = height_map(last.scan, height_ends(last.scan.height), f"Height map of scan {last.number}.")
        figures.append(Figure(svg, f"Height, scan {last.number}, {when}"))
    if last.change is not None:
        limit = change_limit(last.change.dz)
        svg = change_map(last.scan, last.change, limit, f"Change of scan {last.number} since scan {last.baseline}.")
        figures.append(Figure(svg, f"Change since scan {last.baseline}: blue came nearer, red sank away"))
    return tuple(figures)


def _trends(store: Store) -> tuple[tuple[Figure, ...], dict[str, str]]:
    series = store.series().iloc[-RECENT:]
    times = series.index.tz_convert("UTC").tz_localize(None).to_numpy().astype("datetime64[ns]")  # type: ignore[attr-defined]  # the store gives a DatetimeIndex
    lost = _lost(visits(store, ()), times[0])
    limits = alarm_limits(store.about.campaign)
    figures, newest = [], {}
    for name, unit in store.about.metrics.items():
        values = series[name].to_numpy(dtype=np.float64)
        sigmas = series[f"{name}_sigma"].to_numpy(dtype=np.float64)
        if not np.isfinite(values).any():
            continue
        metric = name_metric(name, unit)
        told = with_uncertainty(Measurement(float(values[-1]), float(sigmas[-1])), unit)
        lines = [line for alarm in limits if alarm.metric == name for line in alarm.lines]
        svg = trend_svg(Trend(metric.label, times, values, sigmas, lines, lost), f"{metric.title}, now {told}.")
        figures.append(Figure(svg, f"{metric.title}: now {told}"))
        newest[metric.title] = told
    return tuple(figures), newest


def _lost(known: tuple[Visit, ...], since: np.datetime64) -> np.ndarray:
    planned = [visit.planned for visit in known if visit.state != "taken" and visit.planned >= since]
    return np.array(planned, dtype="datetime64[ns]")
