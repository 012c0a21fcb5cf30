"""Definitions: what every metric and every word at the head of a table means."""

from __future__ import annotations

from ..findings import Findings
from ..section import Cell, Section, Table
from ..terms import TERMS

__all__ = ["definitions"]


def definitions(findings: Findings) -> Section | None:
    """Define the metrics of this store, and the terms that reports use."""
    if findings.last is None:
        return None
    rows = [
        (Cell(metric.title, anchor=metric.anchor), metric.definition, metric.uncertainty)
        for metric in findings.metrics
        if metric.definition
    ]
    rows += [
        (Cell(each.title, anchor=f"term-{name}"), each.definition, each.uncertainty) for name, each in TERMS.items()
    ]
    rows.sort(key=lambda row: row[0].text)
    table = Table("What the words mean", ("Word", "Definition", "Standard uncertainty"), tuple(rows))
    return Section("definitions", "Definitions", tables=(table,))
