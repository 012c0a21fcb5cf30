"""Findings: what a report knows of a store, read once so that its sections are pure functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pandas as pd

from configs import InputError
from pipelines import AlarmState, Event, Instant, Measurement, StandingAlarm, format_instant, standing_alarms
from storage import About, ScanTable, Store, Stored, scan_table

from .alarm_limits import AlarmLimits, alarm_limits
from .campaign_text import max_lag_hours, settings_of
from .happened import known_events
from .metric_names import Named, name_metric
from .places import Places, places_of
from .rates import RateMap, rate_map_of
from .region import Region, measure_inside
from .visits import Visit, visits

__all__ = ["Findings", "Period", "Quality", "gather", "gather_numbers", "quality_of"]

_MOST_READ = 32
"""Scans whose cells are read: a long campaign is sampled evenly, its newest scan always in."""

_MEASURED_CELLS = 40_000_000
"""Inside a region all scans are measured that have so many cells together: a minute of one core."""


@dataclass(frozen=True, slots=True)
class Period:
    """What of a record a report is about: from one instant to another, both included; None leaves that end open."""

    first: Instant | None = None
    last: Instant | None = None

    def holds(self, moment: Instant) -> bool:
        """Whether it holds an instant."""
        return not ((self.first is not None and moment < self.first) or (self.last is not None and moment > self.last))


@dataclass(frozen=True, slots=True)
class Quality:
    """How well one scan was measured; registration and level of detection are empty for a baseline."""

    number: int
    epoch: int
    time: Instant
    coverage: float
    sigma_mm: float
    lod_mm: float
    residual_mm: float
    verdict: str
    reason: str
    alarms: Mapping[str, AlarmState]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """A store as a report sees it.

    Parameters
    ----------
    about : About
    scans : int
        Of the period.
    first, last : Stored or None
        Baseline of the newest epoch, and the period's newest scan; None without one.
    between : tuple of Stored
        A few scans with a change, oldest first, the newest among them: what a strip of maps shows.
    series : DataFrame
        As `Store.series` gives it, of the period; inside a region measured anew, for the scans that were read.
    times : ndarray of datetime64[ns], shape (rows of the series,)
        UTC.
    metrics : tuple of Named
    limits : tuple of AlarmLimits
    visits : tuple of Visit
        Of the period.
    events : tuple of Event
        Until the end of the period, with acknowledgements that the store's writer has yet to take in.
    quality : tuple of Quality
        Of every scan, or of an even sample of a long campaign.
    table : ScanTable
        Of the whole store.
    counted : ndarray of bool, shape (rows, columns)
        Cells that count: the campaign's region or the report's, less what holds still. Empty without a grid.
    period : Period
    region : Region or None
        Part of the surface that the report is about.
    places : Places
        The campaign's polygons.
    rates : RateMap or None
        How fast each place moves.
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
    table: ScanTable
    counted: npt.NDArray[np.bool_]
    period: Period = field(default_factory=Period)
    region: Region | None = None
    places: Places = field(default_factory=Places)
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

    @property
    def happened(self) -> tuple[Event, ...]:
        """The events of the period."""
        return tuple(event for event in self.events if self.period.holds(event.time))

    @property
    def since_baseline(self) -> slice:
        """Rows of the series since the newest epoch's baseline: rates are of one baseline."""
        baseline = self.last.baseline if self.last is not None else 0
        return slice(int(np.searchsorted(self.series["scan"].to_numpy(), baseline)) if len(self.series) else 0, None)

    def measured(self, metric: str) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard uncertainties of one metric, shape (rows,) each, NaN where not measured."""
        if metric not in self.series:
            nothing = np.full(len(self.times), np.nan)
            return nothing, nothing
        values = self.series[metric].to_numpy(dtype=np.float64)
        return values, self.series[f"{metric}_sigma"].to_numpy(dtype=np.float64)

    def newest(self, metric: str) -> Measurement:
        """The newest scan's measurement of a metric, NaN where it has none."""
        values, sigmas = self.measured(metric)
        return Measurement(float(values[-1]), float(sigmas[-1])) if len(values) else Measurement(np.nan, np.nan)


