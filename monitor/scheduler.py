"""When visits are due: APScheduler's triggers give the times of coarse schedules, a ticker those of video."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from fractions import Fraction
from typing import Any, Protocol
from zoneinfo import ZoneInfo

import numpy as np

from configs import Campaign, InputError
from pipelines import Instant, as_datetime, instant

from .windows import WindowedSlots, window_of

__all__ = [
    "CronSlots",
    "IntervalSlots",
    "OnceSlots",
    "Slots",
    "VideoSlots",
    "check_cron",
    "grace_of",
    "last_slot",
    "make_slots",
    "slots_between",
]

SLACK = timedelta(milliseconds=10)
"""Far more than float seconds err by, far less than the shortest interval, 200 ms."""

LONGEST_GRACE_S = 900.0


class Slots(Protocol):
    """The times at which visits are due, a fixed set whatever is asked and when."""

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot later than `moment`; None when the schedule is over."""
        ...


class _TriggerSlots:
    """Slots of an APScheduler trigger."""

    def __init__(self, trigger: Any, until: datetime | None) -> None:
        self._trigger = trigger
        self._until = until

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot later than `moment`; None when the schedule is over."""
        # the trigger reckons in float seconds and may skip a slot that it is asked for to the microsecond: ask from a
        # little before, and once more from a little after where that gave a slot that has been
        slot = self._trigger.get_next_fire_time(None, as_datetime(moment) - SLACK)
        if slot is not None and instant(slot) <= moment:
            slot = self._trigger.get_next_fire_time(None, as_datetime(moment) + SLACK)
        if slot is None or (self._until is not None and slot > self._until):
            return None
        return instant(slot)


class IntervalSlots(_TriggerSlots):
    """Every `every` from `anchor` on, in elapsed time: a change to summer time moves no slot."""

    def __init__(self, anchor: Instant, every: timedelta, until: datetime | None = None) -> None:
        from apscheduler.triggers.interval import IntervalTrigger

        trigger = IntervalTrigger(seconds=every.total_seconds(), start_date=as_datetime(anchor), timezone="UTC")
        super().__init__(trigger, until)


class CronSlots(_TriggerSlots):
    """A crontab line in a zone's wall time.

    When summer time ends, an hour comes twice: a line that names its hours scans in the first of them only, one with
    ``*`` in both. When it begins, a time that is skipped is kept an hour later.
    """

    def __init__(
        self, line: str, zone: str = "UTC", start: datetime | None = None, until: datetime | None = None
    ) -> None:
        from apscheduler.triggers.cron import CronTrigger

        check_cron(line)
        minute, hour, day, month, weekday = line.split()
        trigger = CronTrigger(
            minute=minute,
            hour=hour,
            day=day,
            month=month,
            day_of_week=_weekdays(weekday),
            start_date=start,
            timezone=ZoneInfo(zone),
        )
        super().__init__(trigger, until)
        self._zone = ZoneInfo(zone)
        self._names_hours = not hour.startswith("*")

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot later than `moment`; None when the schedule is over."""
        slot = super().after(moment)
        while slot is not None and self._names_hours and as_datetime(slot).astimezone(self._zone).fold:
            slot = super().after(slot)
        return slot


