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
    rows: list[tuple[str, str]] = []
    if len(findings.times):
        first, last = findings.times[0], findings.times[-1]
        rows.append(("First scan", day_and_time(first)))
        rows.append(("Newest scan", day_and_time(last)))
        if last > first:
            rows.append(("Length of the record", span(last - first)))
    rows.append(("Visits planned", str(len(findings.visits))))
    rows += [(f"Visits {state}", str(ends[state])) for state in ("taken", "missed", "rejected", "failed")]
    if len(findings.times) > 1:
        steps = np.diff(findings.times)
        longest = int(np.argmax(steps))
        rows.append(("Usual time between scans", span(np.timedelta64(int(np.median(steps.astype(np.int64))), "ns"))))
        rows.append(
            ("Longest time between scans", f"{span(steps[longest])}, from {day_and_time(findings.times[longest])}")
        )
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
