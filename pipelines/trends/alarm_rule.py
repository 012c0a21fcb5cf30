"""AlarmRule: all that can raise one alarm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .alarm_state import AlarmState
from .control import Chart, Model, threshold
from .limits import Limits

__all__ = ["AlarmRule", "Decision"]


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """What raises an alarm on one metric; each part by itself, the gravest counts.

    Parameters
    ----------
    limits : Limits, optional
        Of the value.
    rate : Limits, optional
        Of the rate, in the metric's unit per day; passed where the whole 95 % interval of the trend's slope is beyond.
    window_days : float, optional
        Trends look back so far; over the whole series if left out.
    within_days : float, optional
        A warning if the trend, which must be significant, reaches a limit of the value within so many days.
    chart : {"cusum", "ewma"}, optional
        A warning where a control chart of the series signals a change; it stands until `SIGNAL_STANDS` values (see
        `watch`) gave no other signal.
    model : {"level", "line"}
        What the chart takes for no change: a level, or a steady rate.
    false_alarm_every : float
        Of that chart: values between false alarms in the mean.
    drivers : tuple of str
        Environmental quantities whose effect is taken out before that chart.
    max_lag_hours : float
        Longest lag by which the series may follow them.
    confirm : (int, int)
        (m, n): limits of the value count once m of the newest n values are beyond them.
    clear_by : float
        Hysteresis, in the metric's unit: a raised alarm falls back once the value is so far inside its limit.
    no_data_after : int
        "no data" after so many slots in a row without a value that can be judged.
    unit : str
        Of the metric, as people read it; only for the words.

    Raises
    ------
    ValueError
        If nothing raises it, or a number is out of range.
    """

    limits: Limits | None = None
    rate: Limits | None = None
    window_days: float | None = None
    within_days: float | None = None
    chart: Chart | None = None
    model: Model = "level"
    false_alarm_every: float = 400.0
    drivers: tuple[str, ...] = ()
    max_lag_hours: float = 0.0
    confirm: tuple[int, int] = (1, 1)
    clear_by: float = 0.0
    no_data_after: int = 3
    unit: str = ""

    def __post_init__(self) -> None:
        if self.limits is None and self.rate is None and self.chart is None:
            raise ValueError("an alarm needs limits of the value, limits of its rate, or a control chart")
        if self.within_days is not None and self.limits is None:
            raise ValueError("within_days foretells when a limit of the value is reached: give one")
        for name in ("window_days", "within_days"):
            days = getattr(self, name)
            if days is not None and not (math.isfinite(days) and days > 0):
                raise ValueError(f"{name} is a number of days above 0, not {days}")
        of, among = self.confirm
        if not 1 <= of <= among:
            raise ValueError(f"confirm is (m, n) with 1 <= m <= n, not ({of}, {among})")
        if not (math.isfinite(self.clear_by) and self.clear_by >= 0):
            raise ValueError(f"clear_by is a distance of at least 0, not {self.clear_by}")
        if self.no_data_after < 1:
            raise ValueError(f"no_data_after is a number of slots of at least 1, not {self.no_data_after}")
        if self.chart is not None:
            threshold(self.chart, float(self.false_alarm_every))

    @property
    def follows_a_trend(self) -> bool:
        """Whether it looks at a rate, and so back over `window_days`."""
        return self.rate is not None or self.within_days is not None

    @property
    def judges_by_chart_alone(self) -> bool:
        """Whether nothing but the control chart can raise it."""
        return self.limits is None and self.rate is None


@dataclass(frozen=True, slots=True)
class Decision:
    """Where an alarm stands, and why, in words; the words are empty where it is ok."""

    state: AlarmState
    why: str = ""
