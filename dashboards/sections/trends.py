"""Trends: each metric through time."""

from __future__ import annotations

import numpy as np

from pipelines import ENVIRONMENT, Measurement
from pipelines.trends import Trend as FittedTrend
from pipelines.trends import change_points, correct_for, time_to_limit
from pipelines.trends import trend as fit_trend

from ..alarm_limits import Line
from ..charts import Trend, plot_of, trend_svg
from ..findings import Findings
from ..metric_names import Named
from ..quantities import MINUS, day_and_time, plain, span, unit_text, with_uncertainty
from ..section import Cell, Figure, Section, Table
from ..terms import term

__all__ = ["metric_figure", "trends"]

_PERIODS = (("day", 86400), ("hour", 3600), ("minute", 60))


def trends(findings: Findings) -> Section | None:
    """Draw one chart per metric that was ever measured."""
    if findings.last is None:
        return None
    figures = [
        metric_figure(findings, metric)
        for metric in findings.metrics
        if metric.name not in ENVIRONMENT and np.isfinite(findings.measured(metric.name)[0]).any()
    ]
    if not figures:
        return Section("trends", "Trends", text=("Trends begin with the second scan: the first one is the baseline.",))
    how = (
        "Everything is measured against the baseline, the first scan of the present epoch. The shaded band holds the "
        "true value with 95 % confidence (two standard uncertainties either way); the line breaks, and a cross marks "
        "the spot, where a planned visit yielded no scan. The slope is a robust straight line through all values."
    )
    text, tables = [how], []
    ahead = tuple(row for metric in findings.metrics for row in _ahead(findings, metric))
    if ahead:
        head: tuple[str | Cell, ...] = ("Metric", "Limit", term("rate"), "Reached, if the trend goes on")
        tables.append(Table("Time to limit", head, ahead))
    corrected = [both for metric in findings.metrics if (both := _corrected(findings, metric)) is not None]
    if corrected:
        text.append(
            "Beside it stands what the metric would be at the mean temperature and humidity: their effect, "
            f"with the lag up to {plain(findings.max_lag_hours)} h that explains most, is fitted together with the "
            "rate."
        )
        head = ("Metric", term("rate"), "Rate without the environment", "Effects", "Lag")
        tables.append(Table("Rates ± one standard uncertainty", head, tuple(row for row, _ in corrected)))
    changes = tuple(row for metric in findings.metrics for row in _changes(findings, metric))
    if changes:
        head = ("Metric", "When", "Shift", "Rate before", "Rate after")
        tables.append(Table("Where a metric took another course", head, changes))
    figures += [figure for _, figure in corrected]
    return Section("trends", "Trends", text=tuple(text), tables=tuple(tables), figures=tuple(figures))


def _ahead(findings: Findings, metric: Named) -> list[tuple[str | Cell, ...]]:
    """Say for each limit of a metric when its trend reaches it."""
    lines = [line for alarm in findings.limits if alarm.metric == metric.name for line in alarm.lines]
    since = findings.since_baseline
    times, (values, sigmas) = findings.times[since], (array[since] for array in findings.measured(metric.name))
    known = np.isfinite(values)
    if not lines or not known.any():
        return []
    fitted = fit_trend(times, values, sigmas)
    elapsed = float((times[-1] - times[known][0]) / np.timedelta64(1, "D"))
    rate = _slope(fitted, times, metric.unit).removeprefix("; ")
    unit = unit_text(metric.unit)
    return [
        (
            Cell(metric.title, link=metric.link),
            f"{line.grade} {line.side} {plain(line.value)} {unit}".rstrip(),
            rate or "fewer than three values",
            _when(fitted, elapsed, line),
        )
        for line in lines
    ]


def _when(fitted: FittedTrend, elapsed_days: float, line: Line) -> str:
    reached = time_to_limit(fitted, elapsed_days, line.value, above=line.side == "above")
    if np.isnan(reached.days):
        return "not known"
    if reached.days == 0:
        return "passed already"
    if not np.isfinite(reached.earliest):
        return "not by this trend"
    earliest, days, latest = (
        span(np.timedelta64(round(end * 86400), "s")) if np.isfinite(end) else "never"
        for end in (reached.earliest, reached.days, reached.latest)
    )
    if days == "never":
        return f"not by this trend, at the earliest in {earliest}"
    return f"in {days} (95\N{NO-BREAK SPACE}%: {earliest} to {latest})"


