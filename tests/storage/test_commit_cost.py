"""A commit costs as much after many scans as after few, and little enough for 1 Hz video."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pytest

from pipelines import Grid
from storage import create_store

from ..benchmarks.bench_store import LATE, METRICS, SPAN, WARM, around, commit_costs, growth, make_tick, relief


@pytest.mark.soak
def test_a_commit_costs_the_same_at_scan_300_as_at_scan_10() -> None:
    costs = commit_costs(200, LATE + SPAN)
    (early_s, early_bytes), (late_s, late_bytes) = around(costs, WARM), around(costs, LATE)
    print(f"\nscan {WARM}: {early_s * 1e3:.0f} ms, {early_bytes / 1e3:.0f} kB;", end=" ")
    print(f"scan {LATE}: {late_s * 1e3:.0f} ms, {late_bytes / 1e3:.0f} kB")
    assert late_bytes < 1.15 * early_bytes
    assert late_s < 2 * early_s, "measured on a machine that may do other things meanwhile"


@pytest.mark.soak
def test_ten_thousand_scans_cost_like_ten() -> None:
    """An append, and opening a store and reading its last scan."""
    for what, (few, many) in growth(10, 10_000).items():
        print(f"\n{what}: {few * 1e3:.1f} ms of processor with 10 scans, {many * 1e3:.1f} ms with 10,000", end="")
        assert many < 2 * few


def test_a_commit_leaves_a_1_hz_video_its_time(tmp_path: Path) -> None:
    """In processor time of all threads, which other programs on the machine do not change."""
    grid = Grid(500, 500, 0.02)
    rng, base = np.random.default_rng(1), relief(grid)
    store = create_store(tmp_path / "s", site="bench", grid=grid, metrics=METRICS)
    costs = []
    for number in range(4):
        tick = make_tick(grid, number, rng, base)
        began = process_time()
        store.append(tick)
        costs.append(process_time() - began)
    store.close()
    assert median(costs[1:]) < 0.5
