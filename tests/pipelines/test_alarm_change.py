"""AlarmChange and Acknowledgement: as events and back, and what stands after them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines import (
    ALARM_STATES,
    Acknowledgement,
    AlarmChange,
    AlarmState,
    Event,
    Instant,
    acknowledgements,
    alarm_changes,
    standing_alarms,
)

T0 = np.datetime64("2026-01-01T00:00:00", "ns")
STATES = st.sampled_from(ALARM_STATES)
NAMES = st.text("abc ü->", min_size=1).map(str.strip).filter(bool)


def at(hour: int) -> Instant:
    return T0 + np.timedelta64(hour, "h")


def change(hour: int, before: AlarmState, after: AlarmState) -> Event:
    return AlarmChange(at(hour), "wide", before, after, f"hour {hour}").event


@given(NAMES, STATES, STATES, st.text("ab, ->:\n±"))
def test_a_change_comes_back_from_its_event(name: str, before: AlarmState, after: AlarmState, why: str) -> None:
    told = AlarmChange(T0, name, before, after, why)
    assert alarm_changes([told.event, Event(T0, "note", told.event.text)]) == (told,)


@given(NAMES, st.text("ab c"), st.text("ab c:,"))
def test_an_acknowledgement_comes_back_from_its_event(name: str, by: str, note: str) -> None:
    told = Acknowledgement(T0, name, by, note)
    assert acknowledgements([told.event]) == (told,)


def test_the_state_after_the_newest_scan_and_what_came_since() -> None:
    events = [change(1, "ok", "alarm")]
    standing = standing_alarms({"wide": "alarm"}, at(1), events)["wide"]
    assert (standing.state, standing.since, standing.why) == ("alarm", at(1), "hour 1")
    events.append(change(5, "alarm", "no data"))
    assert standing_alarms({"wide": "alarm"}, at(1), events)["wide"].state == "no data"
    assert standing_alarms({"wide": "ok"}, at(6), events)["wide"].state == "ok", "the newest scan has the last word"


def test_an_acknowledgement_lasts_as_long_as_the_exceedance() -> None:
    seen = Acknowledgement(at(2), "wide", "Ann").event
    events = [change(1, "ok", "alarm"), seen]
    assert standing_alarms({"wide": "alarm"}, at(1), events)["wide"].acknowledged is not None
    milder = [*events, change(3, "alarm", "warning")]
    assert standing_alarms({"wide": "warning"}, at(3), milder)["wide"].acknowledged is not None
    again = [*events, change(3, "alarm", "ok"), change(4, "ok", "alarm")]
    assert standing_alarms({"wide": "alarm"}, at(4), again)["wide"].acknowledged is None
    graver = [change(1, "ok", "warning"), seen, change(3, "warning", "alarm")]
    assert standing_alarms({"wide": "alarm"}, at(3), graver)["wide"].acknowledged is None


def test_what_is_well_needs_no_acknowledgement() -> None:
    seen = Acknowledgement(at(2), "wide").event
    assert standing_alarms({"wide": "ok"}, at(1), [seen])["wide"].acknowledged is None


def test_a_name_with_a_colon_is_refused() -> None:
    with pytest.raises(ValueError, match="colon"):
        Acknowledgement(T0, "wide", "Ann: Bob")
