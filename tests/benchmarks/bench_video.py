"""Video: how late the slots of 10 Hz begin, idle and loaded, and the highest rate that is sustained at two sizes.

``python -m tests.benchmarks.bench_video``; the figures hold on a machine that does nothing else.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Event

import numpy as np

from monitor.clock import AcceleratedClock, RealClock, seconds_between
from monitor.scheduler import VideoSlots
from tests.benchmarks import bench_reconstruct
from tests.monitor.video_from_memory import MemoryRig, record, video_campaign
from tests.pipelines.reconstruction.exact_rig import make_rig

CORES = 2
SLOTS = 200
SCANS = 12
SIZES = ((2560, 1440), (1280, 720))


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


def sustained(columns: int, rows: int) -> tuple[float, float]:
    """Give scans a second, one after another without a pause, by wall clock, and CPU seconds a scan."""
    bench_reconstruct.COLUMNS, bench_reconstruct.ROWS = columns, rows
    rig = make_rig((columns, rows))
    captures = [bench_reconstruct.capture(rig, seed) for seed in (1, 2)]
    moments: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        campaign = video_campaign(Path(folder), rig, captures[0].patterns, 10.0, "1 h", 0.0)
        clock = AcceleratedClock(np.datetime64("2026-01-01T00:00:00", "ns"))
        done = record(
            campaign,
            MemoryRig(captures),
            clock,
            lambda settled: moments.append((time.perf_counter(), time.process_time())),
            2 * SCANS,
        )
        assert done.taken == 2 * SCANS
    # each scan is durable before the next begins; the first half warms up
    (wall, cpu), (wall_end, cpu_end) = moments[SCANS // 2], moments[-1]
    count = len(moments) - 1 - SCANS // 2
    return count / (wall_end - wall), (cpu_end - cpu) / count


def main() -> None:
    """Print them."""
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
        print(f"  10 Hz, {name}: late by p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {late.max():.2f} ms")
    for columns, rows in SIZES:
        rate, cpu = sustained(columns, rows)
        print(f"  {columns}x{rows}, 42 frames to a durable scan: {rate:.2f} Hz sustained, {cpu:.2f} CPU s a scan")


if __name__ == "__main__":
    main()
