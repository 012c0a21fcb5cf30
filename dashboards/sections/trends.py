"""Trends: each metric through time."""

from __future__ import annotations

import numpy as np

from ..charts import Trend, trend_svg
from ..findings import Findings
from ..metric_names import Named
from ..quantities import with_uncertainty
from ..section import Figure, Section

__all__ = ["trends"]


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
        "the spot, where a planned visit yielded no scan."
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
    return Figure(trend_svg(trend, alternative), f"{metric.title}: now {newest}")
