"""Line: stages joined by queues. Each item passes all of them in order, and only so many may be under way."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Generic, Self, TypeVar

__all__ = ["InlineLine", "Line", "Stage", "ThreadedLine"]

Item = TypeVar("Item")

LOOK_S = 0.1
"""Whoever waits for room looks this often whether it was asked to stop."""

SWITCH_S = 0.0005
"""While stages have threads, one that wakes up waits no longer than this for another that is in Python code; Python's
own 5 ms are more than a slot may be late."""

JOIN_S = 30.0
"""How long a line that is broken off waits for what its stages have in hand."""


@dataclass(frozen=True, slots=True)
class Stage(Generic[Item]):
    """One step of the work.

    Parameters
    ----------
    name : str
    work : callable
        Called with each item, one at a time and in their order. What it raises ends the line.
    ready : callable
        Whether it may begin the next item now; asked again after each step of any stage.
    """

    name: str
    work: Callable[[Item], None]
    ready: Callable[[], bool] = lambda: True


class Line(Generic[Item]):
    """Moves items through stages, a step whenever `step` is called: nothing happens by itself.

    Parameters
    ----------
    stages : sequence of Stage
    limit : int
        How many items may be under way, before the first stage until after the last. Whoever puts them asks `full`.
    counts : callable
        Whether an item is one of those; others (a note) weigh nothing.
    """

    def __init__(
        self, stages: Sequence[Stage[Item]], limit: int = 1, counts: Callable[[Item], bool] = lambda item: True
    ) -> None:
        self._stages = tuple(stages)
        self.limit = limit
        self._counts = counts
        self._waiting: tuple[deque[Item], ...] = tuple(deque() for _ in stages)
        self._busy = [False] * len(self._stages)
        self._under_way = 0
        self._changed = Condition()

    @property
    def under_way(self) -> int:
        """How many items there are that count."""
        return self._under_way

    @property
    def full(self) -> bool:
        """Whether the next item that counts has to wait."""
        return self._under_way >= self.limit

    def put(self, item: Item) -> None:
        """Let an item begin its way. Never waits."""
        with self._changed:
            self._under_way += self._counts(item)
            self._waiting[0].append(item)
            self._changed.notify_all()

    def step(self, number: int) -> bool:
        """Let a stage work on its next item; whether there was one."""
        with self._changed:
            if not self._can(number):
                return False
            item, self._busy[number] = self._waiting[number].popleft(), True
        self._stages[number].work(item)
        with self._changed:
            self._busy[number] = False
            if number + 1 < len(self._stages):
                self._waiting[number + 1].append(item)
            else:
                self._under_way -= self._counts(item)
            self._changed.notify_all()
        return True

    def wait_for_room(self, stop: Event) -> None:
        """Return once the line is not full, or `stop` is set."""
        while self.full and not stop.is_set() and self._any_step():
            pass

    def finish(self) -> None:
        """Bring all that is under way to its end."""
        while self._any_step():
            pass

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.finish()

    def _any_step(self) -> bool:
        return any(self.step(number) for number in range(len(self._stages)))

    def _can(self, number: int) -> bool:
        return bool(self._waiting[number]) and not self._busy[number] and self._stages[number].ready()


class InlineLine(Line[Item]):
    """Brings each item to its end before `put` returns: what comes next waits for what was before."""

    def put(self, item: Item) -> None:
        """Do all the work on an item."""
        super().put(item)
        self.finish()


class ThreadedLine(Line[Item]):
    """Each stage has a thread of its own, while the line is entered.

    What a stage raises ends all of them, each after the item that it has in hand, and is raised once to whoever uses
    the line: at the next `put` or wait, or when the line is left. Where the line is left by an exception, what is under
    way is not brought to its end.

    Parameters
    ----------
    stages, limit, counts
        As `Line`.
    broke : callable
        Called when a stage has raised, so that nobody waits in vain.
    """

    def __init__(
        self,
        stages: Sequence[Stage[Item]],
        limit: int = 1,
        counts: Callable[[Item], bool] = lambda item: True,
        broke: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(stages, limit, counts)
        self._broke = broke
        self._ending = self._broken_off = False
        self._error: BaseException | None = None
        self._switched = SWITCH_S
        self._threads = [
            Thread(target=self._run, args=(number,), name=f"microrelief-{stage.name}", daemon=True)
            for number, stage in enumerate(self._stages)
        ]

    def put(self, item: Item) -> None:
        """Let an item begin its way; raise what a stage has raised."""
        self._raise()
        super().put(item)

    def wait_for_room(self, stop: Event) -> None:
        """Return once the line is not full, or `stop` is set; raise what a stage has raised."""
        with self._changed:
            while self.full and not stop.is_set() and self._error is None:
                self._changed.wait(LOOK_S)
        self._raise()

    def finish(self) -> None:
        """Wait until all that is under way has come to its end, and end the threads; raise what a stage has raised."""
        with self._changed:
            self._ending = True
            self._changed.notify_all()
        for thread in self._threads:
            while thread.is_alive():
                thread.join(LOOK_S)  # a second Ctrl-C gets through
        self._raise()

    def __enter__(self) -> Self:
        self._switched = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            super().__exit__(kind, error, trace)
        finally:
            self._break_off()
            sys.setswitchinterval(self._switched)

    def _break_off(self) -> None:
        with self._changed:
            self._broken_off = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(JOIN_S)

    def _run(self, number: int) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._can(number) or self._over(number))
                if self._over(number):
                    return
            try:
                self.step(number)
            except BaseException as error:  # noqa: BLE001 - it is raised where the line is used
                self._fail(error)
                return

    def _over(self, number: int) -> bool:
        if self._broken_off or self._error is not None:
            return True
        return self._ending and not any(self._waiting[: number + 1]) and not any(self._busy[:number])

    def _fail(self, error: BaseException) -> None:
        with self._changed:
            if self._error is None:
                self._error = error
            self._changed.notify_all()
        self._broke()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error
