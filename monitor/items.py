"""Items: what goes along the line of a run: slots that are visited, slots that are missed, and notes between them."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field
from typing import Any, Literal

import structlog

from pipelines import Instant, Tick, format_instant

from .alarms import Watches
from .clock import seconds_between
from .settled import NO_TIMINGS, Settled, Timings
from .slot_rules import Gap
from .visit import Capture, State, failed_tick

__all__ = ["Item", "Missed", "Note", "Visit"]

_log = structlog.get_logger("microrelief.loop")


@dataclass(slots=True, eq=False)
class Visit:
    """A slot that is answered, on its way.

    Parameters
    ----------
    planned, began : Instant
        The slot, and when its visit began.
    captured : Capture or None
        None where that failed, and once nobody needs it.
    tick : Tick
        What it has yielded so far.
    state, cause
        How it will end, if nothing else happens.
    unavailable : bool
        The device was not there.
    crowded : bool
        The disk had no room.
    taken_at : Instant or None
        When that was begun.
    """

    planned: Instant
    began: Instant
    captured: Capture | None
    tick: Tick
    state: State = "taken"
    cause: str = ""
    unavailable: bool = False
    crowded: bool = False
    taken_at: Instant | None = None
    timings: Timings = NO_TIMINGS
    measured: Any = None
    begins: bool = False
    watches: Watches = field(default_factory=dict)
    worked_out: Instant | None = None

    def fail(self, state: Literal["failed", "rejected"], cause: str) -> None:
        """Let it end without a scan."""
        self.tick, self.state, self.cause = failed_tick(self.planned, self.began, state, cause), state, cause

    def surprise(self, error: Exception) -> None:
        """Let it end by a bug, of a driver or our own: that costs a visit, and never a campaign of years."""
        _log.error("unexpected error", planned=format_instant(self.planned), traceback=traceback.format_exc())
        self.fail("failed", f"unexpected {type(error).__name__}: {error}")

    @property
    def latency_s(self) -> float:
        """From its slot until it was worked out; NaN before."""
        return float("nan") if self.worked_out is None else seconds_between(self.planned, self.worked_out)


@dataclass(slots=True, eq=False)
class Missed:
    """Slots that nobody answers, and the event that says so."""

    gap: Gap
    now: Instant
    settled: Settled
    tick: Tick
    watches: Watches = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Note:
    """Something to be noted in the store, in its place among the slots."""

    moment: Instant
    text: str


Item = Visit | Missed | Note
