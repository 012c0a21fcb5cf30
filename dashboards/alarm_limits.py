"""The limits that a campaign set, read back from the campaign text that its store keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .campaign_text import settings_of

__all__ = ["AlarmLimits", "Line", "alarm_limits", "rule_words"]


@dataclass(frozen=True, slots=True)
class Line:
    """One limit: ``warning`` or ``alarm``, above or below a value in the metric's unit."""

    grade: str
    side: str
    value: float


@dataclass(frozen=True, slots=True)
class AlarmLimits:
    """An alarm of the campaign: its name, its metric, its limits, and the rest of its rule in words."""

    name: str
    metric: str
    lines: tuple[Line, ...]
    rules: tuple[str, ...] = ()


def alarm_limits(campaign: str) -> tuple[AlarmLimits, ...]:
    """Find the alarms in a campaign file's text; none where it is empty or of a version that had other keys."""
    alarms = settings_of(campaign).get("alarms")
    found: list[AlarmLimits] = []
    for alarm in alarms if isinstance(alarms, list) else []:
        if not isinstance(alarm, dict) or not isinstance(alarm.get("metric"), str):
            continue
        lines = [
            Line(grade, side, float(alarm[key]))
            for key, grade, side in (
                ("warn_above", "warning", "above"),
                ("alarm_above", "alarm", "above"),
                ("warn_below", "warning", "below"),
                ("alarm_below", "alarm", "below"),
            )
            if isinstance(alarm.get(key), int | float)
        ]
        found.append(
            AlarmLimits(str(alarm.get("name", alarm["metric"])), alarm["metric"], tuple(lines), rule_words(alarm))
        )
    return tuple(found)


def rule_words(alarm: Mapping[str, Any]) -> tuple[str, ...]:
    """Say what else raises an alarm than a limit of the value, and how it falls back."""

    def number(key: str) -> str:
        value = alarm.get(key)
        return f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else ""

    words = []
    back = f" over {number('window_days')} days" if number("window_days") else ""
    for grade in ("warn", "alarm"):
        for side in ("above", "below"):
            rate = number(f"{grade}_rate_{side}_per_day")
            if rate:
                words.append(f"{'warning' if grade == 'warn' else grade} {side} {rate} per day{back}")
    if number("within_days"):
        words.append(f"warning if the trend{back} reaches a limit within {number('within_days')} days")
    chart = alarm.get("chart")
    if isinstance(chart, str):
        every = number("false_alarm_every_scans") or "400"
        words.append(f"{chart.upper()} chart, one false alarm in {every} scans")
    confirm = alarm.get("confirm")
    if isinstance(confirm, list | tuple) and len(confirm) == 2 and confirm[1] != 1:
        words.append(f"{confirm[0]} of {confirm[1]} values must be beyond a limit")
    if number("clear_by") not in ("", "0"):
        words.append(f"falls back {number('clear_by')} inside its limit")
    words.append(f"no data after {number('no_data_after_slots') or '3'} slots")
    return tuple(words)
