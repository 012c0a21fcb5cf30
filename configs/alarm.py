"""Alarm: what a campaign wants to be told of one metric."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Strict, model_validator
from pydantic_core import PydanticCustomError

from .settings import Count, Number, Positive, Settings, Text, at_key

__all__ = ["Alarm"]

LIMITS = ("warn_above", "alarm_above", "warn_below", "alarm_below")
RATES = tuple(f"{name.replace('_', '_rate_')}_per_day" for name in LIMITS)


class Alarm(Settings):
    """What raises an alarm on one metric, in the metric's unit: each part by itself, the gravest counts."""

    name: Text = Field(description="Short name, shown to people.")
    metric: Text = Field(description="One of `metrics`.")
    unit: str | None = Field(default=None, description="Unit of the limits; checked against the metric's.")
    warn_above: Number | None = Field(default=None, description="A greater value is a warning.")
    alarm_above: Number | None = Field(default=None, description="A greater value is an alarm.")
    warn_below: Number | None = Field(default=None, description="A smaller value is a warning.")
    alarm_below: Number | None = Field(default=None, description="A smaller value is an alarm.")
    confirm: tuple[Count, Count] = Field(
        default=(1, 1), description="[m, n]: the limits count once m of the newest n values are beyond them."
    )
    clear_by: Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)] = Field(
        default=0.0, description="What was raised falls back only once the value is so far inside its limit."
    )
    warn_rate_above_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is greater is a warning."
    )
    alarm_rate_above_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is greater is an alarm."
    )
    warn_rate_below_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is smaller (more negative) is a warning."
    )
    alarm_rate_below_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is smaller (more negative) is an alarm."
    )
    within_days: Positive | None = Field(
        default=None, description="A warning if the trend, which must be certain, reaches a limit within so many days."
    )
    window_days: Positive | None = Field(
        default=None, description="Rate and trend are of so many days back; without it, since the baseline."
    )
    chart: Literal["cusum", "ewma"] | None = Field(
        default=None,
        description="A warning where the values change against those before, found by a control chart: cusum finds "
        "lasting changes, ewma also drifts.",
    )
    chart_model: Literal["level", "line"] | None = Field(
        default=None, description="What the chart takes for no change: a level (unless given), or a steady rate."
    )
    false_alarm_every_scans: Annotated[float, Strict(), Field(ge=10, le=100_000)] | None = Field(
        default=None,
        description="Of the chart: scans between two false alarms in the mean while nothing changes; 400 unless given.",
    )
    no_data_after_slots: Count = Field(
        default=3, description="No data is an alarm: after so many slots in a row without a value that can be judged."
    )

    @model_validator(mode="after")
    def _limits(self) -> Self:
        given = {name for name in (*LIMITS, *RATES) if getattr(self, name) is not None}
        if not given and self.chart is None:
            raise PydanticCustomError(
                "no_limit",
                "needs a limit: warn_above, alarm_above, warn_below or alarm_below, one of a rate such as "
                "warn_rate_above_per_day, or a chart",
            )
        for part in ("", "_rate"):
            for side, wrong in (("above", "above"), ("below", "below")):
                warn, alarm = (f"{grade}{part}_{side}{'_per_day' if part else ''}" for grade in ("warn", "alarm"))
                first, last = getattr(self, warn), getattr(self, alarm)
                if first is not None and last is not None and (first > last if side == "above" else first < last):
                    raise at_key((warn,), f"must not be {wrong} {alarm}, {last:g}")
        for name, needed, told in (
            ("within_days", LIMITS, "a limit such as alarm_above"),
            ("clear_by", LIMITS, "a limit such as alarm_above"),
            ("confirm", LIMITS, "a limit such as alarm_above"),
            ("window_days", (*RATES, "within_days"), "a limit such as alarm_rate_above_per_day or within_days"),
            ("chart_model", ("chart",), "chart"),
            ("false_alarm_every_scans", ("chart",), "chart"),
        ):
            if name in self.model_fields_set and all(getattr(self, other) is None for other in needed):
                raise at_key((name,), f"has no meaning without {told}")
        if self.confirm[0] > self.confirm[1]:
            raise at_key(
                ("confirm",), f"is [m, n] with m of the newest n values: {self.confirm[0]} of {self.confirm[1]}?"
            )
        return self
