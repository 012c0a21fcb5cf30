"""Which scan number, epoch and baseline a tick gets, and which ticks a store refuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from configs import StoreError
from pipelines import Event, Grid, Instant, Tick, format_instant

__all__ = ["Place", "Tail", "described", "place", "place_all"]


@dataclass(frozen=True, slots=True)
class Tail:
    """What the next scan must follow: how many there are, and the newest one's time, epoch and calibration."""

    count: int = 0
    time: Instant | None = None
    epoch: int = -1
    baseline: int = -1
    baseline_time: Instant | None = None
    calibration_id: str = ""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a tick goes: the store's tail once it is in, its number, and the events that go with it."""

    tail: Tail
    number: int | None
    events: tuple[Event, ...]


def place(tail: Tail, tick: Tick, grid: Grid, metrics: dict[str, str]) -> Place:
    """Place a tick after what is stored.

    The first scan, a scan of another calibration than the one before, and one whose tick holds an ``epoch`` event
    (a chosen new baseline) start an epoch: they are its baseline and have no change.

    Raises
    ------
    StoreError
        If the scan lies on another grid, is not newer than the newest, brings a metric that the store does not have,
        or a change against anything but its epoch's baseline.
    """
    scan = tick.scan
    if scan is None:
        return Place(tail, None, tick.events)
    when = format_instant(scan.time)
    if scan.grid != grid:
        raise StoreError(
            f"scan of {when} lies on another grid ({_grid(scan.grid)}) than this store ({_grid(grid)}): "
            "keep it in a store of its own"
        )
    if tail.time is not None and scan.time <= tail.time:
        raise StoreError(
            f"scan of {when} is not newer than the newest one stored, {format_instant(tail.time)}: "
            "check the clock, or whether it was stored before"
        )
    unknown = [name for name in tick.metrics if name not in metrics]
    if unknown:
        known = ", ".join(metrics) or "none"
        raise StoreError(f"metric {unknown[0]!r} is not one of this store's ({known}): open it with its unit to add it")
    chosen = any(event.kind == "epoch" for event in tick.events)
    starts = tail.count == 0 or scan.calibration_id != tail.calibration_id or chosen
    if tick.change is not None:
        if starts:
            raise StoreError(f"scan of {when} starts an epoch, it is the baseline: it can have no change")
        if tick.change.baseline_time != tail.baseline_time:
            raise StoreError(
                f"change of {when} is against {format_instant(tick.change.baseline_time)}, but the baseline of epoch "
                f"{tail.epoch} is scan {tail.baseline}: compare with that, or start an epoch"
            )
    number = tail.count
    events = tick.events
    if starts and not chosen:
        events = (*events, Event(scan.time, "epoch", _reason(tail, number, scan.calibration_id)))
    after = Tail(
        count=number + 1,
        time=scan.time.astype("datetime64[ns]"),
        epoch=tail.epoch + 1 if starts else tail.epoch,
        baseline=number if starts else tail.baseline,
        baseline_time=scan.time if starts else tail.baseline_time,
        calibration_id=scan.calibration_id,
    )
    return Place(after, number, events)


def place_all(tail: Tail, ticks: Sequence[Tick], grid: Grid, metrics: dict[str, str]) -> tuple[Place, ...]:
    """Place several ticks, each after the one before; raises as `place`."""
    places = []
    for tick in ticks:
        places.append(place(tail, tick, grid, metrics))
        tail = places[-1].tail
    return tuple(places)


def _reason(tail: Tail, number: int, calibration_id: str) -> str:
    name = calibration_id or "none"
    if tail.count == 0:
        return f"epoch 0 begins: scan 0 is the baseline, calibration {name}"
    return (
        f"epoch {tail.epoch + 1} begins: scan {number} is the new baseline, "
        f"calibration {tail.calibration_id or 'none'} -> {name}"
    )


def _grid(grid: Grid) -> str:
    corner = f"{np.float32(grid.x0_mm)}, {np.float32(grid.y0_mm)}"
    return f"{grid.rows} x {grid.columns} cells of {grid.pitch_mm:g} mm from ({corner})"


def described(ticks: Sequence[Tick], places: Sequence[Place]) -> tuple[str, dict[str, Any]]:
    """Give a commit's message and metadata: its newest slot, and its newest scan."""
    planned = format_instant(ticks[-1].planned)
    numbers = [where.number for where in places if where.number is not None]
    if not numbers:
        return f"tick {planned}: no scan", {"planned": planned}
    scans = f"scan {numbers[0]}" if len(numbers) == 1 else f"scans {numbers[0]} to {numbers[-1]}"
    told = f"{scans} of {planned}" if len(numbers) == 1 else f"{scans}, until {planned}"
    return told, {"planned": planned, "scan": str(numbers[-1])}
