"""A rig, a store and a ledger small enough to see through, for tests of what drives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from monitor.visit import Epoch, Recipe, State, Work, Yield
from pipelines import Calibration, Frames, Grid, Instant, Lens, PatternSet, Scan, Tick, parse_instant

GRID = Grid(4, 5, 0.1)
PATTERNS = PatternSet(kind="gray", size=(8, 8), bits=(3, 3))
T0 = parse_instant("2026-01-01T00:00:00Z")
LENS = Lens((5, 4), np.eye(3), np.zeros(5))
CALIBRATION = Calibration(LENS, LENS, np.eye(3), np.zeros(3), np.eye(3, 4), {})
RECIPE = Recipe(GRID, patterns=PATTERNS, calibration=CALIBRATION)


def after(seconds: float) -> Instant:
    return T0 + np.timedelta64(round(seconds * 1e9), "ns")


@dataclass
class FakeRig:
    """Gives dark frames; `script` may raise or let time pass at each capture, by its number."""

    script: Callable[[int], None] = lambda number: None
    captures: int = 0
    opened: int = 0
    closed: int = 0

    def open(self) -> None:
        self.opened += 1

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        number = self.captures
        self.captures += 1
        self.script(number)
        return Frames(np.zeros((len(patterns.roles), 4, 5), np.uint8), at, patterns)

    def close(self) -> None:
        self.closed += 1


@dataclass
class _Kept:
    planned: Instant
    scan: Scan
    change: None = None
    baseline: int = 0
    alarms: dict[str, Any] = field(default_factory=dict)


@dataclass
class FakeStore:
    """Keeps ticks in a list; `script` may raise at each append, by its number."""

    script: Callable[[int], None] = lambda number: None
    ticks: list[Tick] = field(default_factory=list)
    appends: int = 0
    groups: list[int] = field(default_factory=list)

    @property
    def scans(self) -> list[_Kept]:
        return [_Kept(tick.planned, tick.scan) for tick in self.ticks if tick.scan is not None]

    def append(self, tick: Tick) -> int | None:
        if tick.scan is not None:
            number = self.appends
            self.appends += 1
            self.script(number)
        self.ticks.append(tick)
        return len(self.scans) - 1 if tick.scan is not None else None

    def append_all(self, ticks: Sequence[Tick]) -> tuple[int | None, ...]:
        self.groups.append(len(ticks))
        before = list(self.ticks)
        try:
            return tuple(self.append(tick) for tick in ticks)
        except Exception:
            self.ticks = before
            raise

    def __len__(self) -> int:
        return len(self.scans)

    def __getitem__(self, number: int) -> _Kept:
        return self.scans[number]

    @property
    def events(self) -> list[str]:
        return [f"{event.kind}: {event.text}" for tick in self.ticks for event in tick.events if event.kind != "note"]


@dataclass
class FakeLedger:
    """Refuses what a ledger must never be told: a slot twice, or an end without a beginning."""

    slots: dict[Instant, tuple[str, str]] = field(default_factory=dict)

    def plan(self, planned: Instant) -> None:
        assert planned not in self.slots, f"{planned} planned twice"
        self.slots[planned] = ("planned", "")

    def settle(self, planned: Instant, state: State, cause: str = "", scan: int | None = None) -> None:
        assert state == "missed" or planned in self.slots, f"{planned} settled without a plan"
        assert self.slots.get(planned, ("planned",))[0] == "planned", f"{planned} settled twice"
        self.slots[planned] = (state, cause)

    def settle_all(self, planned: Sequence[Instant], state: State, cause: str = "") -> None:
        for slot in planned:
            self.settle(slot, state, cause)

    def states(self) -> list[str]:
        return [self.slots[planned][0] for planned in sorted(self.slots)]


def flat_scan(frames: Frames) -> Scan:
    flat = np.zeros(GRID.shape, np.float32)
    return Scan(GRID, frames.time, flat, flat, flat.astype(np.uint8), flat.astype(np.uint8))


def whole(work: Callable[[Frames, Recipe, Epoch | None, Instant], Yield]) -> Work[Frames]:
    """Work whose first step hands the frames on, and whose second does all."""
    return Work(lambda frames, recipe: frames, work)


@whole
def work(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """Stands in for the reconstruction: a flat scan of every capture."""
    return Yield(Tick(planned, flat_scan(frames)), "taken")
