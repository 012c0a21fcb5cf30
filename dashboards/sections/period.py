"""Period: when the site was watched, and when it was not."""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..findings import Findings
from ..quantities import day_and_time, span
from ..section import Section, Table

__all__ = ["period"]


def period(findings: Findings) -> Section | None:
    """Count the visits that were planned, and what became of them."""
    if not findings.visits and not findings.scans:
        return None
    ends = Counter(visit.state for visit in findings.visits)
    rows = list(_chosen(findings))
    times = findings.table.times[[findings.period.holds(time) for time in findings.table.times]]
    if len(times):
        first, last = times[0], times[-1]
        rows.append(("First scan", day_and_time(first)))
        rows.append(("Newest scan", day_and_time(last)))
        if last > first:
            rows.append(("Length of the record", span(last - first)))
    rows.append(("Visits planned", str(len(findings.visits))))
    rows += [(f"Visits {state}", str(ends[state])) for state in ("taken", "missed", "rejected", "failed")]
    if len(times) > 1:
        steps = np.diff(times)
        longest = int(np.argmax(steps))
        rows.append(("Usual time between scans", span(np.timedelta64(int(np.median(steps.astype(np.int64))), "ns"))))
        rows.append(("Longest gap between scans", f"{span(steps[longest])}, from {day_and_time(times[longest])}"))
    lost = [visit for visit in findings.visits if visit.state != "taken"]
    tables = [Table("Scans expected and taken", ("", ""), tuple(rows))]
    if lost:
        shown = lost[-20:]
        more = f"; the newest {len(shown)} of {len(lost)}" if len(lost) > len(shown) else ""
        tables.append(
            Table(
                f"Visits that yielded no scan{more}",
                ("Planned", "Ended", "Cause"),
                tuple((day_and_time(visit.planned), visit.state, visit.cause or "not recorded") for visit in shown),
            )
        )
    return Section("period", "Period and scans", tables=tuple(tables))


def _chosen(findings: Findings) -> list[tuple[str, str]]:
    """Say what part of the record and of the surface was asked for."""
    rows = []
    first, last = findings.period.first, findings.period.last
    if first is not None or last is not None:
        ends = [
            day_and_time(end) if end is not None else open_end for end, open_end in ((first, "start"), (last, "now"))
        ]
        rows.append(("Period asked for", " to ".join(ends)))
    if findings.region is not None:
        measured = f"metrics measured anew inside it, on {len(findings.times)} of {findings.scans} scans"
        rows.append(("Region asked for", f"{findings.region}; {measured}"))
    return rows
