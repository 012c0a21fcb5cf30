"""Trends: each metric through time."""

from __future__ import annotations

import numpy as np

from pipelines.trends import Trend as FittedTrend
from pipelines.trends import trend as fit_trend

from ..charts import Trend, trend_svg
from ..findings import Findings
from ..metric_names import Named
from ..quantities import MINUS, unit_text, with_uncertainty
from ..section import Figure, Section

__all__ = ["trends"]

_PERIODS = (("day", 86400), ("hour", 3600), ("minute", 60))


def trends(findings: Findings) -> Section | None:
    """Draw one chart per metric that was ever measured."""
    if findings.last is None:
        return None
    figures = [
        _figure(findings, metric) for metric in findings.metrics if np.isfinite(findings.measured(metric.name)[0]).any()
    ]
    if not figures:
        return Section("trends", "Trends", text=("Trends begin with the second scan: the first one is the baseline.",))
    how = (
        "Everything is measured against the baseline, the first scan of the present epoch. The shaded band holds the "
        "true value with 95 % confidence (two standard uncertainties either way); the line breaks, and a cross marks "
        "the spot, where a planned visit yielded no scan. The slope is a robust straight line through all values."
    )
    return Section("trends", "Trends", text=(how,), figures=tuple(figures))


def _figure(findings: Findings, metric: Named) -> Figure:
    values, sigmas = findings.measured(metric.name)
    lost = np.array([v.planned for v in findings.visits if v.state != "taken"], dtype="datetime64[ns]")
    lines = [line for alarm in findings.limits if alarm.metric == metric.name for line in alarm.lines]
    trend = Trend(metric.label, findings.times, values, sigmas, lines, lost)
    newest = with_uncertainty(findings.newest(metric.name), metric.unit)
    count = int(np.isfinite(values).sum())
    alternative = f"{metric.title} over {count} scans; the newest value is {newest}."
    slope = _slope(fit_trend(findings.times, values, sigmas), findings.times, metric.unit)
    return Figure(trend_svg(trend, alternative), f"{metric.title}: now {newest}{slope}")


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
