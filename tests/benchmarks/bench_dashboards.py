"""A review of 540 scans of 1000x1000: drawing, opening again, a new day, memory; live; and a report of 14 scans.

``python -m tests.benchmarks.bench_dashboards [SCANS]``; takes some minutes and 2 GB of disk for all 540.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

import numpy as np
import pandas as pd
import psutil

from dashboards import LiveReview, record_review, serve_shards, update_shards, write_report
from dashboards.viewer import LOCAL, MEMORY, end, free_port, start, viewer_program, wait_until_listening
from monitor.live_review import ticks_since
from storage import Stored
from tests.dashboards.drying import SIX_HOURS, START, DryingStore, drying_store

SCANS, SIZE, DRAWN = 540, 1000, 6
SCAN_LIMIT_S, SCAN_LIMIT_MB, OPEN_LIMIT_S, DAY_LIMIT_S, MEMORY_LIMIT_GB = 0.35, 3.0, 5.0, 3.0, 1.5
LIVE_LIMIT_S, REPORT_LIMIT_S = 0.1, 10.0


class Cycle(Sequence[Stored]):
    """Many scans made of a few: the baseline, then the others again and again."""

    def __init__(self, few: Sequence[Stored], count: int) -> None:
        self._few, self._count = few, count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, number: int) -> Stored: ...
    @overload
    def __getitem__(self, number: slice) -> Sequence[Stored]: ...
    def __getitem__(self, number: int | slice) -> Stored | Sequence[Stored]:
        if isinstance(number, slice):
            return [self[each] for each in range(self._count)[number]]
        number = range(self._count)[number]
        given = self._few[0 if number == 0 else 1 + (number - 1) % (len(self._few) - 1)]
        when = START + number * SIX_HOURS
        return replace(given, number=number, planned=when, scan=replace(given.scan, time=when))

    def __iter__(self) -> Iterator[Stored]:
        return (self[number] for number in range(self._count))


def year(few: DryingStore, count: int) -> DryingStore:
    """A store of many scans made of a few."""
    scans = Cycle(few.scans, count)
    rows = [0, *(1 + number % (len(few.scans) - 1) for number in range(count - 1))]
    table = few.table.iloc[rows].copy()
    table["scan"] = np.arange(count, dtype=float)
    table.index = pd.DatetimeIndex([START + n * SIX_HOURS for n in range(count)], name="time", tz="UTC")
    about = replace(few.about, snapshot="SNAP0000")
    return DryingStore(about, scans, few.events, table)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1].isdigit() else SCANS
    few = drying_store(DRAWN, SIZE)
    print(f"dashboards, {count} scans of {SIZE}x{SIZE} (CPU seconds, unless they are called wall)")
    with tempfile.TemporaryDirectory() as folder:
        record_review(drying_store(3, 40), Path(folder) / "imports.rrd")
        _timeline(few, count, Path(folder) / "year.review")
        _live(few, Path(folder))
        small = drying_store(14, 500)
        began = time.process_time()
        write_report(small, Path(folder) / "report")
        _line(f"report of 14 scans (at most {REPORT_LIMIT_S:g} s)", f"{time.process_time() - began:.2f} s")


def _timeline(few: DryingStore, count: int, folder: Path) -> None:
    whole = year(few, count)
    before = year(few, count - 4)
    began = time.process_time()
    update_shards(before, folder)
    each = (time.process_time() - began) / (count - 4)
    size = sum(file.stat().st_size for file in folder.glob("????-??-??.rrd")) / (count - 4) / 1e6
    _line(f"drawing a scan, cracks and plates in it (at most {SCAN_LIMIT_S:g} s)", f"{each:.3f} s")
    _line(f"size of a scan (at most {SCAN_LIMIT_MB:g} MB)", f"{size:.2f} MB")
    began = time.process_time()
    for stored in few.scans:
        zlib.compress(stored.scan.height.tobytes(), 4)
    _line("zlib of its heights alone", f"{(time.process_time() - began) / len(few.scans):.3f} s")
    began = time.process_time()
    made = update_shards(whole, folder).made
    _line(f"a new day of {made} scans (at most {DAY_LIMIT_S:g} s)", f"{time.process_time() - began:.2f} s")
    from tests.dashboards.take_screenshot import looker, missing_libraries

    if missing_libraries():
        print(f"  {missing_libraries()}")
        return
    with looker(memory=MEMORY) as look:
        began, wall = time.process_time(), time.monotonic()
        shards = update_shards(whole, folder)
        with serve_shards(shards) as address:
            look.open(address)
            spent, waited = time.process_time() - began, time.monotonic() - wall
            _line(f"second opening (at most {OPEN_LIMIT_S:g} s)", f"{spent:.2f} s of ours, {waited:.2f} s wall")
            held = []
            for number in (count - 1, count // 2, 0, count - 1):
                look.show(scan=number)
                look.picture()
                held.append(look.memory())
            _line(f"the viewer's memory (at most {MEMORY_LIMIT_GB:g} GB)", f"{max(held) / 1e9:.2f} GB")


def _live(few: DryingStore, folder: Path) -> None:
    port = free_port()
    command = [str(viewer_program()), "--save", str(folder / "live.rrd"), "--bind", LOCAL, "--port", str(port)]
    program = start(command)
    spent = []
    try:
        wait_until_listening(program, port)
        live = LiveReview(f"rerun+http://{LOCAL}:{port}/proxy", few.about, preset="video", interval_s=1.0)
        ticks = list(ticks_since(few, 0, len(few.events)))
        me = psutil.Process(os.getpid())
        for number in range(30):
            tick = ticks[0 if not number else 1 + number % (len(ticks) - 1)][0]
            began = sum(me.cpu_times()[:2])
            live.show(tick, number)
            live.wait_until_shown()
            spent.append(sum(me.cpu_times()[:2]) - began)
        live.close()
        assert not live.left_out, live.trouble
    finally:
        end(program)
    _line(f"live, median of a scan (at most {LIVE_LIMIT_S:g} s)", f"{np.median(spent):.3f} s")


def _line(what: str, figure: str) -> None:
    print(f"  {what:<62} {figure}", flush=True)


if __name__ == "__main__":
    main()
