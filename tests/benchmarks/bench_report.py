"""What a report of a long campaign costs, beside reading the cells of the scans that it looks at.

``python -m tests.benchmarks.bench_report [STORE]`` prints the table; without a store it makes one of 540 scans of
1000x1000 first, which takes two minutes.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from dashboards import gather, write_findings
from dashboards.findings import _MOST_READ
from dashboards.pdf import render_pdf
from dashboards.report import make_sections
from pipelines import Change, Measurement, Tick
from pipelines.change import METRICS
from storage import create_store, open_store
from tests.dashboards.drying import CAMPAIGN, SIX_HOURS, drying_store

SCANS, SIZE = 540, 1000
NAMES = (
    *("net_volume", "gained_volume", "lost_volume", "crack_area", "crack_length", "crack_opening", "edge_lift"),
    *("crack_depth", "crack_volume", "curl_angle", "plate_lift_largest", "covered"),
)
HTML_LIMIT, REPORT_LIMIT_S, PDF_LIMIT_S = 1_000_000, 10.0, 5.0


def ticks(scans: int, size: int) -> Iterator[Tick]:
    """A crust that dries through four states, with fresh noise in every scan and a dozen metrics."""
    states = drying_store(4, size).scans
    base = states[0].scan
    noise = np.random.default_rng(1).normal(0, 0.003, base.height.shape).astype(np.float32)
    for number in range(scans):
        state = states[min(4 * number // scans, 3)]
        time = base.time + number * SIX_HOURS
        height = state.scan.height + np.roll(noise, number, axis=1)
        scan = replace(state.scan, time=time, height=height)
        change, values = None, {}
        if number:
            dz = height - base.height
            assert states[-1].change is not None
            lod = np.where(np.isfinite(dz), 0.0126, np.nan).astype(np.float32)
            change = Change(scan.grid, base.time, dz, lod, states[-1].change.motion)
            wobble = np.random.default_rng(number).normal(0, 0.05, len(NAMES))
            values = {
                name: Measurement(1 - np.exp(-3 * number / scans) + off, 0.05)
                for name, off in zip(NAMES, wobble, strict=True)
            }
        yield Tick(time, scan, change, values, {"crack opening": "ok"})


def make_store(path: Path) -> None:
    """Write it."""
    every = ticks(SCANS, SIZE)
    first = next(every)
    assert first.scan is not None
    units = {name: METRICS[name].unit for name in NAMES}
    store = create_store(path, site="Bench", grid=first.scan.grid, campaign=CAMPAIGN, metrics=units)
    store.append(first)
    for tick in every:
        store.append(tick)
    store.close()


def main(path: Path | None = None) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as made:
        if path is None:
            path = Path(made) / "bench.icechunk"
            make_store(path)
        store = open_store(path)
        began = process_time()
        for number in np.linspace(0, len(store) - 1, min(len(store), _MOST_READ)).astype(int):
            _ = store[int(number)]
        floor = process_time() - began
        began = process_time()
        page = write_findings(gather(store), Path(made) / "report")
        plain = process_time() - began
        sections = make_sections(gather(store))
        began = process_time()
        render_pdf(sections, site="Bench", kind="Surface report", software="", templates=None, attached={})
        pdf = process_time() - began
        text = page.read_text(encoding="utf-8")
        pictures = sum(map(len, re.findall(r"data:image/png;base64,[^\"]*", text)))
    print(f"report of {len(store)} scans, processor seconds")
    print(f"  HTML, s (at most {REPORT_LIMIT_S:g})                {plain:8.2f}")
    print(f"  reading the scans that it looks at, s  {floor:8.2f}")
    print(f"  PDF beside it, s (at most {PDF_LIMIT_S:g})         {pdf:8.2f}")
    print(f"  page without pictures, kB (at most {HTML_LIMIT // 1000}) {(len(text) - pictures) // 1000:8d}")
    print(f"  its pictures, kB                       {pictures // 1000:8d}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else None)
