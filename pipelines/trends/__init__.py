"""Series to slopes, forecasts and alarms."""

from .alarm_rule import AlarmRule, Decision, decide
from .alarm_state import ALARM_STATES, AlarmState
from .control import Chart, ControlChart, control_chart, run_length, standard_residuals, threshold
from .forecast import TimeToLimit, time_to_limit
from .limits import Limits, judge, worst_state
from .trend import Trend, trend

__all__ = [
    "ALARM_STATES",
    "AlarmRule",
    "AlarmState",
    "Chart",
    "ControlChart",
    "Decision",
    "Limits",
    "TimeToLimit",
    "Trend",
    "control_chart",
    "decide",
    "judge",
    "run_length",
    "standard_residuals",
    "threshold",
    "time_to_limit",
    "trend",
    "worst_state",
]
