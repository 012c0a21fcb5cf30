"""Alarms: where each one stands, since when, and what was done about it; and every time that a limit was passed."""

from __future__ import annotations

from pipelines import ALARM_STATES, Acknowledgement, AlarmChange, acknowledgements, alarm_changes

from ..findings import Findings
from ..quantities import day_and_time, plain, unit_text, with_uncertainty
from ..section import Cell, Section, Table

__all__ = ["alarms"]

_MOST_ROWS = 40


def alarms(findings: Findings) -> Section | None:
    """List the alarms with their rules, then the exceedances with what was done about each."""
    if findings.last is None:
        return None
    if not findings.alarms:
        return Section("alarms", "Alarms", text=("This campaign sets no alarm.",))
    set_by = {alarm.name: alarm for alarm in findings.limits}
    named = {metric.name: metric for metric in findings.metrics}
    rows: list[tuple[str | Cell, ...]] = []
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
        linked = Cell(value, link=metric.link if metric is not None else "")
        rows.append((name, state, since, linked, stands.why if state != "ok" else "", seen, rule))
    head = ("Alarm", "State", "Since", "Newest value", "Why", "Acknowledged", "Rule")
    tables = [Table("Where the alarms stand", head, tuple(rows), numeric=(3,))]
    exceedances = _exceedances(findings)
    if exceedances:
        shown = exceedances[-_MOST_ROWS:]
        more = f"; the newest {len(shown)} of {len(exceedances)}" if len(shown) < len(exceedances) else ""
        caption = f"Exceedances, and what was done about them{more}"
        tables.append(Table(caption, ("Alarm", "Worst", "From", "To", "Why", "Action"), tuple(shown)))
    return Section("alarms", "Alarms", tables=tuple(tables))


def _exceedances(findings: Findings) -> list[tuple[str, ...]]:
    """Give each stretch of the period in which an alarm was not ok: its worst state, and who did what meanwhile."""
    told: list[AlarmChange | Acknowledgement] = [*alarm_changes(findings.events), *acknowledgements(findings.events)]
    told.sort(key=lambda each: each.time)
    running: dict[str, list[AlarmChange | Acknowledgement]] = {}
    ended: list[tuple[list[AlarmChange | Acknowledgement], AlarmChange | None]] = []
    for each in told:
        if isinstance(each, AlarmChange) and each.after == "ok":
            if each.name in running:
                ended.append((running.pop(each.name), each))
        elif each.name in running or isinstance(each, AlarmChange):
            running.setdefault(each.name, []).append(each)
    ended += [(stretch, None) for stretch in running.values()]
    ended.sort(key=lambda pair: pair[0][0].time)
    return [_row(stretch, end) for stretch, end in ended if end is None or findings.period.holds(end.time)]


def _row(stretch: list[AlarmChange | Acknowledgement], end: AlarmChange | None) -> tuple[str, ...]:
    changes = [each for each in stretch if isinstance(each, AlarmChange)]
    worst = max(changes, key=lambda change: ALARM_STATES.index(change.after))
    actions = [f"{each.told}, {day_and_time(each.time)}" for each in stretch if isinstance(each, Acknowledgement)]
    until = day_and_time(end.time) if end is not None else "still"
    done = "; ".join(actions) or "none recorded"
    return (worst.name, worst.after, day_and_time(changes[0].time), until, worst.why, done)


def _since(findings: Findings, name: str) -> str:
    """Time of the first scan of the unbroken stretch in which the alarm has had its present state."""
    state = findings.alarms[name]
    since = None
    for scan in reversed(findings.quality):
        if scan.alarms.get(name) != state:
            break
        since = scan.time
    return day_and_time(since) if since is not None else ""
