"""Between: what changed from one scan to another, in words and numbers."""

from __future__ import annotations

import numpy as np

from pipelines import Measurement

from ..findings import Findings
from ..plain_words import said_of_volume
from ..quantities import day_and_time, plain, span, with_uncertainty
from ..section import Cell, Section, Table
from .provenance import made_by

__all__ = ["between", "between_numbers"]


def between(findings: Findings) -> Section:
    """Say in words what changed between the two scans."""
    first, last = findings.first, findings.last
    assert first is not None
    assert last is not None
    assert last.change is not None
    change = last.change
    text = [
        f"Scan {first.number} of {day_and_time(first.scan.time)} against scan {last.number} of "
        f"{day_and_time(last.scan.time)}, {span(last.scan.time - first.scan.time)} later."
    ]
    known = np.isfinite(change.dz) & findings.counted
    if known.any():
        moved = change.significant & known
        share = 100 * float(moved.sum()) / float(known.sum())
        text.append(
            f"{plain(share, 3)}\N{NO-BREAK SPACE}% of what both scans measured changed by more than they can be wrong "
            f"(95\N{NO-BREAK SPACE}%)."
        )
    if any(metric.name == "net_volume" for metric in findings.metrics):
        text += said_of_volume(findings.newest("between_net_volume"), "between the two")
    if change.motion.verdict != "good":
        reason = f": {change.motion.reason}" if change.motion.reason else ""
        text.append(f"How the two lie on each other is {change.motion.verdict}{reason}; the numbers may mislead.")
    elif change.motion.reason:
        text.append(f"For the later scan {change.motion.reason}.")
    if findings.region is not None:
        text.append(f"Only the region {findings.region} counts.")
    text.append("Behind ± stands one standard uncertainty: two in three true values lie within it.")
    return Section("between", "What changed", text=tuple(text))


def between_numbers(findings: Findings) -> Section | None:
    """Tabulate the metrics of the change between the two, beside what the store has of each scan."""
    if not findings.metrics:
        return None
    before, after = (int(number) for number in findings.series["scan"])
    rows: list[tuple[str | Cell, ...]] = []
    for metric in findings.metrics:
        values, sigmas = findings.measured(metric.name)
        kept = [
            with_uncertainty(Measurement(float(v), float(s)), metric.unit) for v, s in zip(values, sigmas, strict=True)
        ]
        rows.append(
            (
                Cell(metric.title, link=metric.link),
                with_uncertainty(findings.newest(f"between_{metric.name}"), metric.unit),
                Cell(kept[0], made_by(findings, before)),
                Cell(kept[1], made_by(findings, after)),
            )
        )
    head = ("Metric", "Between the two", f"Scan {before}, since its baseline", f"Scan {after}, since its baseline")
    table = Table("± one standard uncertainty", head, tuple(rows), numeric=(1, 2, 3))
    text = ("Between the two: measured on the change from the earlier to the later scan, laid on each other anew.",)
    return Section("metrics", "Numbers", text=text, tables=(table,))
