"""Windows: a slot counts by the sun, by hours and by days; whatever is asked, and however short the interval."""

from __future__ import annotations

from datetime import time, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.scheduler import IntervalSlots, last_slot, slots_between
from monitor.windows import Window, WindowedSlots
from pipelines import Instant, as_datetime, format_instant, parse_instant

BERLIN = ZoneInfo("Europe/Berlin")
ZURICH = (47.37, 8.54)
T0 = parse_instant("2026-06-21T00:00:00Z")


def day_of(window: Window, day: str, every: timedelta = timedelta(minutes=1)) -> tuple[str, str]:
    """First and last slot of a day, UTC."""
    start = parse_instant(day + "T00:00:00Z")
    slots = WindowedSlots(IntervalSlots(start, every), window)
    found = list(slots_between(slots, start - np.timedelta64(1, "ns"), start + np.timedelta64(24, "h")))
    return format_instant(found[0])[11:16], format_instant(found[-1])[11:16]


@pytest.mark.parametrize(
    ("day", "place", "rise", "set_"),
    [
        # sunrise and sunset as an almanac gives them, to two minutes (it counts the sun's upper rim, we its middle)
        ("2026-06-21", ZURICH, "03:29", "19:26"),
        ("2026-12-21", ZURICH, "07:10", "15:38"),
        ("2026-03-20", (0.0, 0.0), "06:04", "18:11"),
    ],
)
def test_daylight_is_the_almanacs(day: str, place: tuple[float, float], rise: str, set_: str) -> None:
    first, last = day_of(Window(ZoneInfo("UTC"), place=place), day)
    for found, told in ((first, rise), (last, set_)):
        minutes = [int(text[:2]) * 60 + int(text[3:]) for text in (found, told)]
        assert abs(minutes[0] - minutes[1]) <= 6, f"{found}, the almanac says {told}"


def test_the_sun_does_not_rise_in_the_polar_night_and_the_next_slot_is_in_spring() -> None:
    window = Window(ZoneInfo("UTC"), place=(78.2, 15.6))
    slots = WindowedSlots(IntervalSlots(T0, timedelta(hours=1)), window)
    slot = slots.after(parse_instant("2026-11-20T12:00:00Z"))
    assert slot is not None
    assert format_instant(slot)[:7] == "2027-02"


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 366 * 86400),
    st.sampled_from([timedelta(seconds=20), timedelta(minutes=7), timedelta(hours=5)]),
    st.sampled_from(
        [
            Window(BERLIN, place=ZURICH),
            Window(BERLIN, hours=(time(8), time(18))),
            Window(BERLIN, hours=(time(22, 30), time(4))),
            Window(
                BERLIN, hours=(time(2, 15), time(2, 45)), days=frozenset({6})
            ),  # the hour that is skipped or doubled
            Window(BERLIN, hours=(time(6), time(20)), days=frozenset({0, 2}), place=ZURICH),
        ]
    ),
)
def test_what_is_skipped_is_outside_and_what_is_given_is_inside(second: int, every: timedelta, window: Window) -> None:
    """The jumps must give what a walk through all slots gives."""
    moment = T0 + np.timedelta64(second, "s")
    plain = IntervalSlots(T0, every)
    given_ = WindowedSlots(plain, window).after(moment)
    if given_ is None:
        return
    assert window.opens(as_datetime(given_)) == as_datetime(given_)
    near = max(moment, given_ - np.timedelta64(6, "h"))
    for slot in slots_between(plain, near, given_ - np.timedelta64(1, "ns")):
        here = as_datetime(slot)
        assert window.opens(here) > here, f"{slot} was passed over"


def test_a_window_that_never_opens_ends_the_schedule() -> None:
    class Never(Window):
        def opens(self, moment):  # type: ignore[no-untyped-def]  # as its base
            return moment + timedelta(days=30)

    assert WindowedSlots(IntervalSlots(T0, timedelta(hours=1)), Never(BERLIN)).after(T0) is None


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 10**6), st.integers(0, 10**6))
def test_the_last_slot_is_that_of_a_walk(span_s: int, start_s: int) -> None:
    slots = IntervalSlots(T0, timedelta(seconds=977))
    after: Instant = T0 + np.timedelta64(start_s, "s")
    last: Instant = after + np.timedelta64(span_s, "s")
    walked = list(slots_between(slots, after, last))
    assert last_slot(slots, after, last) == (walked[-1] if walked else None)
