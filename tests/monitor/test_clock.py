"""The real clock: whatever is done to the system's, it never goes back, stalls or bursts."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from threading import Event

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.clock import NAP_S, RealClock, seconds_between
from monitor.loop import Loop
from monitor.scheduler import IntervalSlots
from pipelines import Instant

from .stand_ins import RECIPE, T0, FakeLedger, FakeRig, FakeStore, after, work

HOUR = 3600.0
YEAR = 365 * 86400.0


class Machine:
    """A machine whose clock can be set; time passes on it when it waits."""

    def __init__(self) -> None:
        self.even = 50.0
        self.wrong = 0.0
        self.steps: list[tuple[float, float]] = []

    def wall(self) -> float:
        return seconds_between(np.datetime64(0, "ns"), T0) + self.even - 50.0 + self.wrong

    def pass_by(self, seconds: float) -> None:
        self.even += seconds
        for step in [each for each in self.steps if each[0] <= self.even - 50.0]:
            self.wrong += step[1]
            self.steps.remove(step)

    def clock(self, **options: object) -> RealClock:
        return RealClock(self.wall, lambda: self.even, **options)  # type: ignore[arg-type]  # as the clock has them

    def stop(self) -> Event:
        machine = self

        class Waiting(Event):
            def wait(self, timeout: float | None = None) -> bool:
                assert timeout is not None
                assert timeout <= NAP_S
                machine.pass_by(timeout + 1e-6)
                return self.is_set()

        return Waiting()


def campaign(machine: Machine, every: timedelta, *, visits: int) -> tuple[Loop, list[tuple[float, Instant]]]:
    """Run a campaign on a machine; give when each visit was made, in even seconds, and its slot."""
    made: list[tuple[float, Instant]] = []
    ledger = FakeLedger()
    loop = Loop(
        IntervalSlots(T0, every),
        lambda slot: every.total_seconds() / 2,
        RECIPE,
        FakeRig(),
        FakeStore(),  # type: ignore[arg-type]  # a stand-in keeps less than a store
        ledger,
        machine.clock(),
        T0 - np.timedelta64(1, "ns"),
        lambda settled: made.append((machine.even, settled.planned)) if settled.state == "taken" else None,
        stop=machine.stop(),
        work=work,
    )
    loop.run(max_scans=visits)
    return loop, made


@pytest.mark.parametrize("step", [-HOUR, HOUR, YEAR])
@pytest.mark.parametrize("every_s", [0.2, 60.0, 6 * HOUR])
def test_a_step_of_the_clock_makes_no_burst_and_no_stall_beyond_one_interval(step: float, every_s: float) -> None:
    machine = Machine()
    machine.steps = [(4.5 * every_s, step)]
    loop, made = campaign(machine, timedelta(seconds=every_s), visits=10)
    moments = [moment for moment, _ in made]
    waits = np.diff(moments)
    assert len(made) == 10
    assert waits.max() <= 2 * every_s * 1.03, "a stall: more than an interval late"
    late = waits[waits < 0.4 * every_s]
    assert len(late) <= 1, "a burst: only the first slot after the step may come early"
    planned = [slot for _, slot in made]
    assert planned == sorted(planned)
    notes = [event.text for tick in loop.store.ticks for event in tick.events if event.kind == "note"]  # type: ignore[attr-defined]
    assert any("clock was set" in note for note in notes)
    if step == YEAR and every_s < 1:
        told = [text for text in loop.store.events if "missed" in str(text)]
        assert "more than 5000 slots" in str(told), "a span is told, not 150 million rows"
        assert len(loop.ledger.slots) < 6000  # type: ignore[attr-defined]


@given(st.lists(st.tuples(st.floats(0, 1000), st.floats(-5000, 5000)), max_size=30))
def test_time_never_goes_back(story: list[tuple[float, float]]) -> None:
    machine = Machine()
    clock = machine.clock()
    before = clock.now()
    for passed, set_by in story:
        machine.even += passed
        machine.wrong += set_by
        now = clock.now()
        assert now >= before
        before = now


def test_a_clock_that_was_set_back_is_caught_up_with() -> None:
    machine = Machine()
    clock = machine.clock()
    machine.wrong -= HOUR
    assert seconds_between(after(0), clock.now()) == pytest.approx(0, abs=1e-3)
    for _ in range(100):
        machine.even += HOUR
        clock.now()
    assert seconds_between(after(99 * HOUR), clock.now()) == pytest.approx(0, abs=1e-3)
    assert clock.notices() == ("the system's clock was set back by 1 h",)
    assert clock.notices() == ()


def test_a_machine_without_a_battery_goes_on_from_its_newest_scan() -> None:
    machine = Machine()
    machine.wrong = -56 * YEAR  # it is 1970
    clock = machine.clock(not_before=after(0))
    assert clock.now() >= after(0)
    machine.even += 60
    machine.wrong = 0.0  # and then it hears from a time server
    assert seconds_between(after(60), clock.now()) == pytest.approx(0, abs=1e-3)
    assert "behind the newest scan" in clock.notices()[0]


def test_naps_are_told_so_that_a_watchdog_knows_of_a_long_wait() -> None:
    machine, naps = Machine(), 0

    def nap() -> None:
        nonlocal naps
        naps += 1

    options: dict[str, Callable[[], None]] = {"nap": nap}
    machine.clock(**options).wait_until(after(600), machine.stop())
    assert naps >= 600 / NAP_S
