"""Schedule: when to scan, within which hours, how a rate follows the alarms, and what happens to slots not kept."""

from __future__ import annotations

import math
import re
from datetime import time, timedelta
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from .settings import Moment, Positive, Settings, Text, at_key
from .units import Duration, format_duration

__all__ = ["Adaptive", "Schedule", "Video", "Within"]

SHORTEST = timedelta(milliseconds=200)
DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")

Span = tuple[time, time]


def _hours(value: object) -> Span:
    """Read ``08:00-18:00``; a span may pass midnight."""
    if isinstance(value, tuple):
        return value
    parts = re.fullmatch(r"\s*(\d{1,2}:\d{2})\s*-\s*(\d{1,2}:\d{2})\s*", value) if isinstance(value, str) else None
    if parts is not None:
        try:
            first, last = (time.fromisoformat(part.zfill(5)) for part in parts.groups())
        except ValueError:
            pass
        else:
            if first != last:
                return first, last
    raise ValueError(f"{value!r} is no span of hours: write it like '08:00-18:00', or '22:00-04:00' past midnight")


def _days(value: object) -> frozenset[int]:
    """Read ``mon-fri`` or ``mon, wed, sat``; Monday is 0."""
    if isinstance(value, frozenset):
        return value
    found: set[int] = set()
    for item in value.lower().split(",") if isinstance(value, str) else [""]:
        first, _, last = (part.strip() for part in item.partition("-"))
        if first not in DAYS or (last and last not in DAYS):
            raise ValueError(f"{value!r} are no days: write them like mon-fri, or mon, wed, sat")
        begin, end = DAYS.index(first), DAYS.index(last or first)
        found.update(day % 7 for day in range(begin, end + 1 if end >= begin else end + 8))
    return frozenset(found)


Hours = Annotated[
    Span,
    BeforeValidator(_hours),
    PlainSerializer(lambda span: f"{span[0]:%H:%M}-{span[1]:%H:%M}", return_type=str),
    WithJsonSchema({"type": "string", "examples": ["08:00-18:00", "22:00-04:00"]}),
]
Days = Annotated[
    frozenset[int],
    BeforeValidator(_days),
    PlainSerializer(lambda days: ", ".join(DAYS[day] for day in sorted(days)), return_type=str),
    WithJsonSchema({"type": "string", "examples": ["mon-fri", "mon, wed, sat"]}),
]


class Video(Settings):
    """Continuous capture."""

    rate_hz: Positive = Field(description="Scans per second, 1 for one a second.", le=1000)
    for_: Duration | None = Field(
        default=None, alias="for", description="How long each recording lasts; without it, until it is stopped."
    )
    commit_every_s: Annotated[float, Strict(), Field(ge=0, le=3600, allow_inf_nan=False)] = Field(
        default=0.0,
        description="Commit scans in groups, s: less work for each, and a power cut loses at most the last group. "
        "0: each scan at once.",
    )
    queue: Annotated[int, Strict(), Field(ge=1, le=1000)] | None = Field(
        default=None,
        description="How many scans may be under way at once, captured and not yet stored; where that many are, slots "
        "are dropped whole. More bridge longer hiccups, and each takes a capture's memory. "
        "Without it what two seconds bring, at least 4.",
    )

    @property
    def most_under_way(self) -> int:
        """How many scans may be under way at once."""
        return self.queue if self.queue is not None else max(4, math.ceil(2 * self.rate_hz))


class Within(Settings):
    """Which slots count: those that all given keys allow. The others are no slots, and nothing is missed there."""

    daylight: bool = Field(
        default=False, strict=True, description="Only while the sun is up at the site's latitude and longitude."
    )
    hours: Hours | None = Field(default=None, description="Only within these hours, in the site's zone.")
    days: Days | None = Field(default=None, description="Only on these days, in the site's zone.")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.daylight and self.hours is None and self.days is None:
            raise PydanticCustomError("no_window", "needs daylight: true, hours or days")
        return self


