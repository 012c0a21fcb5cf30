"""Newest: hands scans to somebody who may be slower than they come, and then gets the newest; nobody waits for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Condition, Thread
from typing import Generic, TypeVar

import structlog

__all__ = ["Newest", "showing"]

Thing = TypeVar("Thing")

LEAVE_S = 5.0
"""How long the end of a run waits for a show that is under way."""

_log = structlog.get_logger("microrelief.preview")


class Newest(Generic[Thing]):
    """Calls `show` with the newest thing that was offered, one at a time, on a thread of its own.

    Parameters
    ----------
    show : callable
        Gives False when nobody looks any more. What it raises is logged, and ends the show, not the run.
    """

    def __init__(self, show: Callable[[Thing], bool]) -> None:
        self._show = show
        self._thing: Thing | None = None
        self._changed = Condition()
        self._over = False
        self._thread = Thread(target=self._go_on, name="preview", daemon=True)
        self._thread.start()

    def offer(self, thing: Thing) -> None:
        """Offer a thing in the place of one that was not shown yet. Never waits."""
        with self._changed:
            self._thing = thing
            self._changed.notify()

    def close(self) -> None:
        """End it; what was offered last is shown before."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join(LEAVE_S)

    def _go_on(self) -> None:
        looked_at = True
        while looked_at:
            with self._changed:
                self._changed.wait_for(lambda: self._thing is not None or self._over)
                thing, self._thing = self._thing, None
            if thing is None:
                return
            try:
                looked_at = self._show(thing)
            except Exception as error:  # noqa: BLE001 - a picture on a screen must not cost a scan
                _log.error("preview ended", error=f"{type(error).__name__}: {error}")
                return


@contextmanager
def showing(show: Callable[[Thing], bool]) -> Iterator[Newest[Thing]]:
    """Show things while a run goes on."""
    newest = Newest(show)
    try:
        yield newest
    finally:
        newest.close()
