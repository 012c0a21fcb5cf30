"""The loop that every campaign runs in: wait for a slot, capture, let the stages do the rest; none is lost silently."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Event as Flag
from typing import Any, Protocol

import structlog

from configs import CaptureError, DeviceUnavailable
from pipelines import Instant, PatternSet, Tick
from storage import Inbox, Store

from . import __version__
from .clock import Clock, seconds_between
from .committing import LedgerLike
from .environment import Reading
from .items import Item, Missed, Note, Visit
from .line import InlineLine, Line, Stage
from .scheduler import Slots
from .settled import Outcome, Settled
from .slot_rules import RUNNING, Gap, SlotRules, answer
from .stages import Stages
from .visit import Capture, Recipe, Work, failed_tick, visit

__all__ = ["BEGAN", "ENDED", "LayLine", "Loop", "Taker", "counts", "one_after_another"]

BEGAN = "monitoring began"
ENDED = "monitoring ended"
ROOM_AGAIN = "the disk has room again"
_log = structlog.get_logger("microrelief.loop")


class LayLine(Protocol):
    """Joins the stages of a run to a line; `stop` is set where the line breaks."""

    def __call__(self, stages: Sequence[Stage[Item]], stop: Flag) -> Line[Item]:
        """Lay it."""
        ...


class Taker(Protocol):
    """What takes captures for a loop: a rig does, of frames; see there for the verbs."""

    def open(self) -> None:
        """Take hold of the devices."""
        ...

    def capture(self, patterns: PatternSet, at: Instant) -> Capture:
        """Take what the work makes a tick of."""
        ...

    def close(self) -> None:
        """Let the devices go."""
        ...


def one_after_another(stages: Sequence[Stage[Item]], stop: Flag) -> Line[Item]:
    """Do all the work on a visit before the next is waited for."""
    return InlineLine(stages)


def counts(item: Item) -> bool:
    """Whether an item takes room in a line: a visit does."""
    return isinstance(item, Visit)


@dataclass(slots=True)
class Loop:
    """Runs one campaign on one rig into one store; the only part of the program that goes on for years.

    Parameters
    ----------
    slots, grace : Slots, callable
        When visits are due, and how late each may begin, s.
    recipe : Recipe
    rig, store, ledger, clock
    last : Instant
        The newest slot that has been dealt with; the next is the first after it.
    on_settled, on_wait : callable
        Told of each slot once it is settled and durable, and of the next one before it is waited for.
    stop : threading.Event
        Set from a signal: the scans under way are finished, and no other begun.
    work : Work
        What makes a tick of a capture.
    told : str
        What the note of the beginning says of the campaign.
    notes : bool
        Note the beginning and the end in the store; a single scan is neither.
    reading : Reading, optional
        Temperature and humidity, kept with each scan.
    inbox : Inbox, optional
        Where other processes leave events for the store, such as acknowledgements.
    room : callable
        Says why the disk has no room for another scan; empty where it has.
    commit_every_s : float
        Commit in groups of what came within so many seconds; 0 commits each visit.
    rules : SlotRules
        What happens to slots that cannot all be kept.
    asides : callable
        Says what else is to be noted in the store, since it was last asked: a changed rate, a message not delivered.
    lay : callable
        Joins the stages: one after another, or each on a thread of its own (video).
    on_worked : callable
        Told of each visit once it is worked out, and how many were under way; on the thread that compares.
    let_go : callable
        Told of a capture that nobody needs any more.
    """

    slots: Slots
    grace: Callable[[Instant], float]
    recipe: Recipe
    rig: Taker
    store: Store
    ledger: LedgerLike
    clock: Clock
    last: Instant
    on_settled: Callable[[Settled], None] = lambda settled: None
    on_wait: Callable[[Instant], None] = lambda slot: None
    stop: Flag = field(default_factory=Flag)
    work: Work[Any] = visit
    told: str = ""
    notes: bool = True
    rig_is_open: bool = False
    room: Callable[[], str] = lambda: ""
    reading: Reading | None = None
    inbox: Inbox | None = None
    commit_every_s: float = 0.0
    rules: SlotRules = field(default_factory=SlotRules)
    asides: Callable[[], Sequence[str]] = tuple
    lay: LayLine = one_after_another
    on_worked: Callable[[Visit, int], None] = lambda visit, under_way: None
    let_go: Callable[[Any], None] = lambda capture: None
    _crowded: bool = False
    _started: Instant = field(init=False)
    _busy_until: Instant = field(init=False)
    _busy: str = RUNNING

    def run(self, max_scans: int | None = None) -> Outcome:
        """Go on until the schedule is over, `stop` is set, or `max_scans` visits were made (well or not)."""
        self._started = self._busy_until = self.clock.now()
        stages = Stages(
            self.recipe,
            self.store,
            self.ledger,
            self.clock,
            self.slots,
            self.work,
            on_settled=self.on_settled,
            on_worked=lambda visit: self.on_worked(visit, line.under_way),
            let_go=self.let_go,
            commit_every_s=self.commit_every_s,
            overrun_s=self.rules.overrun_s,
            reading=self.reading,
            inbox=self.inbox,
            asides=self.asides,
        )
        if self.notes:
            stages.begin(f"{BEGAN}: microrelief {__version__}" + (f", {self.told}" if self.told else ""))
        line = self.lay(stages.stages, self.stop)
        with line:
            done = self._go_on(stages, line, max_scans)
        why = "asked to stop" if self.stop.is_set() else "visits done" if done else "schedule over"
        stages.end(f"{ENDED}: {why}, {stages.tally.counts['taken']} taken" if self.notes else "")
        return stages.tally.outcome(stopped=self.stop.is_set())

    def _go_on(self, stages: Stages, line: Line[Item], max_scans: int | None) -> bool:
        """Visit slot after slot; whether that ended because all visits were made."""
        visits = 0
        while not self.stop.is_set() and (max_scans is None or visits < max_scans):
            for text in self.clock.notices():
                line.put(Note(self.clock.now(), text))
            due = self.slots.after(self.last)
            if due is None:
                return False
            self.on_wait(due)
            self.clock.wait_until(due, self.stop)
            self._wait_for_room(line, due)
            if self.stop.is_set():
                break
            slot = self._newest_due(line, due)
            if slot is not None:
                self._visit(stages, line, slot)
                visits += 1
        return visits == max_scans

    def _wait_for_room(self, line: Line[Item], slot: Instant) -> None:
        """Where too many scans are under way, wait until one is done: slots that come due meanwhile are not kept."""
        if line.full:
            line.wait_for_room(self.stop)
            self._busy_until = self.clock.now()
            self._busy = f"behind by {seconds_between(slot, self._busy_until):.1f} s"

    def _newest_due(self, line: Line[Item], slot: Instant) -> Instant | None:
        """Of all slots that are due, miss all but the newest, and that too where the rules say so."""
        now = self.clock.now()
        found = answer(
            self.slots,
            slot,
            now,
            started=self._started,
            busy_until=self._busy_until,
            grace=self.grace,
            rules=self.rules,
            busy=self._busy,
        )
        for gap in found.gaps:
            line.put(_missed(gap, now))
            self.last = gap.last
        return found.take

    def _visit(self, stages: Stages, line: Line[Item], planned: Instant) -> None:
        """Make one visit; whatever goes wrong in it is recorded, and the campaign goes on."""
        made = Visit(planned, self.clock.now(), None, Tick(planned))
        stages.plan(planned)
        self.last = planned
        why = self.room()
        if why:
            self._without_room(made, why)
        else:
            if self._crowded:
                self._crowded = False
                line.put(Note(made.began, ROOM_AGAIN))
            self._capture(made)
        line.put(made)
        self._busy_until, self._busy = self.clock.now(), RUNNING

    def _without_room(self, made: Visit, why: str) -> None:
        """Fail a visit without a capture, before the disk is full."""
        made.fail("failed", why)
        if self._crowded:
            made.tick = Tick(made.planned)
        self._crowded = made.crowded = True

    def _capture(self, made: Visit) -> None:
        began = time.perf_counter()
        try:
            if not self.rig_is_open:
                self.rig.open()
                self.rig_is_open = True
            made.captured = self.rig.capture(self.recipe.patterns, made.began)
        except DeviceUnavailable as error:
            self._close_rig()
            made.unavailable = True
            made.fail("failed", str(error))
        except CaptureError as error:
            made.fail("failed", str(error))
        except Exception as error:  # noqa: BLE001 - see `Visit.surprise`
            made.surprise(error)
        made.timings = replace(made.timings, capture_s=time.perf_counter() - began)

    def _close_rig(self) -> None:
        self.rig_is_open = False
        try:
            self.rig.close()
        except Exception as error:  # noqa: BLE001 - it is gone already
            _log.warning("closing the rig", error=f"{type(error).__name__}: {error}")


def _missed(gap: Gap, now: Instant) -> Missed:
    settled = Settled(gap.last, "missed", gap.cause, count=len(gap.slots), first=gap.slots[0], more=gap.more)
    return Missed(gap, now, settled, failed_tick(gap.last, now, "missed", settled.told))
