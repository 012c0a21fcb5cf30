"""Settled: how one slot ended, or several in a row; and what a run came to."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import get_args

from pipelines import Instant, Tick, format_instant

from .clock import seconds_between
from .slot_rules import NOT_RUNNING
from .visit import State

__all__ = ["NO_TIMINGS", "Outcome", "Settled", "Tally", "Timings"]

NAN = float("nan")

KEPT = 100_000
"""Of so many of the newest visits it is kept how late they were: a video may go on for weeks."""


@dataclass(frozen=True, slots=True)
class Timings:
    """How long each step of a visit took, s; NaN for those that were not reached."""

    capture_s: float = NAN
    reconstruct_s: float = NAN
    compare_s: float = NAN

    @property
    def work_s(self) -> float:
        """Of the work, as far as it went."""
        return self.reconstruct_s + (0.0 if math.isnan(self.compare_s) else self.compare_s)


NO_TIMINGS = Timings()


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
    began : Instant or None
        When the visit began; None for a missed slot.
    latency_s : float
        From the slot until the scan was worked out; NaN where none was.
    took_s : float
        From the visit's beginning until the scan was durable, by the campaign's clock; NaN for a missed slot.
    timings : Timings
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
    began: Instant | None = None
    latency_s: float = NAN
    took_s: float = NAN
    timings: Timings = NO_TIMINGS
    count: int = 1
    first: Instant | None = None
    more: bool = False

    @property
    def lag_s(self) -> float:
        """How long after the slot the visit began; NaN for a missed slot."""
        return NAN if self.began is None else seconds_between(self.planned, self.began)

    @property
    def dropped(self) -> int:
        """How many slots were missed although the campaign ran."""
        return self.count if self.state == "missed" and self.cause != NOT_RUNNING else 0

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
    lags_s, latencies_s : tuple of float
        How late each visit began, and how old each scan was when it had been worked out; of the newest 100,000.
    stopped : bool
        It was asked to stop before the schedule was over.
    """

    taken: int = 0
    missed: int = 0
    rejected: int = 0
    failed: int = 0
    away: int = 0
    lags_s: tuple[float, ...] = ()
    latencies_s: tuple[float, ...] = ()
    stopped: bool = False

    @property
    def visits(self) -> int:
        """Slots that were answered, well or badly."""
        return self.taken + self.rejected + self.failed

    @property
    def degraded(self) -> bool:
        """Whether any slot did not end well while this ran."""
        return self.missed > self.away or bool(self.rejected or self.failed)


@dataclass(slots=True)
class Tally:
    """Counts what was settled."""

    counts: dict[State, int] = field(default_factory=lambda: dict.fromkeys(get_args(State), 0))
    away: int = 0
    lags_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))

    def add(self, settled: Settled) -> None:
        """Count a slot, or several."""
        self.counts[settled.state] += settled.count
        if settled.state == "missed":
            self.away += settled.count - settled.dropped
        else:
            self.lags_s.append(settled.lag_s)
            if settled.tick is not None and settled.tick.scan is not None:
                self.latencies_s.append(settled.latency_s)

    def outcome(self, *, stopped: bool) -> Outcome:
        """Give what it came to."""
        lags, latencies = tuple(self.lags_s), tuple(self.latencies_s)
        return Outcome(**self.counts, away=self.away, lags_s=lags, latencies_s=latencies, stopped=stopped)
