"""Pure pipelines: arrays in, values out. No disk, clock, hardware or log.

Three rooms know only this package's values (`Grid`, `Scan`, instants) and themselves: `reconstruction` (frames to
height maps), `change` (two height maps to what moved) and `trends` (series to slopes and alarms); `scenes` are surfaces
with closed-form truth. Each room's ``__init__`` is a front door, as this one is.
"""

from .alarm_change import (
    Acknowledgement,
    AlarmChange,
    StandingAlarm,
    acknowledgements,
    alarm_changes,
    standing_alarms,
)
from .change import Change, Comparison, Measurement, Metric, Motion
from .grid import Grid
from .instant import Instant, as_datetime, format_instant, instant, parse_instant
from .quantities import MINUS, NOT_MEASURED_TEXT, plain, unit_text, with_uncertainty
from .reconstruction import Calibration, Decoded, Frames, Lens, PatternSet, PointMap, Shared
from .scan import LEVEL_NONE, Scan
from .tick import Event, Tick
from .trends import ALARM_STATES, ENVIRONMENT, AlarmState

__all__ = [
    "ALARM_STATES",
    "ENVIRONMENT",
    "LEVEL_NONE",
    "MINUS",
    "NOT_MEASURED_TEXT",
    "Acknowledgement",
    "AlarmChange",
    "AlarmState",
    "Calibration",
    "Change",
    "Comparison",
    "Decoded",
    "Event",
    "Frames",
    "Grid",
    "Instant",
    "Lens",
    "Measurement",
    "Metric",
    "Motion",
    "PatternSet",
    "PointMap",
    "Scan",
    "Shared",
    "StandingAlarm",
    "Tick",
    "acknowledgements",
    "alarm_changes",
    "as_datetime",
    "format_instant",
    "instant",
    "parse_instant",
    "plain",
    "standing_alarms",
    "unit_text",
    "with_uncertainty",
]
