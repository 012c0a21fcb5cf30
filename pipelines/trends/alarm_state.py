"""AlarmState: where an alarm stands."""

from __future__ import annotations

from typing import Literal, get_args

__all__ = ["ALARM_STATES", "AlarmState"]

AlarmState = Literal["ok", "warning", "alarm", "no data"]
ALARM_STATES: tuple[AlarmState, ...] = get_args(AlarmState)
"""From harmless to grave; "no data" stands last because silence is an alarm too."""
