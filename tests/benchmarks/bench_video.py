"""Video: how late the slots of 10 Hz begin, what each stage costs, and the highest rate that is sustained at two sizes.

``python -m tests.benchmarks.bench_video``; wall-clock figures hold on a machine that does nothing else. ``--only 1280``
measures one width. The search for a rate ends after `SCANS` scans flat out and `HELD_S` seconds at the rate found; all
of it takes three and a half minutes.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from configs import Campaign
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock, Clock, RealClock, seconds_between
from monitor.items import Item
from monitor.line import InlineLine, Line, Stage
from monitor.loop import LayLine
from monitor.scheduler import VideoSlots
from monitor.settled import Outcome
from monitor.visit import Epoch, Measured, Recipe, Work, Yield, visit
from pipelines import Calibration, Change, Frames, Instant, Motion, Tick
from pipelines.reconstruction import footprint_grid
from tests.benchmarks import bench_reconstruct
from tests.monitor.video_from_memory import MemoryRig, video_campaign
from tests.pipelines.reconstruction.exact_rig import make_rig

CORES = 2
SLOTS = 150
SCANS = 8
HELD_S = 12.0
HELD = 0.9
"""Part of the rate flat out that is then held by the clock."""

T0 = np.datetime64("2026-01-01T00:00:00", "ns")
SIZES = ((2560, 1440, 3.0), (1280, 720, 10.0))
"""Columns, rows, and the rate that is aimed at, Hz."""


def lateness() -> np.ndarray:
    """How late a wait for each slot of 10 Hz ends, ms."""
    clock = RealClock().steady()
    slots = VideoSlots(clock.now(), 10.0)
    slot, late = clock.now(), []
    for _ in range(SLOTS):
        following = slots.after(slot)
        assert following is not None
        slot = following
        clock.wait_until(slot, Event())
        late.append(1000 * seconds_between(slot, clock.now()))
    return np.array(late)


def uncompared(capture: Measured, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """Say that nothing has changed, without a look: what a video costs beside its comparison."""
    tick = Tick(planned, capture.scan, calibration=recipe.calibration)
    if epoch is not None:
        nothing = np.zeros(capture.scan.grid.shape, np.float32)
        tick = replace(tick, change=Change(capture.scan.grid, epoch.baseline.time, nothing, nothing, Motion.none()))
    return Yield(tick, "taken")


RECIPES: dict[str, tuple[Work[Any], int]] = {
    "volumes": (visit, 1),
    "volumes, cells twice as wide": (visit, 2),
    "nothing compared": (Work(visit.reconstruct, uncompared), 1),
}
"""What is done with each scan, and how many of the usual cells' widths a cell is wide."""


@dataclass
class Costs:
    """CPU seconds of each stage, all threads that it uses included; one stage at a time."""

    names: Sequence[str] = ()
    seconds: tuple[list[float], ...] = ()

    def lay(self, stages: Sequence[Stage[Item]], stop: Event) -> Line[Item]:
        self.names = [stage.name for stage in stages]
        self.seconds = tuple([] for _ in stages)

        def timed(stage: Stage[Item], took: list[float]) -> Stage[Item]:
            def work(item: Item) -> None:
                began = time.process_time()
                stage.work(item)
                took.append(time.process_time() - began)

            return Stage(stage.name, work, stage.ready)

        return InlineLine([timed(*each) for each in zip(stages, self.seconds, strict=True)])

    @property
    def line(self) -> str:
        """Median of each stage, the first scans aside, which warm up."""
        return ", ".join(
            f"{name} {np.median(took[-SCANS // 2 :]):.2f}" for name, took in zip(self.names, self.seconds, strict=True)
        )


@dataclass(frozen=True)
class Subject:
    """A rig, and captures of it that are taken in turn."""

    rig: Calibration
    captures: list[Frames]

    @staticmethod
    def of(columns: int, rows: int) -> Subject:
        bench_reconstruct.COLUMNS, bench_reconstruct.ROWS = columns, rows
        rig = make_rig((columns, rows))
        return Subject(rig, [bench_reconstruct.capture(rig, seed) for seed in (1, 2)])


def recorded(
    subject: Subject,
    rate_hz: float,
    length: str,
    clock: Clock,
    work: Work[Any],
    wide: int = 1,
    lay: LayLine | None = None,
    scans: int | None = None,
    told: Callable[[], None] = lambda: None,
) -> Outcome:
    """Record into a store that is thrown away, each scan committed at once."""
    pitch_mm = wide * footprint_grid(subject.rig).pitch_mm
    with tempfile.TemporaryDirectory() as folder:
        campaign: Campaign = video_campaign(
            Path(folder), subject.rig, subject.captures[0].patterns, rate_hz, length, pitch_mm
        )
        return run_campaign(
            campaign,
            clock=clock,
            rig=MemoryRig(subject.captures),
            on_settled=lambda settled: told(),
            max_scans=scans,
            work=work,
            lay=lay,
        )


def sustained(subject: Subject, work: Work[Any], wide: int, aim_hz: float) -> None:
    """Print what each stage costs, the rate flat out, and whether most of that rate is held by the real clock."""
    costs = Costs()
    recorded(subject, 10.0, "1 h", AcceleratedClock(T0), work, wide, costs.lay, SCANS)
    print(f"    CPU s a scan: {costs.line}", flush=True)
    ends: list[float] = []
    clock = AcceleratedClock(T0)
    done = recorded(subject, 10.0, "1 h", clock, work, wide, scans=SCANS, told=lambda: ends.append(time.perf_counter()))
    assert done.taken == SCANS
    half = len(ends) // 2
    flat_out = (len(ends) - 1 - half) / (ends[-1] - ends[half])
    rate = math.floor(100 * HELD * flat_out) / 100
    held = recorded(subject, rate, f"{max(HELD_S, 5 / rate):.0f} s", RealClock(), work, wide)
    lags, latencies = np.array(held.lags_s), np.array(held.latencies_s[2:])  # the baseline's neighbours wait for it
    print(
        f"    flat out {flat_out:.2f} Hz (aim {aim_hz:g}); at {rate:.2f} Hz {held.taken} taken, {held.missed} dropped, "
        f"late by p99 {1000 * np.percentile(lags, 99):.1f} ms, worked out after p50 {np.median(latencies):.2f} s",
        flush=True,
    )


def main() -> None:
    """Print them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", type=int, help="columns of the one size to measure")
    only = parser.parse_args().only
    print("Video")
    for name, load in (("idle", 0), ("both cores loaded", CORES)):
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(load)]
        try:
            late = lateness()
        finally:
            for each in busy:
                each.kill()
                each.wait()
        p50, p99 = np.percentile(late, (50, 99))
        print(f"  10 Hz, {name}: late by p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {late.max():.2f} ms", flush=True)
    for columns, rows, aim_hz in SIZES:
        if only not in (None, columns):
            continue
        subject = Subject.of(columns, rows)
        for name, (work, wide) in RECIPES.items():
            print(f"  {columns}x{rows}, 42 frames to a durable scan, {name}", flush=True)
            sustained(subject, work, wide, aim_hz)


if __name__ == "__main__":
    main()