def gather(
    store: Store,
    *,
    period: Period | None = None,
    region: Region | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Findings:
    """Read what a report needs.

    Parameters
    ----------
    store : Store
    period : Period, optional
        The whole record unless given.
    region : Region, optional
        Part of the surface: metrics are measured anew inside it, on the scans that are read.
    progress : callable, optional
        Called with (scans read, scans to read).

    Raises
    ------
    InputError
        If the period holds no scan of a store that has some, or the region no cell.
    """
    about, table = store.about, scan_table(store)
    settings, period = settings_of(about.campaign), period or Period()
    places = places_of(settings)
    inside = _inside(about.location, table.times, period)
    counted = places.counted_cells(about.grid) if about.grid is not None else np.zeros((0, 0), np.bool_)
    if region is not None and about.grid is not None:
        counted = counted & region.cells(about.grid)
    last = store[inside[-1]] if inside else None
    first = store[last.baseline] if last is not None else None
    most = _MOST_READ
    if region is not None and about.grid is not None:
        most = max(most, _MEASURED_CELLS // (about.grid.rows * about.grid.columns))
    chosen = _spread(inside, most)
    strip = set(_strip(chosen))
    kept: dict[int, Stored] = {}
    quality: list[Quality] = []
    anew: dict[int, dict[str, Measurement]] = {}
    for done, number in enumerate(chosen, start=1):
        stored = last if last is not None and number == last.number else store[number]
        quality.append(quality_of(stored))
        if region is not None and about.grid is not None:
            base = first if first is not None and first.number == stored.baseline else store[stored.baseline]
            still = places.stable_cells(about.grid)
            anew[number] = measure_inside(base, stored, counted, still, about.metrics, about.noise)
        if number in strip:
            kept[number] = stored
        if progress is not None:
            progress(done, len(chosen))
    series = store.series().iloc[inside]
    if region is not None:
        series = _measured_anew(series, anew)
    return Findings(
        about=about,
        scans=len(inside),
        first=first,
        last=last,
        between=tuple(stored for stored in kept.values() if stored.change is not None),
        series=series,
        times=_utc(series),
        metrics=tuple(name_metric(name, unit) for name, unit in about.metrics.items()),
        limits=alarm_limits(about.campaign),
        visits=tuple(each for each in visits(store, list(table.planned)) if period.holds(each.planned)),
        events=tuple(each for each in known_events(store) if period.last is None or each.time <= period.last),
        quality=tuple(quality),
        table=table,
        counted=counted,
        period=period,
        region=region,
        places=places,
        rates=rate_map_of(store, table, inside),
        max_lag_hours=max_lag_hours(settings),
    )


def gather_numbers(store: Store, period: Period, most: int) -> list[int]:
    """Give up to `most` scans of a period, evenly spread.

    Raises
    ------
    InputError
        If it holds none of a store that has some.
    """
    return _spread(_inside(store.about.location, scan_table(store).times, period), most)


def _inside(location: str, times: npt.NDArray[np.datetime64], period: Period) -> list[int]:
    inside = [number for number, time in enumerate(times) if period.holds(time)]
    if len(times) and not inside:
        span = f"{format_instant(times[0])} to {format_instant(times[-1])}"
        raise InputError(f"{location}: no scan lies in that period; there are {len(times)} from {span}")
    return inside


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    """Up to `most` of some numbers, evenly spread, both ends among them."""
    if not numbers:
        return []
    return sorted({numbers[round(at)] for at in np.linspace(0, len(numbers) - 1, min(len(numbers), most))})


def _measured_anew(series: pd.DataFrame, anew: Mapping[int, Mapping[str, Measurement]]) -> pd.DataFrame:
    """Put what was measured inside a region in the place of the store's own numbers, for those scans alone."""
    kept = series[series["scan"].isin(list(anew))].copy()
    numbers = kept["scan"].astype(int).tolist()
    for name in dict.fromkeys(name for measured in anew.values() for name in measured):
        inside = [anew[number].get(name, Measurement(np.nan, np.nan)) for number in numbers]
        kept[name], kept[f"{name}_sigma"] = [each.value for each in inside], [each.sigma for each in inside]
    kept.attrs = dict(series.attrs)
    return kept


def _strip(chosen: list[int], most: int = 4) -> list[int]:
    """Up to `most` scans after the first, evenly spread, the newest among them."""
    later = chosen[1:]
    if len(later) <= most:
        return later
    return [later[round(at)] for at in np.linspace(len(later) / most - 1, len(later) - 1, most)]


def quality_of(stored: Stored) -> Quality:
    """Say how well a scan was measured and registered."""
    scan, change = stored.scan, stored.change
    sigma = scan.sigma[np.isfinite(scan.sigma)]
    motion = change.motion if change is not None else None
    return Quality(
        number=stored.number,
        epoch=stored.epoch,
        time=scan.time,
        coverage=scan.coverage,
        sigma_mm=float(np.median(sigma)) if sigma.size else float("nan"),
        lod_mm=float(np.nanmedian(change.lod)) if change is not None and np.isfinite(change.lod).any() else np.nan,
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