class Adaptive(Settings):
    """A rate that follows the alarms, between two bounds."""

    burst: Duration = Field(description="Interval while an alarm stands: the shortest. `every` is a multiple of it.")
    calm: Duration | None = Field(
        default=None, description="Interval after a long calm: the longest, a multiple of `every`. Without it `every`."
    )
    raise_on: Literal["warning", "alarm"] = Field(
        default="alarm", description="What raises the rate: an alarm, or a warning already."
    )
    alarms: tuple[Text, ...] = Field(default=(), description="Names of the alarms that count; without it all.")
    calm_after: Annotated[int, Strict(), Field(ge=1, le=1000)] = Field(
        default=4, description="So many scans in a row without cause lower the rate by a step."
    )


class Schedule(Settings):
    """When to scan: exactly one of `every`, `cron` and `video`."""

    every: Duration | None = Field(default=None, description="A fixed interval, such as 6 h; at least 200 ms.")
    cron: Text | None = Field(
        default=None,
        description="Minute, hour, day, month, weekday (0 and 7 are Sunday), in the site's zone.",
    )
    video: Video | None = Field(default=None, description="Continuous capture, instead of single visits.")
    start: Moment | None = Field(
        default=None, description="First slot of `every`, and nothing before it; without it, the first run."
    )
    until: Moment | None = Field(default=None, description="No scan after this time.")
    within: Within | None = Field(default=None, description="Only these slots count: daylight, hours, days.")
    adaptive: Adaptive | None = Field(default=None, description="Raise the rate while an alarm stands.")
    grace: Duration | None = Field(
        default=None,
        description="How late a scan may begin; later, the slot is missed. "
        "Without it half the time to the next slot, at most 15 min.",
    )
    catch_up: Literal["newest", "none"] = Field(
        default="newest",
        description="After a start or a gap: take the newest slot that is due if its grace is not over, or none. "
        "Older ones are missed, never caught up.",
    )
    overlap: Literal["wait", "skip"] = Field(
        default="wait",
        description="A slot that comes due while a scan runs, or in video while too many do: wait for the end of one "
        "as long as the grace lasts (in video one interval), or skip it.",
    )
    overrun: Duration | None = Field(
        default=None,
        description="A visit that takes longer is noted in the store; the slots that it costs are missed in any case.",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        given = [name for name in ("every", "cron", "video") if getattr(self, name) is not None]
        if len(given) != 1:
            names = " and ".join(given) if given else "none"
            raise PydanticCustomError("one_kind", f"needs exactly one of every, cron and video, not {names}")
        if self.every is not None and self.every < SHORTEST:
            raise at_key(
                ("every",),
                f"must be at least {format_duration(SHORTEST)}: for a higher rate use video: {{rate_hz: ...}}",
            )
        if self.video is not None:
            for name in ("start", "grace", "within", "adaptive", "overrun"):
                if getattr(self, name) is not None:
                    raise at_key((name,), "has no meaning with video, which starts when it is started")
        if self.adaptive is not None:
            self._check_adaptive(self.adaptive)
        return self

    def _check_adaptive(self, adaptive: Adaptive) -> None:
        """Each interval is a whole multiple of the shorter one, so that all slots lie on one grid of times."""
        if self.every is None:
            raise at_key(("adaptive",), "needs every: an interval between two bounds")
        steps = [("burst", adaptive.burst, self.every), ("calm", self.every, adaptive.calm or self.every)]
        if adaptive.burst < SHORTEST:
            raise at_key(("adaptive", "burst"), f"must be at least {format_duration(SHORTEST)}")
        for name, short, long in steps:
            if long < short or long % short:
                texts = {
                    "burst": f"must go into every, {format_duration(self.every)}, a whole number of times",
                    "calm": f"must be a whole multiple of every, {format_duration(self.every)}",
                }
                raise at_key(("adaptive", name), texts[name])
