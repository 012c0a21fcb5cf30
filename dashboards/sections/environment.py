"""Environment: temperature and humidity beside the scans."""

from __future__ import annotations

import numpy as np

from pipelines import ENVIRONMENT

from ..findings import Findings
from ..quantities import plain, unit_text, with_uncertainty
from ..section import Cell, Section, Table
from .trends import metric_figure

__all__ = ["environment"]


def environment(findings: Findings) -> Section | None:
    """Tabulate the range of each, and draw its course."""
    metrics = [
        metric
        for metric in findings.metrics
        if metric.name in ENVIRONMENT and np.isfinite(findings.measured(metric.name)[0]).any()
    ]
    if not metrics:
        return None
    rows: list[tuple[str | Cell, ...]] = []
    for metric in metrics:
        values = findings.measured(metric.name)[0]
        known = values[np.isfinite(values)]
        unit = unit_text(metric.unit)
        spread = (f"{plain(float(each), 3)} {unit}" for each in (known.min(), known.mean(), known.max()))
        newest = with_uncertainty(findings.newest(metric.name), metric.unit)
        rows.append((Cell(metric.title, link=metric.link), *spread, newest, f"{known.size} of {len(values)}"))
    head = ("Quantity", "Lowest", "Mean", "Highest", "Newest", "Scans with a value")
    table = Table("At the time of the scans", head, tuple(rows), numeric=(1, 2, 3, 4, 5))
    figures = tuple(metric_figure(findings, metric) for metric in metrics)
    text = ("Kept once per scan; where a metric follows them, the trends show it with their effect taken out.",)
    return Section("environment", "Environment", text, (table,), figures)
