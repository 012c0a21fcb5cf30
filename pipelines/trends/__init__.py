"""Series to slopes, forecasts and alarms."""

from .alarm_rule import AlarmRule, Decision
from .alarm_state import ALARM_STATES, AlarmState
from .change_points import ChangePoint, change_points
from .control import Chart, Charted, ControlChart, Model, charted, control_chart, run_length, threshold
from .environment import ENVIRONMENT, Corrected, Effect, correct_for, followed
from .forecast import TimeToLimit, time_to_limit
from .limits import Limits, judge, worst_state
from .rates import RateMoments
from .trend import Trend, trend
from .watch import Watch, aired, decide, remembered, silent, watched

__all__ = [
    "ALARM_STATES",
    "ENVIRONMENT",
    "AlarmRule",
    "AlarmState",
    "ChangePoint",
    "Chart",
    "Charted",
    "ControlChart",
    "Corrected",
    "Decision",
    "Effect",
    "Limits",
    "Model",
    "RateMoments",
    "TimeToLimit",
    "Trend",
    "Watch",
    "aired",
    "change_points",
    "charted",
    "control_chart",
    "correct_for",
    "decide",
    "followed",
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
