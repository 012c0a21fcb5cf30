"""Verdict: green, amber, red or no data, in plain words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .findings import Findings
from .quantities import day_and_time, plain, unit_text, with_uncertainty
from .section import Tone

__all__ = ["Verdict", "judge_findings"]

_WORDS: dict[Tone, str] = {
    "green": "All is well",
    "amber": "Needs a look",
    "red": "In alarm",
    "no data": "No data",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """The first thing a report says: a tone, a headline and the reasons."""

    tone: Tone
    headline: str
    reasons: tuple[str, ...]


def judge_findings(findings: Findings) -> Verdict:
    """Weigh alarms, visits and registration of a campaign.

    Red: an alarm stands or has no data, acknowledged or not. Amber: a warning stands, an alarm was never measured, the
    store lost scans, the newest visit yielded nothing, or the newest scan's registration is not to be trusted. Green:
    none of these. No data: no scan at all.
    """
    if findings.last is None:
        return Verdict("no data", _WORDS["no data"], _why_nothing(findings))
    red = [_alarm_text(findings, name) for name, state in findings.alarms.items() if state == "alarm"]
    red += [_no_data_text(findings, name) for name, state in findings.alarms.items() if state == "no data"]
    amber = [_alarm_text(findings, name) for name, state in findings.alarms.items() if state == "warning"]
    amber += _never_measured(findings)
    amber += [f"Scans were lost, {day_and_time(e.time)}: {e.text}." for e in findings.events if e.kind == "lost"]
    newest = findings.visits[-1] if findings.visits else None
    if newest is not None and newest.state != "taken":
        cause = f": {newest.cause}" if newest.cause else ""
        amber.append(f"The newest visit, {day_and_time(newest.planned)}, was {newest.state}{cause}.")
    change = findings.last.change
    if change is not None and change.motion.verdict != "good":
        reason = f": {change.motion.reason}" if change.motion.reason else ""
        amber.append(f"Registration of the newest scan is {change.motion.verdict}{reason}; its numbers may mislead.")
    if red:
        return Verdict("red", _WORDS["red"], tuple(red + amber))
    if amber:
        return Verdict("amber", _WORDS["amber"], tuple(amber))
    watched = len(findings.alarms)
    within = "The one alarm is within its limits." if watched == 1 else f"All {watched} alarms are within their limits."
    return Verdict("green", _WORDS["green"], (within if watched else "No alarm is set; the newest scan was measured.",))


def _no_data_text(findings: Findings, name: str) -> str:
    alarm = findings.standing[name]
    return f"{name}: no data{', ' + alarm.why if alarm.why else ''}.{_seen(findings, name)}"


def _never_measured(findings: Findings) -> list[str]:
    """Alarms on something that no scan since the baseline has shown: they cannot go off."""
    if findings.last is None or findings.last.change is None:
        return []
    return [
        f"{alarm.name}: not measured yet, so it cannot go off."
        for alarm in findings.limits
        if findings.alarms.get(alarm.name) == "ok"
        and any(metric.name == alarm.metric for metric in findings.metrics)
        and not np.isfinite(findings.measured(alarm.metric)[0][findings.since_baseline]).any()
    ]


def _seen(findings: Findings, name: str) -> str:
    """Say who has acknowledged an alarm."""
    seen = findings.standing[name].acknowledged
    return f" {seen.told[:1].upper()}{seen.told[1:]} ({day_and_time(seen.time)})." if seen is not None else ""


def _why_nothing(findings: Findings) -> tuple[str, ...]:
    lost = [visit for visit in findings.visits if visit.state != "taken"]
    if not lost:
        return ("The store holds no scan yet: run the campaign, then write this report again.",)
    last = lost[-1]
    cause = f" The last one, {day_and_time(last.planned)}: {last.cause}." if last.cause else ""
    count = f"All {len(lost)} visits" if len(lost) > 1 else "The only visit"
    return (f"{count} yielded no scan.{cause}",)


def _alarm_text(findings: Findings, name: str) -> str:
    """Say an alarm with its value and the limit it passed, where the campaign text tells."""
    state = findings.alarms[name]
    for alarm in findings.limits:
        if alarm.name != name:
            continue
        named = next((metric for metric in findings.metrics if metric.name == alarm.metric), None)
        if named is None:
            continue
        value = findings.newest(alarm.metric)
        passed = [
            line
            for line in alarm.lines
            if line.grade == state and (value.value > line.value if line.side == "above" else value.value < line.value)
        ]
        limit = (
            f", {passed[0].side} the limit of {plain(passed[0].value)} {unit_text(named.unit)}".rstrip()
            if passed
            else ""
        )
        called = "" if name.casefold() == named.title.casefold() else f" (alarm: {name})"
        why = findings.standing[name].why
        rule = "" if limit or not why else f": {why}"
        return f"{named.title} is {with_uncertainty(value, named.unit)}{limit}{called}{rule}.{_seen(findings, name)}"
    return f"{name}: {state}.{_seen(findings, name)}"