@dataclass(frozen=True, slots=True)
class VideoSlots:
    """`rate_hz` slots a second from `anchor` on, reckoned in nanoseconds so that no error adds up."""

    anchor: Instant
    rate_hz: float
    until: Instant | None = None

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot later than `moment`; None when the recording is over."""
        if moment < self.anchor:
            slot = self.anchor
        else:
            passed = int((moment - self.anchor).astype("timedelta64[ns]").astype(np.int64))
            count = int(passed * Fraction(self.rate_hz) / 10**9)
            while self._nanoseconds(count) <= passed:
                count += 1
            while count > 0 and self._nanoseconds(count - 1) > passed:
                count -= 1
            slot = self.anchor + np.timedelta64(self._nanoseconds(count), "ns")
        return slot if self.until is None or slot < self.until else None

    def _nanoseconds(self, count: int) -> int:
        return round(count * 10**9 / Fraction(self.rate_hz))  # exact: a float is off by nanoseconds after months


@dataclass(frozen=True, slots=True)
class OnceSlots:
    """A single slot."""

    at: Instant

    def after(self, moment: Instant) -> Instant | None:
        """Give the slot where it is later than `moment`."""
        return self.at if self.at > moment else None


def make_slots(campaign: Campaign, anchor: Instant) -> Slots:
    """Give the slots of a campaign.

    Parameters
    ----------
    campaign : Campaign
    anchor : Instant
        First slot where the campaign names no `start`: the first run's, which the ledger remembers, or for video
        the moment the recording starts.
    """
    schedule = campaign.schedule
    if schedule.video is not None:
        ends = [] if campaign.until is None else [instant(campaign.until)]
        if schedule.video.for_ is not None:
            ends.append(anchor + np.timedelta64(schedule.video.for_))
        return VideoSlots(anchor, schedule.video.rate_hz, min(ends, default=None))
    slots: Slots
    if schedule.cron is not None:
        slots = CronSlots(schedule.cron, campaign.site.zone, campaign.start, campaign.until)
    else:
        assert schedule.every is not None  # the campaign has exactly one of the three
        first = instant(campaign.start) if campaign.start is not None else anchor
        slots = IntervalSlots(first, schedule.every, campaign.until)
    window = window_of(campaign)
    return slots if window is None else WindowedSlots(slots, window)


def grace_of(campaign: Campaign, slots: Slots, slot: Instant) -> float:
    """Give how late the visit of `slot` may begin, s: the campaign's grace, or half the time to the next slot.

    In video it is all of that time: after a scan that took too long the next begins at once, instead of a scan less.
    """
    if campaign.schedule.video is not None:
        return 1 / campaign.schedule.video.rate_hz
    if campaign.schedule.grace is not None:
        return campaign.schedule.grace.total_seconds()
    following = slots.after(slot)
    if following is None:
        return LONGEST_GRACE_S
    return min(float((following - slot) / np.timedelta64(1, "ns")) / 2e9, LONGEST_GRACE_S)


def slots_between(slots: Slots, after: Instant, last: Instant) -> Iterator[Instant]:
    """Walk the slots later than `after`, up to and with `last`."""
    slot = slots.after(after)
    while slot is not None and slot <= last:
        yield slot
        slot = slots.after(slot)


def last_slot(slots: Slots, after: Instant, last: Instant) -> Instant | None:
    """Give the newest slot later than `after`, up to and with `last`, without a walk through all between them."""
    back = np.timedelta64(10**9, "ns")
    while True:
        start = max(after, last - back)
        found = None
        for found in slots_between(slots, start, last):  # noqa: B007 - the last one is wanted
            pass
        if found is not None or start == after:
            return found
        back *= 2


def check_cron(line: str) -> None:
    """Refuse a crontab line that cannot be read, or that cron programs disagree about.

    Raises
    ------
    InputError
    """
    from apscheduler.triggers.cron import CronTrigger

    fields = line.split()
    if len(fields) != 5:
        raise InputError(f"a cron line has 5 fields (minute, hour, day, month, weekday), not {len(fields)}")
    if fields[2] != "*" and fields[4] != "*":
        raise InputError("day and weekday together mean 'either' to some cron programs and 'both' to others: give one")
    names = ("minute", "hour", "day", "month", "day_of_week")
    for name, field in zip(names, fields, strict=True):
        try:
            CronTrigger(timezone="UTC", **{name: _weekdays(field) if name == "day_of_week" else field})
        except ValueError as error:
            raise InputError(f"{name.replace('_', ' ')} {field!r}: {_first_line(error)}") from None


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else "not understood"


_DAYS = ("sun", "mon", "tue", "wed", "thu", "fri", "sat")


def _weekdays(field: str) -> str:
    """Name the days: APScheduler 3 counts from Monday, crontab from Sunday (0 and 7)."""
    if field == "*":
        return field
    days: list[str] = []
    for item in field.lower().split(","):
        span, _, step = item.partition("/")
        first, _, last = span.partition("-")
        if (step and not step.isdigit()) or step == "0":
            raise ValueError("a step is a whole number from 1")
        if first == "*":
            begin, end = 0, 6
        else:
            begin = _day(first)
            end = _day(last) if last else 6 if step else begin
            if end < begin:
                end += 7
        days.extend(_DAYS[day % 7] for day in range(begin, end + 1, int(step or 1)))
    return ",".join(dict.fromkeys(days))


def _day(text: str) -> int:
    if text in _DAYS:
        return _DAYS.index(text)
    if text.isdigit() and int(text) <= 7:
        return int(text)
    raise ValueError("a weekday is 0-7 (0 and 7 are Sunday) or sun, mon, tue, wed, thu, fri, sat")
