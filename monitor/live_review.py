"""Follows a store that another process writes: each new scan is read once it is committed, and shown."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dashboards import LiveReview, Preset, known_events
from pipelines import Event, Measurement, Tick
from storage import Store, open_store, scan_table

__all__ = ["Follower", "follow_store", "ticks_since"]

LOOK_AT_LEAST_S, LOOK_AT_MOST_S = 1.0, 30.0
LEAVE_S = 4.0
"""How long the end of a review waits for what is being sent."""


class Follower:
    """Shows a store in a viewer, on a thread of its own, for as long as the viewer is there.

    Parameters
    ----------
    opened : Store
        As it is now.
    path : str or Path
        Where it is, to be opened anew.
    preset : str
    """

    def __init__(self, opened: Store, path: str | Path, preset: Preset) -> None:
        self._opened, self._path, self._preset = opened, path, preset
        self._ended = threading.Event()
        self._failures: list[Exception] = []

    @contextmanager
    def at(self, address: str) -> Iterator[None]:
        """Follow while the context lasts; it ends when nothing more is sent, so that the viewer may go after it.

        Raises what failed before the end: what a viewer whose window was closed no longer takes is none of it.
        """
        thread = threading.Thread(target=self._follow, args=(address,), name="follow", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join(LEAVE_S)
        if self._failures:
            raise self._failures[0]

    def _follow(self, address: str) -> None:
        try:
            follow_store(self._opened, self._path, address, self._preset, self._ended)
        except Exception as error:  # noqa: BLE001 - told by the thread that waits for the viewer
            if not self._ended.is_set():
                self._failures.append(error)


def follow_store(opened: Store, path: str | Path, address: str, preset: Preset, ended: threading.Event) -> None:
    """Show what a store holds, the last hour first, then each scan as it comes, until `ended` is set.

    Parameters
    ----------
    opened : Store
        As it is now.
    path : str or Path
        Where it is, to be opened anew.
    address : str
        Where a viewer listens.
    preset : str
    ended : Event
    """
    times = scan_table(opened).times[-20:]
    interval_s = float(np.median(np.diff(times)) / np.timedelta64(1, "s")) if len(times) > 1 else 60.0
    live = LiveReview(address, opened.about, preset=preset, interval_s=interval_s)
    try:
        shown, snapshot = live.attach(opened), opened.about.snapshot
        told = set(known_events(opened))  # with remarks that wait: they are not told again once they are taken in
        while not ended.wait(min(max(0.5 * interval_s, LOOK_AT_LEAST_S), LOOK_AT_MOST_S)):
            now = open_store(path)
            try:
                events = set(known_events(now))
                if now.about.snapshot != snapshot or events - told:
                    for tick, number in ticks_since(now, shown, told):
                        live.show(tick, number)
                        live.wait_until_shown()
                    shown, snapshot = len(now), now.about.snapshot
                    told |= events
            finally:
                now.close()
    finally:
        live.close()


def ticks_since(store: Store, scans: int, known: Iterable[Event]) -> Iterator[tuple[Tick, int]]:
    """Give the visits that came after a store held so many scans and some events, each with its scan's number."""
    table = scan_table(store)
    before = set(known)
    fresh = [event for event in known_events(store) if event not in before]  # an annotation may be of long ago
    for number in range(scans, len(store)):
        stored = store[number]
        measured = {
            name: Measurement(float(values[number]), float(sigmas[number]))
            for name, (values, sigmas) in table.metrics.items()
            if np.isfinite(values[number])
        }
        told = tuple(event for event in fresh if event.time <= stored.scan.time)
        fresh = fresh[len(told) :]
        yield Tick(stored.planned, stored.scan, stored.change, measured, stored.alarms, told), number
    for event in fresh:
        yield Tick(event.time, events=(event,)), max(len(store) - 1, 0)
