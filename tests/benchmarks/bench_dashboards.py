"""A year on the disk, 540 scans of 1000x1000: its review, its report, and a video's scans shown live at 1 Hz.

``python -m tests.benchmarks.bench_dashboards [--scans N] [--live SECONDS] [PART...]``, parts being review, open, report
live. The store is made once, in the temporary folder (2 GB, two minutes). Figures are seconds of processor time, ours
and our threads', with the wall clock's beside them: `--live 600` is ten minutes at 1 Hz.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from dashboards import LiveReview, cache_folder, gather, record_review, serve_shards, update_shards, write_findings
from dashboards.findings import _MOST_READ
from dashboards.pdf import render_pdf
from dashboards.report import make_sections
from dashboards.viewer import memory_limits
from monitor.live_review import ticks_since
from storage import open_store, snapshots
from tests.dashboards.drying import drying_store
from tests.dashboards.take_screenshot import looker, missing_libraries

from .year_store import A_DAY, year_store

SCANS, SIZE = 540, 1000
SCAN_LIMIT_S, SCAN_LIMIT_MB, OPEN_LIMIT_S, DAY_LIMIT_S, MEMORY_LIMIT_GB = 0.35, 3.0, 5.0, 3.0, 1.5
HTML_LIMIT_KB, REPORT_LIMIT_S, PDF_LIMIT_S = 1000, 10.0, 5.0
LIVE_LIMIT_S, LIVE_S = 0.1, 30
LOOKED_AT_S = 3.0
PARTS = ("review", "open", "report", "live")


@dataclass
class Spent:
    """What something took, seconds."""

    cpu: float = 0.0
    wall: float = 0.0

    def __str__(self) -> str:
        return f"{self.cpu:7.2f} s CPU {self.wall:7.2f} s wall"


@contextmanager
def spending() -> Iterator[Spent]:
    """Measure a block of code."""
    spent, cpu, wall = Spent(), time.process_time(), time.monotonic()
    yield spent
    spent.cpu, spent.wall = time.process_time() - cpu, time.monotonic() - wall


def main(given: argparse.Namespace | None = None) -> None:
    """Print the table."""
    given = given or arguments([])
    print(f"dashboards, {given.scans} scans of {SIZE}x{SIZE}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    if missing_libraries():
        print(f"  {missing_libraries()}")
    with tempfile.TemporaryDirectory() as folder:
        record_review(drying_store(3, 40), Path(folder) / "imports.rrd")
    for part, measure in (("review", review), ("open", second_opening), ("report", report)):
        if part in given.parts:
            measure(year_store(given.scans, SIZE))
    if "live" in given.parts:
        live(given.live)


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=PARTS, help=", ".join(PARTS))
    parser.add_argument("--scans", type=int, default=SCANS)
    parser.add_argument("--live", type=int, default=LIVE_S, help="how long scans come live, seconds")
    return parser.parse_args(words)


def review(path: Path) -> None:
    """Draw all but the newest day, then that."""
    whole = open_store(path)
    day = next(islice(snapshots(path), 1, None))
    before = open_store(path, snapshot=day.id)
    folder = cache_folder(whole)
    shutil.rmtree(folder, ignore_errors=True)
    with spending() as first:
        made = update_shards(before, folder).made
    _line("the first review draws", f"{made} scans in {first}")
    _line(f"a scan with its cracks and plates (at most {SCAN_LIMIT_S:g} s)", f"{first.cpu / made:.3f} s CPU")
    size = sum(file.stat().st_size for file in folder.glob("????-??-??.rrd"))
    _line(f"a scan on the disk (at most {SCAN_LIMIT_MB:g} MB)", f"{size / made / 1e6:.2f} MB")
    heights = [whole[number].scan.height for number in range(0, len(whole), max(1, len(whole) // 6))]
    with spending() as floor:
        for height in heights:
            zlib.compress(height.tobytes(), 4)
    _line("zlib of its heights alone", f"{floor.cpu / len(heights):.3f} s CPU")
    with spending() as reading:
        for number in range(A_DAY):
            _ = whole[number]
    _line("reading a scan from the store", f"{reading.cpu / A_DAY:.3f} s CPU")
    with spending() as fresh:
        made = update_shards(whole, folder).made
    _line(f"a new day of {made} scans (at most {DAY_LIMIT_S:g} s)", str(fresh))


def second_opening(path: Path) -> None:
    """Open what was drawn in a viewer without a screen, and go to and fro in it."""
    if missing_libraries():
        return
    with looker(limits=memory_limits("rerun+http://")) as look, ExitStack() as served:
        with spending() as again:
            store = open_store(path)
            address = served.enter_context(serve_shards(update_shards(store, cache_folder(store))))
            look.open(address)
        _line(f"second opening, until the viewer has loaded it (at most {OPEN_LIMIT_S:g} s)", str(again))
        held = []
        for number in (len(store) - 1, *range(0, len(store), max(1, len(store) // 20))):
            look.show(scan=number)
            time.sleep(LOOKED_AT_S)  # no pictures: each one takes 15 MB that the viewer never gives back
            held.append(look.memory())
        _line(f"the viewer, moved to {len(held)} scans (at most {MEMORY_LIMIT_GB:g} GB)", f"{max(held) / 1e9:.2f} GB")


def report(path: Path) -> None:
    """Write the report of the whole record, and its PDF."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(path)
        with spending() as floor:
            for number in np.linspace(0, len(store) - 1, min(len(store), _MOST_READ)).astype(int):
                _ = store[int(number)]
        with spending() as page:
            findings = gather(store)
            file = write_findings(findings, Path(folder) / "report")
        sections = make_sections(findings)
        with spending() as pdf:
            words = {"site": "Bench", "kind": "Surface report", "software": ""}
            made = render_pdf(sections, **words, templates=None, attached={})
        text = file.read_text(encoding="utf-8")
    pictures = sum(map(len, re.findall(r"data:image/png;base64,[^\"]*", text)))
    _line(f"report of {len(store)} scans (at most {REPORT_LIMIT_S:g} s)", str(page))
    _line("reading the scans that it looks at", str(floor))
    kilobytes = (len(text) - pictures) // 1000
    _line(f"its page without pictures (at most {HTML_LIMIT_KB} kB)", f"{kilobytes} kB, pictures {pictures // 1000} kB")
    _line(f"its PDF (at most {PDF_LIMIT_S:g} s)", f"{pdf}, {len(made) // 1000} kB")


