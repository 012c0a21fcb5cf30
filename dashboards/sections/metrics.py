"""Metrics: every number with its uncertainty and what it means."""

from __future__ import annotations

import math

import numpy as np

from pipelines import Measurement

from ..findings import Findings
from ..quantities import with_uncertainty
from ..section import Section, Table

__all__ = ["metrics"]


def metrics(findings: Findings) -> Section | None:
    """Tabulate first, newest and difference of each metric, then the definitions."""
    if findings.last is None or not findings.metrics:
        return None
    rows: list[tuple[str, ...]] = []
    for metric in findings.metrics:
        values, sigmas = findings.measured(metric.name)
        known = np.flatnonzero(np.isfinite(values))
        if not known.size:
            rows.append((metric.title, *(["not measured"] * 3)))
            continue
        first = Measurement(float(values[known[0]]), float(sigmas[known[0]]))
        newest = findings.newest(metric.name)
        both = math.hypot(first.sigma, newest.sigma)
        difference = Measurement(newest.value - first.value, both)
        change = with_uncertainty(difference, metric.unit) if len(known) > 1 else "one value only"
        rows.append((metric.title, with_uncertainty(first, metric.unit), with_uncertainty(newest, metric.unit), change))
    tables = [
        Table(
            "First, newest and difference; ± one standard uncertainty",
            ("Metric", "First", "Newest", "Difference"),
            tuple(rows),
            numeric=(1, 2, 3),
            links={metric.title: metric.anchor for metric in findings.metrics if metric.definition},
        )
    ]
    known_words = [metric for metric in findings.metrics if metric.definition]
    if known_words:
        defined = tuple((metric.title, metric.definition, metric.uncertainty) for metric in known_words)
        anchors = {metric.title: metric.anchor for metric in known_words}
        head = ("Metric", "Definition", "Standard uncertainty")
        tables.append(Table("What they mean", head, defined, anchors=anchors))
    text = (
        "Metrics compare a scan with the baseline, so the baseline itself has none. The uncertainty of a difference "
        "takes first and newest as independent, which is cautious.",
    )
    return Section("metrics", "Numbers", text=text, tables=tuple(tables))
