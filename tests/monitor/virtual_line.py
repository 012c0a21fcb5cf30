"""A line whose stages take time on an accelerated clock: a pipeline that falls behind, without a thread or a wait."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Event

import numpy as np

from monitor.clock import AcceleratedClock
from monitor.items import Item, Visit
from monitor.line import Line, Stage
from monitor.loop import counts
from pipelines import Instant

__all__ = ["VirtualClock", "VirtualLine"]

Takes = Callable[[int, int], float]
"""Seconds that a stage (by number) takes for its n-th visit."""


class VirtualClock(AcceleratedClock):
    """Jumps from one thing that happens to the next."""

    line: VirtualLine | None = None

    def wait_until(self, moment: Instant, stop: Event) -> None:
        if self.line is not None:
            self.line.go_on_until(moment)
        super().wait_until(moment, stop)

    def jump(self, moment: Instant) -> None:
        super().wait_until(moment, Event())

    def advance(self, seconds: float) -> None:
        """Let time pass, in which the stages go on."""
        moment = self.now() + np.timedelta64(round(seconds * 1e9), "ns")
        if self.line is not None:
            self.line.go_on_until(moment)
        self.jump(moment)


class VirtualLine(Line[Item]):
    """Each stage begins an item as soon as it can, and has worked on it when its time is over."""

    def __init__(self, stages: Sequence[Stage[Item]], limit: int, clock: VirtualClock, takes: Takes) -> None:
        super().__init__(stages, limit, counts)
        self._clock, self._takes = clock, takes
        self._ends: list[Instant | None] = [None] * len(self._stages)
        self._visits = [0] * len(self._stages)
        self.most = 0
        clock.line = self

    def put(self, item: Item) -> None:
        super().put(item)
        self.most = max(self.most, self.under_way)
        self._begin()

    def wait_for_room(self, stop: Event) -> None:
        while self.full and not stop.is_set() and self._next():
            pass

    def finish(self) -> None:
        while self._next():
            pass
        self._clock.line = None

    def go_on_until(self, moment: Instant) -> None:
        while self._next(moment):
            pass

    def _begin(self) -> None:
        for number in range(len(self._stages)):
            if self._ends[number] is None and self._can(number):
                takes_s = 0.0
                if isinstance(self._waiting[number][0], Visit):
                    takes_s = self._takes(number, self._visits[number])
                    self._visits[number] += 1
                self._ends[number] = self._clock.now() + np.timedelta64(round(takes_s * 1e9), "ns")

    def _next(self, until: Instant | None = None) -> bool:
        """Let the next thing happen, if it does before `until`; of several at once the last stage's comes first."""
        self._begin()
        coming = [(end, -number) for number, end in enumerate(self._ends) if end is not None]
        if not coming or (until is not None and min(coming)[0] > until):
            return False
        end, number = min(coming)
        self._clock.jump(end)
        self._ends[-number] = None
        return self.step(-number)