def live(seconds: int) -> None:
    """Show a scan of a video every second, in a viewer without a screen."""
    if missing_libraries():
        return
    few = drying_store(6, SIZE)
    given = [tick for tick, _ in ticks_since(few, 0, few.events) if tick.scan is not None]
    spent, held, late = [], [], 0
    with looker(limits=memory_limits("")) as look:
        shown = LiveReview(look.address, few.about, preset="video", interval_s=1.0)
        began = time.monotonic()
        for number in range(seconds):
            tick = given[0 if not number else 1 + number % (len(given) - 1)]
            assert tick.scan is not None
            when = few.scans[0].scan.time + number * np.timedelta64(1, "s")
            tick = replace(tick, planned=when, scan=replace(tick.scan, time=when))
            time.sleep(max(0.0, began + number - time.monotonic()))
            with spending() as one:
                shown.show(tick, number)
                shown.wait_until_shown()
            spent.append(one)
            late += one.wall > 1.0
            if number % 10 == 9:
                held.append(look.memory())
        complaints = look.complaints()
        shown.close()
    cpu, wall = (np.array([getattr(one, kind) for one in spent]) for kind in ("cpu", "wall"))
    _line(
        f"live for {seconds} s, median of a scan (at most {LIVE_LIMIT_S:g} s)",
        f"{np.median(cpu):.3f} s CPU {np.median(wall):.3f} s wall, 99 % within {np.percentile(wall, 99):.2f} s",
    )
    _line("left out; took longer than a second", f"{shown.left_out} {shown.trouble}; {late} of {seconds}")
    if held:
        half = held[len(held) // 2 :]
        _line(
            f"the viewer's memory at most (at most {MEMORY_LIMIT_GB:g} GB)",
            f"{max(held) / 1e9:.2f} GB, in the second half {min(half) / 1e9:.2f} to {max(half) / 1e9:.2f} GB",
        )
    for complaint in complaints:
        print(f"  viewer: {complaint}")


def _line(what: str, figure: str) -> None:
    print(f"  {what:<66} {figure}", flush=True)


if __name__ == "__main__":
    main(arguments())
