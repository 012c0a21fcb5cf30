"""Stages: what is done with every slot once its frames are there, in the order of the slots.

Reconstruct, compare, commit.
Each stage is told of every item and works on one at a time; an item belongs to the stage that has it in hand. What the
alarms remember belongs to `compare`, the store and the ledger to `commit`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any

from pipelines import Instant, Tick, format_instant
from storage import Inbox, Store

from .alarms import Watches, after_gap, resumed, told
from .baseline import unfit
from .clock import Clock, seconds_between
from .committing import Committer, LedgerLike
from .environment import Reading
from .items import Item, Missed, Note, Visit
from .line import Stage
from .scheduler import Slots
from .settled import Settled, Tally
from .visit import Epoch, Recipe, Work

__all__ = ["Stages"]


@dataclass(slots=True)
class Stages:
    """The three stages of one run.

    Parameters
    ----------
    recipe, store, ledger, clock
    slots : Slots
        Of the campaign: a group is committed before the slot that it may not wait for.
    work : Work
    on_settled : callable
        Told of each slot once it is settled and durable.
    on_worked : callable
        Told of each visit as soon as it is worked out, before it is durable.
    let_go : callable
        Told of a capture that nobody needs any more.
    commit_every_s, overrun_s, reading, inbox, asides
        As `Loop` has them.
    """

    recipe: Recipe
    store: Store
    ledger: LedgerLike
    clock: Clock
    slots: Slots
    work: Work[Any]
    on_settled: Callable[[Settled], None]
    on_worked: Callable[[Visit], None]
    let_go: Callable[[Any], None]
    commit_every_s: float
    overrun_s: float | None
    reading: Reading | None
    inbox: Inbox | None
    asides: Callable[[], Sequence[str]]
    tally: Tally = field(default_factory=Tally)
    _commits: Committer = field(init=False)
    _epoch: Epoch | None = None
    _awaits_baseline: bool = False
    _watches: Watches = field(default_factory=dict)
    _stored_watches: Watches = field(default_factory=dict)
    _put_back: Watches | None = None
    _lock: Lock = field(default_factory=Lock)

    def __post_init__(self) -> None:
        """Go on from what the store holds."""
        if len(self.store):
            newest = self.store[-1]
            self._epoch = Epoch(self.store[newest.baseline].scan)
        self._watches = self._stored_watches = resumed(self.recipe.alarms, self.store, self.recipe.environment)
        self._commits = Committer(self.store, self.commit_every_s)

    @property
    def stages(self) -> tuple[Stage[Item], ...]:
        """The stages in their order. What is compared with a baseline waits until the store gives that back."""
        return (
            Stage("reconstruct", self.reconstruct),
            Stage("compare", self.compare, lambda: not self._awaits_baseline),
            Stage("commit", self.commit),
        )

    def plan(self, planned: Instant) -> None:
        """Note in the ledger, before anything is captured, that a slot is worked on."""
        self._commits.record(lambda: self.ledger.plan(planned))

    def begin(self, text: str) -> None:
        """Note in the store that the run begins."""
        self._commits.note(self.clock.now(), "note", text)
        self._commits.flush()

    def end(self, text: str) -> None:
        """Commit what waits for its group, and note that the run ends; empty notes nothing. No item is under way."""
        self._take_in()
        self._commits.flush()
        self._note_asides()
        if text:
            self._commits.note(self.clock.now(), "note", text)
        self._commits.flush()

    def reconstruct(self, item: Item) -> None:
        """From a capture to a height map; then nobody needs its frames, unless they are kept."""
        if not isinstance(item, Visit) or item.captured is None:
            return
        began, item.taken_at = time.perf_counter(), item.captured.time
        try:
            item.measured = self.work.reconstruct(item.captured, self.recipe)
        except ValueError as error:  # CaptureError is one
            item.fail("rejected", str(error))
        except Exception as error:  # noqa: BLE001 - see `surprise`
            item.surprise(error)
        item.timings = replace(item.timings, reconstruct_s=time.perf_counter() - began)
        if not self.recipe.keep_frames:
            self._release(item)

    def compare(self, item: Item) -> None:
        """Compare with the baseline, measure, and judge the alarms, which remember what was before."""
        if isinstance(item, Note):
            return
        with self._lock:
            held, self._put_back = self._put_back, None
        self._watches = self._watches if held is None else held
        if isinstance(item, Missed):
            item.tick = self._silent(item.tick, item.now, len(item.gap.slots), item.gap.cause)
            item.watches = self._watches
            return
        if item.measured is not None:
            began = time.perf_counter()
            self._judge(item)
            item.measured = None
            item.timings = replace(item.timings, compare_s=time.perf_counter() - began)
        if item.tick.scan is None:
            item.tick = self._silent(item.tick, item.began, 1, item.cause)
        else:
            item.worked_out = self.clock.now()
            item.begins = self._epoch is None or item.tick.change is None
            self._awaits_baseline = item.begins
        item.watches = self._watches
        self.on_worked(item)

    def commit(self, item: Item) -> None:
        """Make it durable, alone or with its group, and settle its slot."""
        self._take_in()
        if isinstance(item, Note):
            self._commits.note(item.moment, "note", item.text)
            return
        if isinstance(item, Missed):
            self._commit_missed(item)
            planned = item.gap.last
        else:
            self._commit_visit(item)
            planned = item.planned
        self._note_asides()
        self._commits.flush_before(self.slots.after(planned))

    def _judge(self, item: Visit) -> None:
        air = self.reading.at(item.taken_at) if self.reading is not None and item.taken_at is not None else {}
        epoch = replace(self._epoch, watches=self._watches, air=air) if self._epoch is not None else None
        try:
            result = self.work.compare(item.measured, self.recipe, epoch, item.planned)
        except ValueError as error:
            item.fail("rejected", str(error))
            return
        except Exception as error:  # noqa: BLE001 - see `surprise`
            item.surprise(error)
            return
        tick = result.tick
        if tick.scan is not None and epoch is None and (why := unfit(tick.scan, tick.events)):
            item.fail("rejected", why)
            return
        if self._epoch is not None and tick.change is not None:
            self._epoch = replace(self._epoch, near=tick.change.motion)
        before, self._watches = self._watches, result.watches
        if epoch is None and tick.scan is not None and before:  # there was no data before the first scan
            changes = told(self.recipe.alarms, before, self._watches, tick.scan.time)
            tick = replace(tick, events=(*tick.events, *(change.event for change in changes)))
        if self.reading is not None:
            tick = self.reading.beside(tick)
        item.tick, item.state, item.cause = tick, result.state, result.cause

    def _silent(self, tick: Tick, now: Instant, slots: int, cause: str) -> Tick:
        """Let the alarms know of slots that gave no scan; where that changes one, the tick says so."""
        before, self._watches = self._watches, after_gap(self.recipe.alarms, self._watches, slots, cause)
        changes = told(self.recipe.alarms, before, self._watches, now)
        return replace(tick, events=(*tick.events, *(change.event for change in changes)))

    def _commit_missed(self, item: Missed) -> None:
        """Record missed slots: a row each in the ledger, one event for all of them in the store."""
        slots, cause = [*dict.fromkeys((*item.gap.slots, item.gap.last))], item.gap.cause
        self._commits.record(lambda: self.ledger.settle_all(slots, "missed", cause))

        def done(number: int | None, why: str) -> None:
            if not why:
                self._remember(item.watches, "")
            self._tell(item.settled)

        self._commits.add(item.tick, done)

    def _commit_visit(self, item: Visit) -> None:
        scanned = item.tick.scan is not None

        def done(number: int | None, why: str) -> None:
            ended, because = item.state, item.cause
            if number is None and scanned:
                ended, because = "failed", f"not stored: {why}"
            self._commits.record(lambda: self.ledger.settle(item.planned, ended, because, number))
            self._remember(item.watches, why)
            if item.begins:
                # as the store gives it back: a restart compares with the same numbers
                self._epoch = Epoch(self.store[number].scan) if number is not None else self._epoch
                self._awaits_baseline = False
            self._release(item)
            took = seconds_between(item.began, self.clock.now())
            self._tell(
                Settled(
                    item.planned, ended, because, number, item.tick, item.unavailable,
                    item.began, item.latency_s, took, item.timings,
                )
            )  # fmt: skip

        if item.crowded and not item.tick.events:
            done(None, "")  # told once in the store, in the ledger for each slot: the reserve is not to be written full
        else:
            self._commits.add(item.tick, done, at_once=item.begins)
        took = seconds_between(item.began, now := self.clock.now())
        if self.overrun_s is not None and took > self.overrun_s:
            text = f"visit {format_instant(item.planned)} took {took:.1f} s, more than {self.overrun_s:g} s"
            self._commits.note(now, "note", text)

    def _remember(self, watches: Watches, why: str) -> None:
        """What is kept counts: where the store refused a scan, the next is judged against what the store holds."""
        if not why:
            self._stored_watches = watches
        held = {name: replace(each, silent=each.silent + 1) for name, each in self._stored_watches.items()}
        with self._lock:
            self._put_back = held if why else None

    def _take_in(self) -> None:
        """Put into the store what others left for it."""
        waiting = self.inbox.waiting() if self.inbox is not None else ()
        if self.inbox is None or not waiting:
            return
        inbox, files = self.inbox, [file for file, _ in waiting]
        tick = Tick(self.clock.now(), events=tuple(event for _, event in waiting))
        self._commits.add(tick, lambda number, why: None if why else inbox.taken(files), at_once=True)

    def _note_asides(self) -> None:
        for text in self.asides():
            self._commits.note(self.clock.now(), "note", text)

    def _release(self, item: Visit) -> None:
        captured, item.captured = item.captured, None
        if captured is not None:
            self.let_go(captured)

    def _tell(self, settled: Settled) -> None:
        self.tally.add(settled)
        self.on_settled(settled)
