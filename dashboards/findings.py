"""Findings: what a report knows of a store, read once so that its sections are pure functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipelines import AlarmState, Event, Instant, Measurement, StandingAlarm, standing_alarms
from pipelines.trends import RateMoments
from storage import About, Inbox, Store, Stored

from .alarm_limits import AlarmLimits, alarm_limits, max_lag_hours
from .metric_names import Named, name_metric
from .raster import block_mean, shrink_factor
from .visits import Visit, visits

__all__ = ["Findings", "Quality", "RateMap", "gather"]

_MOST_READ = 400
"""Scans read for quality and alarm history: a campaign of years is sampled evenly, its newest scan always in."""

_MOST_RATES = 100_000
"""Places of the map of rates."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How well one scan was measured; registration fields are empty for a baseline."""

    number: int
    epoch: int
    time: Instant
    coverage: float
    sigma_mm: float
    residual_mm: float
    verdict: str
    reason: str
    alarms: Mapping[str, AlarmState]


@dataclass(frozen=True, slots=True, eq=False)
class RateMap:
    """Rate per day of blocks of `factor` x `factor` cells and its standard uncertainty, mm; from so many scans."""

    rate: np.ndarray
    sigma: np.ndarray
    factor: int
    scans: int


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """A store as a report sees it.

    Parameters
    ----------
    about : About
    scans : int
    first, last : Stored or None
        Baseline of the newest epoch, and the newest scan; None in an empty store.
    between : tuple of Stored
        A few scans with a change, oldest first, the newest among them: what a strip of maps shows.
    series : DataFrame
        As `Store.series` gives it.
    times : ndarray of datetime64[ns], shape (scans,)
        UTC.
    metrics : tuple of Named
    limits : tuple of AlarmLimits
    visits : tuple of Visit
    events : tuple of Event
        With acknowledgements that the store's writer has yet to take in.
    quality : tuple of Quality
        Of every scan, or of an even sample of a very long campaign.
    rates : RateMap or None
        How fast each place moves, from the well registered of these scans since the baseline.
    max_lag_hours : float
        Of the campaign's environment.
    """

    about: About
    scans: int
    first: Stored | None
    last: Stored | None
    between: tuple[Stored, ...]
    series: pd.DataFrame
    times: np.ndarray
    metrics: tuple[Named, ...]
    limits: tuple[AlarmLimits, ...]
    visits: tuple[Visit, ...]
    events: tuple[Event, ...]
    quality: tuple[Quality, ...]
    rates: RateMap | None = None
    max_lag_hours: float = 0.0

    @property
    def alarms(self) -> Mapping[str, AlarmState]:
        """State of each alarm, after the newest scan or the slots since that gave none."""
        return {name: alarm.state for name, alarm in self.standing.items()}

    @property
    def standing(self) -> Mapping[str, StandingAlarm]:
        """Where each alarm stands, since when, why, and who has acknowledged it."""
        newest = self.last
        return standing_alarms(
            newest.alarms if newest is not None else {}, newest.scan.time if newest is not None else None, self.events
        )

    def measured(self, metric: str) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard uncertainties of one metric, shape (scans,) each, NaN where not measured."""
        if metric not in self.series:
            nothing = np.full(len(self.times), np.nan)
            return nothing, nothing
        values = self.series[metric].to_numpy(dtype=np.float64)
        return values, self.series[f"{metric}_sigma"].to_numpy(dtype=np.float64)

    def newest(self, metric: str) -> Measurement:
        """The newest scan's measurement of a metric, NaN where it has none."""
        values, sigmas = self.measured(metric)
        return Measurement(float(values[-1]), float(sigmas[-1])) if len(values) else Measurement(np.nan, np.nan)


def gather(store: Store, *, progress: Callable[[int, int], None] | None = None) -> Findings:
    """Read what a report needs.

    Parameters
    ----------
    store : Store
    progress : callable, optional
        Called with (scans read, scans to read).
    """
    total = len(store)
    about = store.about
    chosen = sorted({round(at) for at in np.linspace(0, total - 1, min(total, _MOST_READ))}) if total else []
    strip = set(_strip(chosen))
    kept: dict[int, Stored] = {}
    quality: list[Quality] = []
    last = store[total - 1] if total else None
    rates = _Rates(last) if last is not None else None
    planned: list[Instant] = []
    for done, number in enumerate(chosen, start=1):
        stored = store[number]
        planned.append(stored.planned)
        quality.append(_quality(stored))
        if rates is not None:
            rates.add(stored)
        if number in strip:
            kept[number] = stored
        if progress is not None:
            progress(done, len(chosen))
    first = store[last.baseline] if last is not None else None
    series = store.series()
    waiting = (event for _, event in Inbox(about.location).waiting())
    return Findings(
        about=about,
        scans=total,
        first=first,
        last=last,
        between=tuple(stored for stored in kept.values() if stored.change is not None),
        series=series,
        times=_utc(series),
        metrics=tuple(name_metric(name, unit) for name, unit in about.metrics.items()),
        limits=alarm_limits(about.campaign),
        visits=visits(store, planned if len(chosen) == total else None),
        events=(*store.events, *waiting),
        quality=tuple(quality),
        rates=rates.result() if rates is not None else None,
        max_lag_hours=max_lag_hours(about.campaign),
    )


class _Rates:
    """Gathers the rate of each place while scans are read for other reasons: the same work for any length of record."""

    def __init__(self, last: Stored) -> None:
        self._epoch, self._since = last.epoch, last.scan.time
        rows, columns = last.scan.grid.shape
        self._factor = shrink_factor(rows, columns, _MOST_RATES)
        self._moments = RateMoments((-(-rows // self._factor), -(-columns // self._factor)))
        self._scans = 0

    def add(self, stored: Stored) -> None:
        change = stored.change
        if stored.epoch != self._epoch or change is None or change.motion.verdict != "good":
            return
        day = float((stored.scan.time - self._since) / np.timedelta64(1, "D"))
        self._moments.add(day, block_mean(change.dz, self._factor))
        self._scans += 1

    def result(self) -> RateMap | None:
        rate, sigma = self._moments.rate()
        return RateMap(rate, sigma, self._factor, self._scans) if np.isfinite(rate).any() else None


def _strip(chosen: list[int], most: int = 4) -> list[int]:
    """Up to `most` scans after the first, evenly spread, the newest among them."""
    later = chosen[1:]
    if len(later) <= most:
        return later
    return [later[round(at)] for at in np.linspace(len(later) / most - 1, len(later) - 1, most)]


def _quality(stored: Stored) -> Quality:
    scan, change = stored.scan, stored.change
    sigma = scan.sigma[np.isfinite(scan.sigma)]
    motion = change.motion if change is not None else None
    return Quality(
        number=stored.number,
        epoch=stored.epoch,
        time=scan.time,
        coverage=scan.coverage,
        sigma_mm=float(np.median(sigma)) if sigma.size else float("nan"),
        residual_mm=motion.residual_mm if motion is not None else float("nan"),
        verdict=motion.verdict if motion is not None else "",
        reason=motion.reason if motion is not None else "",
        alarms=dict(stored.alarms),
    )


def _utc(series: pd.DataFrame) -> np.ndarray:
    if series.empty:
        return np.zeros(0, dtype="datetime64[ns]")
    index = pd.DatetimeIndex(series.index)
    if index.tz is not None:
        index = index.tz_convert("UTC").tz_localize(None)
    return index.to_numpy().astype("datetime64[ns]")
