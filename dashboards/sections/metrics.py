"""Metrics: every number with its uncertainty, where it is defined, and what made it."""

from __future__ import annotations

import math

import numpy as np

from pipelines import Measurement

from ..findings import Findings
from ..quantities import with_uncertainty
from ..section import Cell, Section, Table
from .provenance import made_by

__all__ = ["metrics"]


def metrics(findings: Findings) -> Section | None:
    """Tabulate first, newest and difference of each metric."""
    if findings.last is None or not findings.metrics:
        return None
    rows: list[tuple[str | Cell, ...]] = []
    numbers = findings.series["scan"].to_numpy(dtype=np.int64)
    for metric in findings.metrics:
        title = Cell(metric.title, link=metric.link)
        values, sigmas = findings.measured(metric.name)
        known = np.flatnonzero(np.isfinite(values))
        if not known.size:
            rows.append((title, *(["not measured"] * 3)))
            continue
        first = Measurement(float(values[known[0]]), float(sigmas[known[0]]))
        newest = findings.newest(metric.name)
        both = math.hypot(first.sigma, newest.sigma)
        difference = Measurement(newest.value - first.value, both)
        rows.append(
            (
                title,
                Cell(with_uncertainty(first, metric.unit), made_by(findings, int(numbers[known[0]]))),
                Cell(with_uncertainty(newest, metric.unit), made_by(findings, int(numbers[-1]))),
                with_uncertainty(difference, metric.unit) if len(known) > 1 else "one value only",
            )
        )
    head = ("Metric", "First", "Newest", "Difference")
    table = Table("First, newest and difference; ± one standard uncertainty", head, tuple(rows), numeric=(1, 2, 3))
    text = (
        "A metric's name leads to its definition, a number to what made it. Metrics compare a scan with the baseline, "
        "so the baseline itself has none. The uncertainty of a difference "
        "takes first and newest as independent, which is cautious.",
    )
    return Section("metrics", "Numbers", text=text, tables=(table,))
