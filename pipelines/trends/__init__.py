"""Series to slopes, forecasts and alarms."""

from .alarm_rule import AlarmRule, Decision
from .alarm_state import ALARM_STATES, AlarmState
from .control import Chart, Charted, ControlChart, Model, charted, control_chart, run_length, threshold
from .forecast import TimeToLimit, time_to_limit
from .limits import Limits, judge, worst_state
from .trend import Trend, trend
from .watch import Watch, decide, remembered, silent, watched

__all__ = [
    "ALARM_STATES",
    "AlarmRule",
    "AlarmState",
    "Chart",
    "Charted",
    "ControlChart",
    "Decision",
    "Limits",
    "Model",
    "TimeToLimit",
    "Trend",
    "Watch",
    "charted",
    "control_chart",
    "decide",
    "judge",
    "remembered",
    "run_length",
    "silent",
    "threshold",
    "time_to_limit",
    "trend",
    "watched",
    "worst_state",
]
