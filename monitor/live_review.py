"""Follows a store that another process writes: each new scan is read once it is committed, and shown."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from dashboards import LiveReview, Preset
from pipelines import Event, Measurement, Tick
from storage import Store, open_store, scan_table

__all__ = ["follow_store", "ticks_since"]

LOOK_AT_LEAST_S, LOOK_AT_MOST_S = 1.0, 30.0


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
        shown, known = live.attach(opened), opened.events
        snapshot = opened.about.snapshot
        while not ended.wait(min(max(0.5 * interval_s, LOOK_AT_LEAST_S), LOOK_AT_MOST_S)):
            now = open_store(path)
            try:
                if now.about.snapshot != snapshot:
                    for tick, number in ticks_since(now, shown, known):
                        live.show(tick, number)
                        live.wait_until_shown()
                    shown, known, snapshot = len(now), now.events, now.about.snapshot
            finally:
                now.close()
    finally:
        live.close()


def ticks_since(store: Store, scans: int, known: Iterable[Event]) -> Iterator[tuple[Tick, int]]:
    """Give the visits that came after a store held so many scans and some events, each with its scan's number."""
    table = scan_table(store)
    before = set(known)
    fresh = [event for event in store.events if event not in before]  # an annotation may be of long ago
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
