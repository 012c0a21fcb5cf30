"""The loop that every campaign runs in: wait for a slot, visit, commit, settle; nothing is skipped in silence."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Event as Flag
from typing import get_args

import structlog

from configs import CaptureError, DeviceUnavailable
from pipelines import Frames, Instant, Tick, format_instant
from storage import Inbox, Store

from . import __version__
from .alarms import Watches, after_gap, resumed, told
from .baseline import unfit
from .clock import Clock, seconds_between
from .committing import Committer, LedgerLike
from .environment import Reading
from .rigs import Rig
from .scheduler import Slots
from .slot_rules import NOT_RUNNING, Gap, SlotRules, answer
from .visit import Epoch, Recipe, State, Yield, failed_tick, visit

__all__ = ["BEGAN", "ENDED", "LedgerLike", "Loop", "Outcome", "Settled"]

BEGAN = "monitoring began"
ENDED = "monitoring ended"
ROOM_AGAIN = "the disk has room again"
_log = structlog.get_logger("microrelief.loop")


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """How one slot ended, or several in a row that were missed for one cause.

    Parameters
    ----------
    planned : Instant
        The slot; of several, the newest.
    state : {"taken", "missed", "rejected", "failed"}
    cause : str
    number : int or None
        Of the scan, once it is durable; None where there is none.
    tick : Tick or None
        None for a missed slot.
    unavailable : bool
        The device was not there: a later try may work.
    lag_s : float
        How long after the slot the visit began; NaN for a missed slot.
    took_s : float
        From there until the scan was durable, by the campaign's clock; NaN for a missed slot.
    count : int
        How many slots.
    first : Instant or None
        Of several, the oldest.
    more : bool
        There were too many to count.
    """

    planned: Instant
    state: State
    cause: str = ""
    number: int | None = None
    tick: Tick | None = None
    unavailable: bool = False
    lag_s: float = float("nan")
    took_s: float = float("nan")
    count: int = 1
    first: Instant | None = None
    more: bool = False

    @property
    def told(self) -> str:
        """Which slots were missed, in words: ``missed 4 slots, FIRST to LAST: cause``."""
        span = " to ".join(dict.fromkeys((format_instant(self.first or self.planned), format_instant(self.planned))))
        count = f"{'more than ' if self.more else ''}{self.count} {'slot' if self.count == 1 else 'slots'}"
        return f"{self.state} {count}, {span}: {self.cause}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run did.

    Parameters
    ----------
    taken, missed, rejected, failed : int
        Slots that ended so; `missed` counts those of before the run too.
    away : int
        Of `missed`, the slots of before the run, when nothing ran.
    lags_s : tuple of float
        How late each visit began.
    stopped : bool
        It was asked to stop before the schedule was over.
    """

    taken: int = 0
    missed: int = 0
    rejected: int = 0
    failed: int = 0
    away: int = 0
    lags_s: tuple[float, ...] = ()
    stopped: bool = False

    @property
    def degraded(self) -> bool:
        """Whether any slot did not end well while this ran."""
        return self.missed > self.away or bool(self.rejected or self.failed)


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
        Set from a signal: the scan under way is finished, and no other begun.
    work : callable
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
    """

    slots: Slots
    grace: Callable[[Instant], float]
    recipe: Recipe
    rig: Rig
    store: Store
    ledger: LedgerLike
    clock: Clock
    last: Instant
    on_settled: Callable[[Settled], None] = lambda settled: None
    on_wait: Callable[[Instant], None] = lambda slot: None
    stop: Flag = field(default_factory=Flag)
    work: Callable[[Frames, Recipe, Epoch | None, Instant], Yield] = visit
    told: str = ""
    notes: bool = True
    rig_is_open: bool = False
    room: Callable[[], str] = lambda: ""
    reading: Reading | None = None
    inbox: Inbox | None = None
    commit_every_s: float = 0.0
    rules: SlotRules = field(default_factory=SlotRules)
    asides: Callable[[], Sequence[str]] = tuple
    _commits: Committer = field(init=False)
    _epoch: Epoch | None = None
    _watches: Watches = field(default_factory=dict)
    _stored_watches: Watches = field(default_factory=dict)
    _crowded: bool = False
    _started: Instant = field(init=False)
    _busy_until: Instant = field(init=False)
    _counts: dict[State, int] = field(default_factory=lambda: dict.fromkeys(get_args(State), 0))
    _away: int = 0
    _unavailable: bool = False
    _lags: list[float] = field(default_factory=list)

    def run(self, max_scans: int | None = None) -> Outcome:
        """Go on until the schedule is over, `stop` is set, or `max_scans` visits were made (well or not)."""
        if len(self.store):
            newest = self.store[-1]
            self._epoch = Epoch(self.store[newest.baseline].scan)
        self._watches = self._stored_watches = resumed(self.recipe.alarms, self.store, self.recipe.environment)
        self._commits = Committer(self.store, self.clock, self.commit_every_s)
        self._started = self._busy_until = self.clock.now()
        self._note(f"{BEGAN}: microrelief {__version__}" + (f", {self.told}" if self.told else ""))
        visits = 0
        while not self.stop.is_set() and (max_scans is None or visits < max_scans):
            self._note_asides()
            slot = self.slots.after(self.last)
            self._commits.flush_before(slot)
            if slot is None:
                break
            self.on_wait(slot)
            self.clock.wait_until(slot, self.stop)
            if self.stop.is_set():
                break
            self._take_in()
            slot = self._newest_due(slot)
            if slot is not None:
                self._visit(slot)
                visits += 1
        self._take_in()
        self._commits.flush()
        self._note_asides()
        why = "asked to stop" if self.stop.is_set() else "visits done" if visits == max_scans else "schedule over"
        self._note(f"{ENDED}: {why}, {self._counts['taken']} taken")
        return Outcome(**self._counts, away=self._away, lags_s=tuple(self._lags), stopped=self.stop.is_set())

    def _note(self, text: str) -> None:
        """Note in the store that monitoring began or ended: without the end, somebody pulled the plug."""
        if not self.notes:
            return
        self._commits.note(self.clock.now(), "note", text)
        self._commits.flush()

    def _take_in(self) -> None:
        """Put into the store what others left for it."""
        waiting = self.inbox.waiting() if self.inbox is not None else ()
        if self.inbox is None or not waiting:
            return
        inbox, files = self.inbox, [file for file, _ in waiting]
        tick = Tick(self.clock.now(), events=tuple(event for _, event in waiting))
        self._commits.add(tick, lambda number, why: None if why else inbox.taken(files), at_once=True)

    def _note_asides(self) -> None:
        for text in (*self.clock.notices(), *self.asides()):
            self._commits.note(self.clock.now(), "note", text)

    def _newest_due(self, slot: Instant) -> Instant | None:
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
        )
        for gap in found.gaps:
            self._miss(gap, now)
        return found.take

    def _miss(self, gap: Gap, now: Instant) -> None:
        """Record missed slots: a row each in the ledger, one event for all of them in the store."""
        self._commits.record(
            lambda: self.ledger.settle_all([*dict.fromkeys((*gap.slots, gap.last))], "missed", gap.cause)
        )
        self.last = gap.last
        if gap.cause == NOT_RUNNING:
            self._away += len(gap.slots)
        settled = Settled(gap.last, "missed", gap.cause, count=len(gap.slots), first=gap.slots[0], more=gap.more)
        tick = self._silent(failed_tick(gap.last, now, "missed", settled.told), now, len(gap.slots), gap.cause)
        watches = self._watches

        def done(number: int | None, why: str) -> None:
            if not why:
                self._watches = self._stored_watches = watches
            self._tell(settled)

        self._commits.add(tick, done)

    def _silent(self, tick: Tick, now: Instant, slots: int, cause: str) -> Tick:
        """Let the alarms know of slots that gave no scan; where that changes one, the tick says so."""
        before, self._watches = self._watches, after_gap(self.recipe.alarms, self._watches, slots, cause)
        changes = told(self.recipe.alarms, before, self._watches, now)
        return replace(tick, events=(*tick.events, *(change.event for change in changes)))

    def _visit(self, planned: Instant) -> None:
        """Make one visit; whatever goes wrong in it is recorded, and the campaign goes on."""
        began = self.clock.now()
        lag = seconds_between(planned, began)
        self._commits.record(lambda: self.ledger.plan(planned))
        self.last = planned
        self._unavailable = False
        crowded = self.room()
        if crowded:
            tick, state, cause = self._without_room(planned, began, crowded)
        else:
            self._note_room(began)
            tick, state, cause = self._work(planned, began)
        if tick.scan is None:
            tick = self._silent(tick, began, 1, cause)
        begins = self._epoch is None or tick.change is None
        unavailable, watches = self._unavailable, self._watches

        def done(number: int | None, why: str) -> None:
            ended, because = state, cause
            if number is None and tick.scan is not None:
                ended, because = "failed", f"not stored: {why}"
            self._commits.record(lambda: self.ledger.settle(planned, ended, because, number))
            self._after(number, tick, begins, watches, why)
            self._busy_until = self.clock.now()
            took = seconds_between(began, self._busy_until)
            self._lags.append(lag)
            self._tell(Settled(planned, ended, because, number, tick, unavailable, lag, took))

        if crowded and not tick.events:
            done(None, "")  # told once in the store, in the ledger for each slot: the reserve is not to be written full
        else:
            self._commits.add(tick, done, at_once=begins and tick.scan is not None)
        self._busy_until = self.clock.now()
        self._note_overrun(planned, began)

    def _note_overrun(self, planned: Instant, began: Instant) -> None:
        took, limit = seconds_between(began, self._busy_until), self.rules.overrun_s
        if limit is not None and took > limit:
            text = f"visit {format_instant(planned)} took {took:.1f} s, more than {limit:g} s"
            self._commits.note(self._busy_until, "note", text)

    def _without_room(self, planned: Instant, began: Instant, why: str) -> tuple[Tick, State, str]:
        """Fail a visit without a capture, before the disk is full."""
        known, self._crowded = self._crowded, True
        return (Tick(planned) if known else failed_tick(planned, began, "failed", why)), "failed", why

    def _note_room(self, now: Instant) -> None:
        if self._crowded:
            self._crowded = False
            self._commits.note(now, "note", ROOM_AGAIN)

    def _work(self, planned: Instant, began: Instant) -> tuple[Tick, State, str]:
        try:
            if not self.rig_is_open:
                self.rig.open()
                self.rig_is_open = True
            frames = self.rig.capture(self.recipe.patterns, began)
        except DeviceUnavailable as error:
            self._unavailable = True
            self._close_rig()
            return failed_tick(planned, began, "failed", str(error)), "failed", str(error)
        except CaptureError as error:
            return failed_tick(planned, began, "failed", str(error)), "failed", str(error)
        except Exception as error:  # noqa: BLE001 - a driver's bug must not end a campaign of years
            return self._surprise(planned, began, error)
        try:
            air = self.reading.at(frames.time) if self.reading is not None else {}
            epoch = Epoch(self._epoch.baseline, self._watches, air) if self._epoch is not None else None
            result = self.work(frames, self.recipe, epoch, planned)
        except ValueError as error:  # CaptureError is one
            return failed_tick(planned, began, "rejected", str(error)), "rejected", str(error)
        except Exception as error:  # noqa: BLE001 - nor must our own
            return self._surprise(planned, began, error)
        tick = result.tick
        if tick.scan is not None and epoch is None and (why := unfit(tick.scan, tick.events)):
            return failed_tick(planned, began, "rejected", why), "rejected", why
        before, self._watches = self._watches, result.watches
        if epoch is None and tick.scan is not None and before:  # there was no data before the first scan
            changes = told(self.recipe.alarms, before, self._watches, tick.scan.time)
            tick = replace(tick, events=(*tick.events, *(change.event for change in changes)))
        if self.reading is not None:
            tick = self.reading.beside(tick)
        return tick, result.state, result.cause

    def _surprise(self, planned: Instant, began: Instant, error: Exception) -> tuple[Tick, State, str]:
        _log.error("unexpected error", planned=format_instant(planned), traceback=traceback.format_exc())
        text = f"unexpected {type(error).__name__}: {error}"
        return failed_tick(planned, began, "failed", text), "failed", text

    def _after(self, number: int | None, tick: Tick, begins: bool, watches: Watches, why: str) -> None:
        """Hold the epoch's baseline as the store gives it back, so that a restart compares with the same numbers."""
        if not why:
            self._watches = self._stored_watches = watches
        else:  # refused: the next alarm is judged against what is kept
            self._watches = {name: replace(each, silent=each.silent + 1) for name, each in self._stored_watches.items()}
        if begins and number is not None:
            self._epoch = Epoch(self.store[number].scan)

    def _tell(self, settled: Settled) -> None:
        self._counts[settled.state] += settled.count
        self.on_settled(settled)

    def _close_rig(self) -> None:
        self.rig_is_open = False
        try:
            self.rig.close()
        except Exception as error:  # noqa: BLE001 - it is gone already
            _log.warning("closing the rig", error=f"{type(error).__name__}: {error}")
