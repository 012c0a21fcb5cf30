"""An adaptive rate: alarms make it dense at once, calm lowers it step by step, on one grid and within its bounds."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from configs import Adaptive, Campaign
from monitor.adaptive import exciting, level_of
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from monitor.settled import Settled
from monitor.visit import Epoch, Recipe, Yield
from pipelines import AlarmState, Frames, Instant, instant
from pipelines.trends import Watch
from storage import Ledger, ledger_beside, open_store

from . import campaigns
from .campaigns import BASE, Rig, campaign_in
from .stand_ins import whole

T0 = instant(BASE)
MINUTE = np.timedelta64(60 * 10**9, "ns")


def adaptive(folder: Path, **keys: Any) -> Campaign:
    plain = campaign_in(folder).model_dump(by_alias=True, exclude_unset=True)
    rule = {"burst": "10 min", "calm": "2 h", "calm_after": 3, **keys}
    made = {**plain, "schedule": {"every": "1 h", "start": BASE.isoformat(), "adaptive": rule}}
    alarm = {"name": "rise", "metric": "net_volume", "alarm_above": 1.0, "warn_above": 0.5}
    return Campaign.model_validate({**made, "alarms": [alarm]})


def run(folder: Path, alarmed: set[int], visits: int, at_min: int = 0, **keys: Any) -> list[int]:
    """Run; `alarmed` names the minutes of T0 whose scan finds the alarm standing. Gives the minutes of all visits."""

    @whole
    def work(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
        made = campaigns.work(frames, recipe, epoch, planned)
        minute = int((planned - T0) / MINUTE)
        state: AlarmState = "alarm" if minute in alarmed else "ok"
        return replace(made, tick=replace(made.tick, alarms={"rise": state}), watches={"rise": Watch(state)})

    minutes: list[int] = []

    def settled(each: Settled) -> None:
        if each.state == "taken":
            minutes.append(int((each.planned - T0) / MINUTE))

    clock = AcceleratedClock(T0 + at_min * MINUTE)
    run_campaign(adaptive(folder, **keys), clock=clock, rig=Rig(), work=work, on_settled=settled, max_scans=visits)
    return minutes


def test_an_alarm_makes_a_burst_and_calm_lowers_it_to_the_bounds(tmp_path: Path) -> None:
    minutes = run(tmp_path, {120, 130}, 14)
    # usual; the alarm at 120 and 130; three quiet scans in the burst; three at the usual rate; then every two hours
    assert minutes == [0, 60, 120, 130, 140, 150, 160, 180, 240, 300, 360, 480, 600, 720]
    notes = [event.text for event in open_store(tmp_path / "site.icechunk").events if event.text.startswith("rate ")]
    assert notes == [
        "rate raised to a scan every 10 min: rise: alarm",
        "rate lowered to a scan every 1 h: 3 scans in a row without cause",
        "rate lowered to a scan every 2 h: 3 scans in a row without cause",
    ]


def test_a_restart_in_a_burst_goes_on_in_it(tmp_path: Path) -> None:
    assert run(tmp_path, {0, 10, 20}, 3) == [0, 10, 20]
    assert run(tmp_path, set(), 4, at_min=41) == [40, 50, 60, 120]
    ledger = Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)
    rows = {int((row.planned - T0) / MINUTE): row.state for row in ledger.rows()}
    ledger.close()
    assert list(rows) == [0, 10, 20, 30, 40, 50, 60, 120]
    assert [minute for minute, state in rows.items() if state != "taken"] == [30]


RULE = Adaptive(burst=timedelta(minutes=10), calm=timedelta(hours=2), calm_after=4)


@given(st.lists(st.booleans(), max_size=60))
def test_the_level_is_within_bounds_and_moves_down_one_step_at_a_time(story: list[bool]) -> None:
    quiet, before = RULE.calm_after, 1
    for raised in story:
        quiet = 0 if raised else quiet + 1
        level = level_of(quiet, RULE)
        assert 0 <= level <= 2
        assert level == 0 if raised else level in (before, before + 1)
        before = level


def test_without_a_calm_interval_the_usual_one_is_the_longest() -> None:
    rule = RULE.model_copy(update={"calm": None})
    assert [level_of(quiet, rule) for quiet in (0, 3, 4, 1000)] == [0, 0, 1, 1]


def test_what_raises_the_rate_is_the_rules() -> None:
    assert exciting({"a": "alarm"}, RULE)
    assert not exciting({"a": "warning", "b": "no data"}, RULE)
    assert exciting({"a": "warning"}, RULE.model_copy(update={"raise_on": "warning"}))
    assert not exciting({"a": "alarm"}, RULE.model_copy(update={"alarms": ("b",)}))


@pytest.mark.parametrize(
    ("rule", "says"),
    [
        ({"burst": "7 min"}, "must go into every, 1 h, a whole number of times"),
        ({"burst": "2 h"}, "must go into every"),
        ({"calm": "90 min"}, "must be a whole multiple of every, 1 h"),
        ({"alarms": ["fall"]}, "'fall' is not among this campaign's alarms"),
    ],
)
def test_bounds_off_the_grid_are_refused(tmp_path: Path, rule: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        adaptive(tmp_path, **rule)
