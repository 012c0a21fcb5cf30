"""Series to slopes, forecasts and alarms."""

from .alarm_state import ALARM_STATES, AlarmState
from .limits import Limits, judge, worst_state
from .trend import Trend, trend

__all__ = ["ALARM_STATES", "AlarmState", "Limits", "Trend", "judge", "trend", "worst_state"]
