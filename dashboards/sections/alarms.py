"""Alarms: where each one stands, since when, and what was done about it."""

from __future__ import annotations

from ..findings import Findings
from ..quantities import day_and_time, plain, unit_text, with_uncertainty
from ..section import Section, Table

__all__ = ["alarms"]


def alarms(findings: Findings) -> Section | None:
    """List the alarms with their limits and every change of state."""
    if findings.last is None:
        return None
    if not findings.alarms:
        return Section("alarms", "Alarms", text=("This campaign sets no alarm.",))
    set_by = {alarm.name: alarm for alarm in findings.limits}
    named = {metric.name: metric for metric in findings.metrics}
    rows: list[tuple[str, ...]] = []
    for name, state in findings.alarms.items():
        alarm = set_by.get(name)
        metric = named.get(alarm.metric) if alarm is not None else None
        value = with_uncertainty(findings.newest(metric.name), metric.unit) if metric is not None else ""
        unit = unit_text(metric.unit) if metric is not None else ""
        limits = [
            f"{line.grade} {line.side} {plain(line.value)} {unit}".rstrip()
            for line in (alarm.lines if alarm is not None else ())
        ]
        rule = "; ".join((*limits, *(alarm.rules if alarm is not None else ())))
        stands = findings.standing[name]
        seen = "" if state == "ok" else "not acknowledged"
        if stands.acknowledged is not None:
            seen = f"{stands.acknowledged.told}, {day_and_time(stands.acknowledged.time)}"
        since = day_and_time(stands.since) if stands.since is not None else _since(findings, name)
        rows.append((name, state, since, value, stands.why if state != "ok" else "", seen, rule))
    head = ("Alarm", "State", "Since", "Newest value", "Why", "Acknowledged", "Rule")
    standing = Table("Where the alarms stand", head, tuple(rows), numeric=(3,))
    changes = [event for event in findings.events if event.kind in ("alarm", "acknowledged")]
    tables = [standing]
    if changes:
        tables.append(
            Table(
                "Changes of state and acknowledgements",
                ("When", "What", "Remark"),
                tuple((day_and_time(event.time), event.kind, event.text) for event in changes[-30:]),
            )
        )
    return Section("alarms", "Alarms", tables=tuple(tables))


def _since(findings: Findings, name: str) -> str:
    """Time of the first scan of the unbroken stretch in which the alarm has had its present state."""
    state = findings.alarms[name]
    since = None
    for scan in reversed(findings.quality):
        if scan.alarms.get(name) != state:
            break
        since = scan.time
    return day_and_time(since) if since is not None else ""
