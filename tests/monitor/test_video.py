"""Video: side by side the stages keep a rate that they could not one after another; what is dropped says why."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs import Campaign, CaptureError
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from monitor.items import Item
from monitor.line import Line, Stage
from monitor.loop import Loop
from monitor.scheduler import VideoSlots
from monitor.settled import Outcome, Settled
from monitor.slot_rules import SlotRules
from pipelines import Frames, Instant, instant
from storage import Ledger, ledger_beside, open_store
from storage.ledger import INTERRUPTED

from . import campaigns
from .stand_ins import RECIPE, T0, FakeLedger, FakeRig, FakeStore, after
from .test_committing import compared
from .virtual_line import Takes, VirtualClock, VirtualLine


class Video:
    """A video on stand-ins, in virtual time."""

    def __init__(
        self,
        takes: Takes | tuple[float, float, float],
        *,
        rate_hz: float = 1.0,
        seconds: float = 20.0,
        limit: int = 4,
        rules: SlotRules | None = None,
        rig: Callable[[int], None] = lambda number: None,
        store: Callable[[int], None] = lambda number: None,
        commit_every_s: float = 0.0,
    ) -> None:
        self.clock = VirtualClock(T0)
        self.store, self.ledger, self.stop = FakeStore(store), FakeLedger(), Event()
        self.told: list[Settled] = []
        self.most = 0
        self._takes: Takes = (lambda stage, visit: takes[stage]) if isinstance(takes, tuple) else takes
        self.slots = VideoSlots(T0, rate_hz, after(seconds))
        self.loop = Loop(
            self.slots,
            lambda slot: 1 / rate_hz,
            RECIPE,
            FakeRig(rig),
            self.store,  # type: ignore[arg-type]  # a stand-in keeps less than a store
            self.ledger,
            self.clock,
            T0 - np.timedelta64(1, "ns"),
            self.told.append,
            stop=self.stop,
            work=compared,
            rules=rules or SlotRules(),
            commit_every_s=commit_every_s,
            lay=partial(self._lay, limit=limit),
        )

    def _lay(self, stages: Sequence[Stage[Item]], stop: Event, limit: int) -> Line[Item]:
        self.line = VirtualLine(stages, limit, self.clock, self._takes)
        return self.line

    def run(self, max_scans: int | None = None) -> Outcome:
        return self.loop.run(max_scans)

    def check(self) -> None:
        """Every slot has one state, scans are in order, and what the ledger says was taken is what the store holds."""
        slots, slot = [T0], self.slots.after(T0)
        while slot is not None and slot <= max(self.ledger.slots):
            slots.append(slot)
            slot = self.slots.after(slot)
        assert sorted(self.ledger.slots) == slots
        assert "planned" not in self.ledger.states()
        taken = [planned for planned in slots if self.ledger.slots[planned][0] == "taken"]
        assert [scan.planned for scan in self.store.scans] == taken
        assert [each.planned for each in self.told] == sorted(each.planned for each in self.told), "in slot order"


def test_stages_side_by_side_keep_a_rate_that_one_after_another_could_not() -> None:
    video = Video((0.4, 0.4, 0.2), rate_hz=2.0)
    outcome = video.run()
    assert (outcome.taken, outcome.missed) == (40, 0)
    assert set(outcome.lags_s) == {0.0}
    # the second waits until the baseline is durable, after 1 s, and the third for the second
    assert outcome.latencies_s[:3] == pytest.approx((0.8, 0.9, 0.8))
    assert outcome.latencies_s[3:] == pytest.approx([0.8] * 37)
    video.check()


def test_what_cannot_be_kept_is_dropped_whole_and_says_how_far_behind_it_is() -> None:
    video = Video((0.3, 1.3, 0.2), seconds=60.0, limit=3)
    outcome = video.run()
    video.check()
    assert outcome.taken + outcome.missed == 60
    assert outcome.taken == pytest.approx(60 / 1.3, abs=3), "as many as the slowest stage can"
    assert video.line.most == 3
    causes = {video.ledger.slots[slot][1] for slot, (state, _) in video.ledger.slots.items() if state == "missed"}
    assert all(re.fullmatch(r"behind by \d\.\d s", cause) for cause in causes)
    assert max(outcome.lags_s) <= 1.0, "the newest slot that is due begins, however far behind the work is"
    assert max(outcome.latencies_s) < 3 * 1.3 + 1.0, "no more wait than may be under way"
    assert sum(event.startswith("missed: ") for event in video.store.events) == sum(
        each.state == "missed" for each in video.told
    )


def test_skipping_lets_no_scan_begin_late() -> None:
    video = Video((0.3, 1.3, 0.2), seconds=60.0, limit=3, rules=SlotRules(overlap="skip"))
    outcome = video.run()
    video.check()
    assert outcome.missed > 0
    assert set(outcome.lags_s) == {0.0}


def test_a_hiccup_is_bridged_by_the_queue() -> None:
    def takes(stage: int, visit: int) -> float:
        return 2.5 if (stage, visit) == (2, 5) else 0.3

    assert Video(takes, limit=4).run().missed == 0
    assert Video(takes, limit=2).run().missed > 0


def test_a_capture_longer_than_the_interval_is_told_as_such() -> None:
    video: Video

    def slow(number: int) -> None:
        if number == 3:
            video.clock.advance(2.2)

    video = Video((0.1, 0.1, 0.1), rig=slow)
    outcome = video.run()
    video.check()
    assert outcome.missed == 1
    assert video.ledger.slots[after(4)] == ("missed", "previous scan still running")


def test_asked_to_stop_it_brings_to_its_end_what_is_under_way() -> None:
    video: Video

    def interrupt(number: int) -> None:
        if number == 7:
            video.stop.set()

    video = Video((0.9, 0.9, 0.9), rig=interrupt)
    outcome = video.run()
    assert outcome.stopped
    assert video.ledger.states() == ["taken"] * 8
    video.check()


def test_asked_to_stop_while_it_waits_for_room_it_begins_no_other() -> None:
    video: Video

    def takes(stage: int, visit: int) -> float:
        if (stage, visit) == (1, 3):
            video.stop.set()
        return 5.0

    video = Video(takes, limit=3)
    assert video.run().stopped
    video.check()


def test_groups_go_by_their_slots_however_late_the_work_is() -> None:
    video = Video((0.4, 0.4, 0.9), seconds=10.0, commit_every_s=3.0)
    video.run()
    assert video.store.groups == [4, 4]
    video.check()


def test_a_refused_scan_does_not_put_back_what_is_ahead_of_it() -> None:
    def refuse(number: int) -> None:
        if number == 4:
            raise OSError(28, "No space left on device")

    video = Video((0.4, 0.4, 0.4), store=refuse)
    outcome = video.run()
    assert (outcome.taken, outcome.failed) == (19, 1)
    video.check()


class PowerCut(BaseException):
    """Ends the process, as far as a test can."""


def test_what_no_stage_may_raise_ends_it_and_leaves_the_slots_under_way_open() -> None:
    video: Video

    def cut(number: int) -> None:
        if number == 5:
            raise PowerCut

    video = Video((0.9, 0.9, 0.9), store=cut)
    with pytest.raises(PowerCut):
        video.run()
    assert video.ledger.states() == ["taken"] * 5 + ["planned"] * 4, "as the next start finds and settles them"


def test_a_crash_of_the_threads_loses_only_what_was_not_acknowledged(tmp_path: Path) -> None:
    """By the real line, store and ledger: how much was under way is chance, that each slot has its end is not."""
    plain = campaigns.campaign_in(tmp_path).model_dump(mode="json", by_alias=True, exclude_unset=True)
    schedule = {"video": {"rate_hz": 1.0, "for": "30 s", "commit_every_s": 3.0}}
    campaign = Campaign.model_validate(plain | {"schedule": schedule})
    told: list[Settled] = []

    class Rig(campaigns.Rig):
        taken = 0

        def capture(self, patterns: object, at: Instant) -> Frames:
            self.taken += 1
            if self.taken == 17:
                raise PowerCut
            return super().capture(patterns, at)

    clock = AcceleratedClock(instant(campaigns.BASE))
    with pytest.raises(PowerCut):
        run_campaign(campaign, clock=clock, rig=Rig(), on_settled=told.append, work=campaigns.work)
    clock.advance(60)
    run_campaign(campaign, clock=clock, rig=campaigns.Rig(), work=campaigns.work)
    store = open_store(campaign.store.path)
    ledger = Ledger(ledger_beside(campaign.store.path), write=False)
    rows = ledger.rows()
    ledger.close()
    ended = {row.planned: row for row in rows}
    assert "planned" not in {row.state for row in rows}
    assert [row.planned for row in rows][:17] == [instant(campaigns.BASE) + np.timedelta64(s, "s") for s in range(17)]
    assert {row.cause for row in rows if row.state == "missed"} <= {INTERRUPTED}
    assert ended[instant(campaigns.BASE) + np.timedelta64(16, "s")].state == "missed"
    for each in told:
        assert (ended[each.planned].state, ended[each.planned].scan) == ("taken", each.number)
    assert [store[row.scan].planned for row in rows if row.scan is not None] == [
        row.planned for row in rows if row.state == "taken"
    ]


@settings(max_examples=60, deadline=None)
@given(
    takes=st.lists(st.floats(0, 4), min_size=9, max_size=9),
    captures=st.lists(st.floats(0, 2.5), max_size=10),
    fails=st.sets(st.integers(0, 30)),
    refused=st.sets(st.integers(0, 30)),
    limit=st.integers(1, 5),
    overlap=st.sampled_from(["wait", "skip"]),
    commit_every_s=st.sampled_from([0.0, 2.0]),
)
def test_each_slot_ends_in_exactly_one_state_whatever_takes_how_long(
    takes: list[float],
    captures: list[float],
    fails: set[int],
    refused: set[int],
    limit: int,
    overlap: str,
    commit_every_s: float,
) -> None:
    video: Video

    def rig(number: int) -> None:
        video.clock.advance(captures[number % len(captures)] if captures else 0.0)
        if number in fails:
            raise CaptureError("as planned")

    def store(number: int) -> None:
        if number in refused:
            raise OSError("as planned")

    video = Video(
        lambda stage, visit: takes[3 * stage + visit % 3],
        limit=limit,
        rig=rig,
        store=store,
        rules=SlotRules(overlap=overlap),  # type: ignore[arg-type]  # one of the two
        commit_every_s=commit_every_s,
    )
    outcome = video.run()
    video.check()
    assert max(video.ledger.slots) == after(19.0)
    assert outcome.taken + outcome.missed + outcome.rejected + outcome.failed == 20
    assert video.line.most <= limit
    times: list[Instant] = [scan.scan.time for scan in video.store.scans]
    assert times == sorted(times)
