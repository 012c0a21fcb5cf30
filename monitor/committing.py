"""Commits: ticks into the store, alone or in groups, and slots into the ledger; what a full disk refuses is owed."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Protocol

import numpy as np
import structlog

from pipelines import Event, Instant, Tick, format_instant
from storage import LedgerWriteError, Store

from .visit import State

__all__ = ["Committer", "LedgerLike"]

Done = Callable[[int | None, str], None]
"""Called with a scan's number once it is durable, or None; and why a scan was refused."""

_log = structlog.get_logger("microrelief.store")


class LedgerLike(Protocol):
    """What the loop needs of the ledger."""

    def plan(self, planned: Instant) -> None:
        """Note that a slot is being worked on."""
        ...

    def settle(self, planned: Instant, state: State, cause: str = "", scan: int | None = None) -> None:
        """Note how a slot ended, and with which scan; one that was never worked on need not be planned before."""
        ...

    def settle_all(self, planned: Sequence[Instant], state: State, cause: str = "") -> None:
        """Note at once how many slots ended that nobody worked on."""
        ...


@dataclass(slots=True)
class _Refused:
    """Scans that the store did not take, one after another, for the reason of the last."""

    first: Instant
    last: Instant
    count: int
    why: str

    def event(self) -> Event:
        span = " to ".join(dict.fromkeys((format_instant(self.first), format_instant(self.last))))
        return Event(self.last, "failed", f"{self.count} not stored, {span}: {self.why}")


@dataclass(slots=True)
class Committer:
    """Commits what a loop yields.

    A store or disk that refuses costs the ticks at hand and no more: rows of the ledger that could not be written, and
    the event that tells of refused scans, are owed and written with the next thing that the disk takes.

    Parameters
    ----------
    store : Store
    every_s : float
        Commit in groups of what was planned within so many seconds; 0 commits each tick at once.
    """

    store: Store
    every_s: float = 0.0
    _group: list[tuple[Tick, Done]] = field(default_factory=list)
    _due: Instant | None = None
    _rows: list[Callable[[], None]] = field(default_factory=list)
    _refused: _Refused | None = None
    _lock: Lock = field(default_factory=Lock)

    def add(self, tick: Tick, done: Done, *, at_once: bool = False) -> None:
        """Commit a tick with the group that it falls into, or at once."""
        if not self._group:
            self._due = tick.planned + np.timedelta64(round(self.every_s * 1e9), "ns")
        self._group.append((tick, done))
        if at_once or self.every_s <= 0:
            self.flush()

    def flush_before(self, moment: Instant | None) -> None:
        """Commit the group if it is due before `moment`, the next slot; None: there is none."""
        if self._due is not None and (moment is None or moment > self._due):
            self.flush()

    def flush(self) -> None:
        """Commit the group now; once the store takes things again, say in it what it refused."""
        group, self._group, self._due = self._group, [], None
        results = self._stored([tick for tick, _ in group])
        for (_, done), (number, why) in zip(group, results, strict=True):
            done(number, why)
        if self._refused is not None and not any(why for _, why in results):
            self._tell_refused(self._refused.event())

    def note(self, moment: Instant, kind: str, text: str) -> None:
        """Put an event into the store."""
        self.add(Tick(moment, events=(Event(moment, kind, text),)), lambda number, why: None)

    def record(self, row: Callable[[], None]) -> None:
        """Write a row of the ledger, after those that are owed; owe it where the disk does not take it.

        Safe to call from several threads.
        """
        with self._lock:
            self._rows.append(row)
            while self._rows:
                oldest = self._rows.pop(0)
                try:
                    oldest()
                except LedgerWriteError as error:
                    self._rows.insert(0, oldest)
                    _log.error("ledger", error=str(error), owed=len(self._rows))
                    return

    def _stored(self, ticks: list[Tick]) -> list[tuple[int | None, str]]:
        if len(ticks) > 1:
            try:
                return [(number, "") for number in self.store.append_all(ticks)]
            except Exception as error:  # noqa: BLE001 - each is tried alone: a bad one must not cost the others
                self._log(error)
        return [self._one(tick) for tick in ticks]

    def _one(self, tick: Tick) -> tuple[int | None, str]:
        try:
            return self.store.append(tick), ""
        except Exception as error:  # noqa: BLE001 - a full disk is mended by people, and the campaign then goes on
            self._log(error)
            why = str(error) or type(error).__name__
            if tick.scan is not None or tick.events:
                before = self._refused
                first, count = (tick.planned, 0) if before is None else (before.first, before.count)
                self._refused = _Refused(first, tick.planned, count + 1, why)
            return None, why

    def _tell_refused(self, event: Event) -> None:
        try:
            self.store.append(Tick(event.time, events=(event,)))
            self._refused = None
        except Exception as error:  # noqa: BLE001 - the disk is full again
            self._log(error)

    def _log(self, error: Exception) -> None:
        _log.error("store", error=f"{type(error).__name__}: {error}", traceback=traceback.format_exc())
