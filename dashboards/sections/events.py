"""Events: what happened, newest first."""

from __future__ import annotations

from ..findings import Findings
from ..quantities import day_and_time
from ..section import Section, Table

__all__ = ["events"]

_MOST_ROWS = 60


def events(findings: Findings) -> Section | None:
    """List failures, missed visits, alarms and remarks."""
    events = findings.happened
    if not events:
        return None
    newest = events[::-1][:_MOST_ROWS]
    rows = tuple((day_and_time(event.time), event.kind, event.text) for event in newest)
    more = f", the newest {len(newest)} of {len(events)}" if len(newest) < len(events) else ""
    return Section("events", "Events", tables=(Table(f"Newest first{more}", ("When", "What", "Remark"), rows),))
