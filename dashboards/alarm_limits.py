"""The limits that a campaign set, read back from the campaign text that its store keeps."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["AlarmLimits", "Line", "alarm_limits"]


@dataclass(frozen=True, slots=True)
class Line:
    """One limit: ``warning`` or ``alarm``, above or below a value in the metric's unit."""

    grade: str
    side: str
    value: float


@dataclass(frozen=True, slots=True)
class AlarmLimits:
    """An alarm of the campaign: its name, its metric and its limits."""

    name: str
    metric: str
    lines: tuple[Line, ...]


def alarm_limits(campaign: str) -> tuple[AlarmLimits, ...]:
    """Find the alarms in a campaign file's text; none where it is empty or of a version that had other keys.

    The text is read as YAML and not as a `Campaign`: a report must not fail because a rig's options have changed since.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    if not campaign.strip():
        return ()
    try:
        settings = YAML(typ="safe", pure=True).load(campaign)
    except YAMLError:
        return ()
    alarms = settings.get("alarms") if isinstance(settings, dict) else None
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
        found.append(AlarmLimits(str(alarm.get("name", alarm["metric"])), alarm["metric"], tuple(lines)))
    return tuple(found)