def _corrected(findings: Findings, metric: Named) -> tuple[tuple[str | Cell, ...], Figure] | None:
    """Take the environment out of one metric; None where it has none, or is of it."""
    drivers = {name: (findings.times, findings.measured(name)[0]) for name in ENVIRONMENT if name in findings.series}
    if metric.name in ENVIRONMENT or not drivers or findings.last is None:
        return None
    since = findings.since_baseline
    times, (values, sigmas) = findings.times[since], (array[since] for array in findings.measured(metric.name))
    known = values[np.isfinite(values)]
    if not known.size or not np.ptp(known) > 1e-9 * np.abs(known).max():
        return None  # what never changes follows nothing
    drivers = {name: driver for name, driver in drivers.items() if np.isfinite(driver[1]).any()}
    found = correct_for(times, values, sigmas, drivers, findings.max_lag_hours)
    if found is None:
        return None
    raw = fit_trend(times, values, sigmas)
    per_day = f"{metric.unit}/d" if metric.unit != "1" else "1/d"
    plainly = Measurement(raw.slope_per_day, (raw.high - raw.low) / (2 * 1.96))
    without = Measurement(found.slope_per_day, found.slope_sigma)
    effects = "; ".join(
        f"{effect.name} {with_uncertainty(Measurement(effect.per_unit, effect.sigma))} "
        f"{unit_text(metric.unit)} per {unit_text(ENVIRONMENT[effect.name])}"
        for effect in found.effects
    )
    told = with_uncertainty(without, per_day)
    title = Cell(metric.title, link=metric.link)
    row = (title, with_uncertainty(plainly, per_day), told, effects, f"{plain(found.lag_hours, 2)} h")
    trend = Trend(metric.label, times, found.values, found.sigmas)
    words = f"{metric.title} at mean {' and '.join(drivers)}: {told}"
    return row, Figure(trend_svg(trend, words), words, metric.link, plot_of(trend))


def _changes(findings: Findings, metric: Named) -> list[tuple[str | Cell, ...]]:
    """Find where a metric took another course since the baseline."""
    if findings.last is None or metric.name in ENVIRONMENT:
        return []
    since = findings.since_baseline
    per_day = f"{metric.unit}/d"
    return [
        (
            Cell(metric.title, link=metric.link),
            day_and_time(change.time),
            with_uncertainty(Measurement(change.shift, change.sigma), metric.unit),
            f"{plain(change.rate_before, 2)} {unit_text(per_day)}",
            f"{plain(change.rate_after, 2)} {unit_text(per_day)}",
        )
        for change in change_points(findings.times[since], findings.measured(metric.name)[0][since])
    ]


def metric_figure(findings: Findings, metric: Named) -> Figure:
    """Draw a metric through the period, with its band, limits, gaps and slope."""
    values, sigmas = findings.measured(metric.name)
    lost = np.array([v.planned for v in findings.visits if v.state != "taken"], dtype="datetime64[ns]")
    lines = [line for alarm in findings.limits if alarm.metric == metric.name for line in alarm.lines]
    trend = Trend(metric.label, findings.times, values, sigmas, lines, lost)
    newest = with_uncertainty(findings.newest(metric.name), metric.unit)
    count = int(np.isfinite(values).sum())
    alternative = f"{metric.title} over {count} scans; the newest value is {newest}."
    slope = _slope(fit_trend(findings.times, values, sigmas), findings.times, metric.unit)
    return Figure(
        trend_svg(trend, alternative),
        f"{metric.title}: now {newest}{slope}",
        metric.link,
        plot_of(trend),
    )


def _slope(fitted: FittedTrend, times: np.ndarray, unit: str) -> str:
    """Say a slope with its 95 % interval, per day, or per hour or minute where the record is shorter than that."""
    if not np.isfinite(fitted.slope_per_day):
        return ""
    lasted = (times[-1] - times[0]) / np.timedelta64(1, "s")
    name, share = next((name, size / 86400) for name, size in _PERIODS if lasted >= size or name == "minute")
    half = share * (fitted.high - fitted.low) / 2
    decimals = max(0, 1 - int(np.floor(np.log10(half)))) if half > 0 else 3
    per = f" {unit_text(unit)}".rstrip() + f" per {name}"
    low, high = (f"{share * end:.{decimals}f}".replace("-", MINUS) for end in (fitted.low, fitted.high))
    middle = f"{share * fitted.slope_per_day:+.{decimals}f}".replace("-", MINUS)
    sure = "" if fitted.significant else ", no trend is certain"
    return f"; {middle}{per} (95\N{NO-BREAK SPACE}%: {low} to {high}{sure})"
