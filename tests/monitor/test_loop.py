"""The loop: every planned slot ends in exactly one state, whatever happens to the rig, the store and the time."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs import CaptureError, DeviceUnavailable
from monitor.clock import AcceleratedClock
from monitor.loop import Loop
from monitor.scheduler import IntervalSlots, Slots
from monitor.settled import Outcome, Settled
from pipelines import Instant

from .stand_ins import RECIPE, T0, FakeLedger, FakeRig, FakeStore, after, whole, work

HOUR = 3600.0


def hourly(until_h: float | None = None) -> Slots:
    from datetime import timedelta

    from pipelines import as_datetime

    until = None if until_h is None else as_datetime(after(until_h * HOUR))
    return IntervalSlots(T0, timedelta(hours=1), until)


class Bench:
    """A loop with everything around it, and what it said."""

    def __init__(
        self,
        rig: Callable[[int], None] = lambda number: None,
        store: Callable[[int], None] = lambda number: None,
        *,
        until_h: float | None = 5.5,
        grace_s: float = 600.0,
        clock: AcceleratedClock | None = None,
        last: Instant | None = None,
    ) -> None:
        self.clock = clock or AcceleratedClock(T0)
        self.rig = FakeRig(rig)
        self.store = FakeStore(store)
        self.ledger = FakeLedger()
        self.told: list[Settled] = []
        self.stop = Event()
        self.loop = Loop(
            hourly(until_h),
            lambda slot: grace_s,
            RECIPE,
            self.rig,
            self.store,  # type: ignore[arg-type]  # a stand-in keeps less than a store
            self.ledger,
            self.clock,
            last if last is not None else T0 - np.timedelta64(1, "ns"),
            self.told.append,
            stop=self.stop,
            work=work,
        )

    def run(self, **options: Any) -> Outcome:
        return self.loop.run(**options)


def test_every_slot_is_taken_on_time() -> None:
    bench = Bench()
    outcome = bench.run()
    assert outcome.taken == 6
    assert outcome.lags_s == (0.0,) * 6
    assert [settled.number for settled in bench.told] == [0, 1, 2, 3, 4, 5]
    assert [tick.planned for tick in bench.store.ticks if tick.scan] == [after(hour * HOUR) for hour in range(6)]
    assert not outcome.degraded


def test_a_failed_capture_is_recorded_and_the_campaign_goes_on() -> None:
    def script(number: int) -> None:
        if number == 2:
            raise CaptureError("frame 7 was dropped")

    bench = Bench(script)
    outcome = bench.run()
    assert (outcome.taken, outcome.failed) == (5, 1)
    assert bench.ledger.slots[after(2 * HOUR)] == ("failed", "frame 7 was dropped")
    assert bench.store.events == ["failed: frame 7 was dropped"]


def test_an_unplugged_rig_is_opened_again() -> None:
    def script(number: int) -> None:
        if number in (1, 2):
            raise DeviceUnavailable("no camera")

    bench = Bench(script)
    outcome = bench.run()
    assert (outcome.taken, outcome.failed) == (4, 2)
    assert bench.rig.opened == 3
    assert bench.rig.closed == 2


def test_a_bug_is_recorded_with_its_traceback_and_the_campaign_goes_on(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    def script(number: int) -> None:
        if number == 0:
            raise ZeroDivisionError("oops")

    bench = Bench(script)
    assert bench.run().taken == 5
    assert bench.ledger.slots[T0] == ("failed", "unexpected ZeroDivisionError: oops")
    told = capsys.readouterr()
    # where the log goes depends on whether a command has set it up in this process already
    assert "in script" in told.out + told.err + caplog.text


def test_frames_that_cannot_be_worked_out_are_rejected() -> None:
    bench = Bench()

    def undecodable(frames: Any, recipe: Any, epoch: Any, planned: Instant) -> Any:
        raise ValueError("frames of another rig")

    bench.loop.work = whole(undecodable)
    assert bench.run().rejected == 6
    assert set(bench.ledger.states()) == {"rejected"}


def test_a_store_that_refuses_costs_one_scan_only() -> None:
    def full(number: int) -> None:
        if number == 1:
            raise OSError(28, "No space left on device")

    bench = Bench(store=full)
    outcome = bench.run()
    assert (outcome.taken, outcome.failed) == (5, 1)
    assert len(bench.store) == 5


def test_slots_due_while_a_scan_runs_are_missed_with_that_cause() -> None:
    bench: Bench

    def slow(number: int) -> None:
        if number == 1:
            bench.clock.advance(2.5 * HOUR)  # from slot 1 until half past 3: slots 2 and 3 come due

    bench = Bench(slow)
    outcome = bench.run()
    assert bench.ledger.states() == ["taken", "taken", "missed", "missed", "taken", "taken"]
    assert bench.ledger.slots[after(3 * HOUR)] == ("missed", "previous scan still running")
    assert outcome.missed == 2
    assert len(bench.store.events) == 1, "one event for the gap, not one for each slot"


def test_an_overrun_within_the_grace_only_delays_the_next_scan() -> None:
    bench: Bench

    def slow(number: int) -> None:
        if number == 1:
            bench.clock.advance(HOUR + 60)

    bench = Bench(slow)
    outcome = bench.run()
    assert outcome.taken == 6
    assert outcome.lags_s[2] == pytest.approx(60)


def test_slots_of_a_machine_that_was_off_are_missed_not_caught_up() -> None:
    bench = Bench(clock=AcceleratedClock(after(3.5 * HOUR)), last=T0)
    outcome = bench.run()
    assert bench.rig.captures == 2
    assert bench.ledger.states() == ["missed"] * 3 + ["taken"] * 2
    assert bench.ledger.slots[after(HOUR)][1] == "microrelief was not running"
    assert outcome.missed == 3
    assert bench.store.events == [
        "missed: missed 3 slots, 2026-01-01T01:00:00Z to 2026-01-01T03:00:00Z: microrelief was not running"
    ]


def test_a_start_within_the_grace_takes_the_newest_due_slot() -> None:
    bench = Bench(clock=AcceleratedClock(after(3 * HOUR + 120)), last=T0)
    bench.run()
    assert bench.ledger.states() == ["missed"] * 2 + ["taken"] * 3


def test_a_machine_that_slept_says_so() -> None:
    class Sleepy(AcceleratedClock):
        def wait_until(self, moment: Instant, stop: Event) -> None:
            super().wait_until(moment, stop)
            if moment == after(2 * HOUR):
                self.advance(2.5 * HOUR)

    bench = Bench(clock=Sleepy(T0))
    bench.run()
    assert bench.ledger.states() == ["taken", "taken", "missed", "missed", "missed", "taken"]
    assert bench.ledger.slots[after(3 * HOUR)][1] == "the machine slept, or its clock was set forward"


def test_a_stop_finishes_the_scan_under_way_and_begins_no_other() -> None:
    bench: Bench

    def interrupt(number: int) -> None:
        if number == 1:
            bench.stop.set()

    bench = Bench(interrupt)
    outcome = bench.run()
    assert bench.ledger.states() == ["taken", "taken"]
    assert outcome.stopped
    assert len(bench.store) == 2


def test_max_scans_counts_visits_so_that_a_dead_rig_ends_too() -> None:
    def dead(number: int) -> None:
        raise CaptureError("dead")

    bench = Bench(dead, until_h=None)
    assert bench.run(max_scans=7).failed == 7


@settings(max_examples=60, deadline=None)
@given(
    takes=st.lists(st.floats(0, 4 * HOUR), max_size=20),
    fails=st.sets(st.integers(0, 20)),
    restarts=st.lists(st.tuples(st.integers(1, 4), st.floats(0, 6 * HOUR)), max_size=4),
    grace_s=st.floats(1, HOUR),
)
def test_each_slot_of_the_grid_ends_in_exactly_one_state(
    takes: list[float], fails: set[int], restarts: list[tuple[int, float]], grace_s: float
) -> None:
    """Whatever visits take, fail, and however often the process is started anew: no hole, no double, one grid."""
    bench: Bench

    def script(number: int) -> None:
        bench.clock.advance(takes[number % len(takes)] if takes else 0.0)
        if number in fails:
            raise CaptureError("as planned")

    bench = Bench(script, until_h=48, grace_s=grace_s)
    for visits, off_s in restarts:
        bench.run(max_scans=visits)
        bench.clock.advance(off_s)
    bench.run()
    newest = max(bench.ledger.slots)
    expected = [T0]
    while expected[-1] < newest:
        expected.append(expected[-1] + np.timedelta64(3600, "s"))
    assert sorted(bench.ledger.slots) == expected
    assert newest == after(48 * HOUR)
    assert "planned" not in bench.ledger.states()
    taken = [planned for planned, (state, _) in bench.ledger.slots.items() if state == "taken"]
    assert sorted(taken) == [scan.planned for scan in bench.store.scans]
    times = [scan.scan.time for scan in bench.store.scans]
    assert times == sorted(times)
