"""Windows: the slots that count, by daylight, hours and days; a slot outside is none."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import numpy as np

from configs import Campaign
from pipelines import Instant, as_datetime, instant

if TYPE_CHECKING:
    from .scheduler import Slots

__all__ = ["Window", "WindowedSlots", "window_of"]

SUN_DEG_PER_H = 15.1
"""The sun's elevation changes no faster, wherever one stands."""

LONGEST = timedelta(days=400)
"""A slot that does not come within a year and a bit does not come."""

NANOSECOND = np.timedelta64(1, "ns")


@dataclass(frozen=True, slots=True)
class Window:
    """When scans count; what is None does not restrict.

    Parameters
    ----------
    zone : ZoneInfo
        Of `hours` and `days`.
    hours : (time, time) or None
        From the first, up to and without the second; may pass midnight. Days then count by their own midnight.
    days : frozenset of int or None
        Monday is 0.
    place : (float, float) or None
        Latitude and longitude, degrees: only while the sun's middle is above the horizon there, with refraction.
    """

    zone: ZoneInfo
    hours: Any = None
    days: frozenset[int] | None = None
    place: tuple[float, float] | None = None

    def opens(self, moment: datetime) -> datetime:
        """Give `moment` where it is within; else a later time, before which none is."""
        local = moment.astimezone(self.zone)
        if self.days is not None and local.weekday() not in self.days:
            return self._first_at(local, timedelta(days=1), 0, 0)
        if self.hours is not None and not self._within_hours(local):
            first = self.hours[0]
            ahead = timedelta(0) if local.time() < first else timedelta(days=1)
            return self._first_at(local, ahead, first.hour, first.minute)
        if self.place is not None:
            below = -self._sun_deg(moment)
            if below > 0:
                return moment + timedelta(hours=below / SUN_DEG_PER_H)
        return moment

    def _within_hours(self, local: datetime) -> bool:
        first, last = self.hours
        now = local.time()
        inside: bool = first <= now < last if first < last else now >= first or now < last
        return inside

    def _first_at(self, local: datetime, ahead: timedelta, hour: int, minute: int) -> datetime:
        """Give the earliest instant that bears a wall time, or one before it.

        Where a change to or from summer time skips that time or brings it twice, it may have been already: then just
        the next moment is sure to be early enough.
        """
        day = local.date() + ahead
        both = (datetime(day.year, day.month, day.day, hour, minute, tzinfo=self.zone, fold=fold) for fold in (0, 1))
        return max(min(each.astimezone(UTC) for each in both), local.astimezone(UTC) + timedelta(microseconds=1))

    def _sun_deg(self, moment: datetime) -> float:
        from astral import Observer
        from astral.sun import elevation

        assert self.place is not None
        return float(elevation(Observer(*self.place, 0.0), moment.astimezone(UTC)))


@dataclass(frozen=True, slots=True)
class WindowedSlots:
    """The slots of a schedule that lie within a window: still a fixed set, whatever is asked and when."""

    slots: Slots
    window: Window

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot later than `moment` that counts; None where the schedule is over."""
        slot = self.slots.after(moment)
        end = as_datetime(slot) + LONGEST if slot is not None else None
        while slot is not None and end is not None:
            here = as_datetime(slot)
            opens = self.window.opens(here)
            if opens <= here:
                return slot
            if opens > end:
                return None
            slot = self.slots.after(max(slot, instant(opens) - NANOSECOND))
        return None


def window_of(campaign: Campaign) -> Window | None:
    """Give a campaign's window; None where every slot counts."""
    within = campaign.schedule.within
    if within is None:
        return None
    place = None
    if within.daylight:
        assert campaign.site.latitude is not None  # checked by the campaign
        assert campaign.site.longitude is not None
        place = campaign.site.latitude, campaign.site.longitude
    return Window(ZoneInfo(campaign.site.zone), within.hours, within.days, place)
