"""Series to slopes, forecasts and alarms."""

from .alarm_state import ALARM_STATES, AlarmState

__all__ = ["ALARM_STATES", "AlarmState"]
