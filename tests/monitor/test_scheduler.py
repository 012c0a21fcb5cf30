"""When visits are due: one grid whatever is asked, crontab's own weekdays, video without drift."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs import InputError
from monitor.scheduler import CronSlots, IntervalSlots, Slots, VideoSlots, check_cron, grace_of, slots_between
from pipelines import Instant, as_datetime, format_instant, instant, parse_instant

T0 = parse_instant("2026-01-01T00:00:00Z")
intervals = st.integers(1, 40 * 86400 * 1000).map(lambda ms: timedelta(milliseconds=ms + 1000))
moments = st.integers(0, 5 * 365 * 86400 * 10**9).map(lambda ns: T0 + np.timedelta64(ns, "ns"))


@settings(deadline=None)
@given(intervals, moments)
def test_interval_slots_lie_on_the_grid_and_follow_at_once(every: timedelta, moment: Instant) -> None:
    slots = IntervalSlots(T0, every)
    slot = slots.after(moment)
    assert slot is not None
    assert slot > moment
    step = np.timedelta64(every)
    count = round(float((slot - T0) / step))
    assert abs(slot - (T0 + count * step)) <= np.timedelta64(1, "us"), "the trigger rounds to microseconds"
    assert slot - step <= moment + np.timedelta64(1, "us"), "no slot is skipped"


@settings(deadline=None)
@given(intervals, st.lists(moments, min_size=1, max_size=5))
def test_asking_in_any_order_gives_the_same_grid(every: timedelta, asked: list[Instant]) -> None:
    """As restarts do: each asks a new trigger, from where it happens to be."""
    for moment in asked:
        slot = IntervalSlots(T0, every).after(moment)
        assert slot is not None
        before = IntervalSlots(T0, every).after(slot - np.timedelta64(1, "ns"))
        assert before == slot, "the slot itself is the first after a moment just before it"


@settings(deadline=None)
@given(st.floats(0.1, 240), st.integers(0, 10**7))
def test_video_slots_do_not_drift(rate_hz: float, count: int) -> None:
    slots = VideoSlots(T0, rate_hz)
    exact = T0 + np.timedelta64(round(count * 10**9 / Fraction(rate_hz)), "ns")
    assert slots.after(exact - np.timedelta64(1, "ns")) == exact
    following = slots.after(exact)
    assert following is not None
    assert abs(float((following - exact) / np.timedelta64(1, "ns")) - 1e9 / rate_hz) <= 1


def test_video_ends_before_its_length() -> None:
    slots = VideoSlots(T0, 1.0, T0 + np.timedelta64(3, "s"))
    assert len(list(slots_between(slots, T0 - np.timedelta64(1, "ns"), T0 + np.timedelta64(1, "h")))) == 3


def test_interval_ends_at_until() -> None:
    slots = IntervalSlots(T0, timedelta(hours=6), as_datetime(T0) + timedelta(hours=12))
    assert slots.after(T0 + np.timedelta64(12, "h")) is None
    assert slots.after(T0 + np.timedelta64(11, "h")) == T0 + np.timedelta64(12, "h")


def times(slots: Slots, after: str, count: int) -> list[str]:
    found, moment = [], parse_instant(after)
    for _ in range(count):
        slot = slots.after(moment)
        assert slot is not None
        found.append(format_instant(slot))
        moment = slot
    return found


def test_cron_is_in_the_sites_zone() -> None:
    slots = CronSlots("30 5,13 * * *", "Europe/Berlin")
    assert times(slots, "2026-01-10T00:00:00Z", 3) == [
        "2026-01-10T04:30:00Z",
        "2026-01-10T12:30:00Z",
        "2026-01-11T04:30:00Z",
    ]


@pytest.mark.parametrize(
    ("field", "days"),
    [
        ("0", ["Sun"]),
        ("7", ["Sun"]),
        ("1", ["Mon"]),
        ("1-5", ["Mon", "Tue", "Wed", "Thu", "Fri"]),
        ("6,0", ["Sat", "Sun"]),
        ("fri-mon", ["Fri", "Mon", "Sat", "Sun"]),
        ("*/2", ["Sat", "Sun", "Thu", "Tue"]),
        ("SUN", ["Sun"]),
    ],
)
def test_weekdays_count_from_sunday_as_crontab_does(field: str, days: list[str]) -> None:
    """APScheduler 3 counts from Monday: 0 would be Monday there."""
    slots = CronSlots(f"0 12 * * {field}")
    found = {
        as_datetime(slot).strftime("%a")
        for slot in slots_between(slots, parse_instant("2026-03-01T00:00:00Z"), parse_instant("2026-03-29T00:00:00Z"))
    }
    assert sorted(found) == sorted(days)


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("0 0 * *", "5 fields"),
        ("60 * * * *", "minute '60'"),
        ("0 25 * * *", "hour '25'"),
        ("0 0 1 * 1", "day and weekday together"),
        ("0 0 * * 8", "day of week '8'"),
        ("0 0 * * mo", "day of week 'mo'"),
        ("x * * * *", "minute 'x'"),
    ],
)
def test_a_cron_line_that_cannot_be_is_refused(line: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        check_cron(line)


def test_cron_starts_and_ends() -> None:
    slots = CronSlots("0 * * * *", "UTC", datetime(2026, 1, 2, tzinfo=UTC), datetime(2026, 1, 2, 2, tzinfo=UTC))
    found = list(slots_between(slots, T0, T0 + np.timedelta64(30, "D")))
    assert found == [instant(datetime(2026, 1, 2, hour, tzinfo=UTC)) for hour in range(3)]


def test_video_takes_the_newest_slot_however_late(tmp_path: Path) -> None:
    """After a scan that took 1.9 periods the next begins at once; it is 0.9 periods late, and says so."""
    from .campaigns import campaign_in

    campaign = campaign_in(tmp_path)
    schedule = campaign.schedule.model_validate({"video": {"rate_hz": 4}})
    slots = VideoSlots(T0, 4)
    assert grace_of(campaign.model_copy(update={"schedule": schedule}), slots, T0) == 0.25
    hourly = IntervalSlots(T0, timedelta(hours=1))
    assert grace_of(campaign, hourly, T0) == 900


@pytest.mark.parametrize(
    ("line", "spring", "autumn"),
    [
        ("30 2 * * *", ["03-28T01:30", "03-29T01:30", "03-30T00:30"], ["10-24T00:30", "10-25T00:30", "10-26T01:30"]),
        ("0 12 * * *", ["03-28T11:00", "03-29T10:00", "03-30T10:00"], ["10-24T10:00", "10-25T11:00", "10-26T11:00"]),
    ],
)
def test_a_daily_line_is_one_slot_a_day_when_summer_time_begins_and_ends(
    line: str, spring: list[str], autumn: list[str]
) -> None:
    slots = CronSlots(line, "Europe/Berlin")
    for start, days in (("2026-03-28T00:00:00Z", spring), ("2026-10-24T00:00:00Z", autumn)):
        assert [moment[5:16] for moment in times(slots, start, 3)] == days


def test_an_hourly_line_is_hourly_through_both() -> None:
    slots = CronSlots("0 * * * *", "Europe/Berlin")
    for day in ("2026-03-29", "2026-10-25"):
        start = parse_instant(f"{day}T00:00:00Z")
        found = list(slots_between(slots, start - np.timedelta64(1, "ns"), start + np.timedelta64(6, "h")))
        assert np.array_equal(np.diff(found), np.full(6, np.timedelta64(3600 * 10**9, "ns")))
