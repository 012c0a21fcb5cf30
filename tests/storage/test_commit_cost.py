"""A commit costs as much after many scans as after few, and little enough for 1 Hz video."""

from __future__ import annotations

import os
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pytest

from pipelines import Grid
from storage import create_store, open_store
from storage.icechunk_store import GIVE_BACK_EVERY

from ..benchmarks.bench_store import METRICS, growth, make_tick, memory, relief


@pytest.mark.soak
def test_ten_thousand_scans_cost_like_ten() -> None:
    """An append in time and bytes, and opening a store and reading its last scan."""
    found = growth(10, 10_000, rounds=25, tell=lambda line: print(line, flush=True))
    for what, (few_cost, many_cost) in found.items():
        if not what.endswith("wall ms"):  # other programs on the machine change it
            assert many_cost < 2 * few_cost, what


@pytest.mark.soak
def test_the_memory_of_a_writer_levels_off() -> None:
    """Through the last two thirds of 1,536 commits, in MB; without giving back it grew by 0.07 with each."""
    found = memory(12 * GIVE_BACK_EVERY, tell=lambda line: print(line, flush=True))
    assert max(found[4:]) - found[3] < 5


def _growth(folder: Path, scans: int, around_each: int) -> list[tuple[int, float, float, float, float]]:
    """Append small scans; about the tenth, a middle one and the last: CPU of a commit, its bytes, CPU to open and read.

    Medians of `around_each` commits; processor time, which other programs on the machine do not change.
    """
    grid = Grid(24, 24, 0.02)
    rng, base = np.random.default_rng(1), relief(grid)
    store = create_store(folder, site="bench", grid=grid, metrics=METRICS)
    looked = sorted({around_each + 10, scans // 2, scans})
    rows, costs, sizes = [], [], []
    seen = {path.path for path in os.scandir(folder / "manifests")}
    for number in range(scans):
        tick = make_tick(grid, number, rng, base)
        began = process_time()
        store.append(tick)
        near = any(at - around_each <= number < at for at in looked)
        if near:
            costs.append(process_time() - began)
        if any(at - around_each - 1 <= number < at for at in looked):
            now = {path.path: path.stat().st_size for path in os.scandir(folder / "manifests") if path.path not in seen}
            seen |= set(now)
            if near:
                sizes.append(sum(now.values()) + (folder / "snapshots" / store.about.snapshot).stat().st_size)
        if number + 1 in looked:
            began = process_time()
            reader = open_store(folder)
            opened = process_time() - began
            reader[-1]
            rows.append((number + 1, median(costs), median(sizes), opened, process_time() - began - opened))
            costs, sizes = [], []
    store.close()
    return rows


def _tell(rows: list[tuple[int, float, float, float, float]]) -> None:
    print()
    for number, cost, size, opened, read in rows:
        print(
            f"scan {number:>6}: commit {cost * 1e3:5.1f} ms CPU, {size / 1e3:5.1f} kB; "
            f"open {opened * 1e3:5.1f} ms, read the last {read * 1e3:5.1f} ms"
        )


def test_a_commit_stays_small(tmp_path: Path) -> None:
    rows = _growth(tmp_path / "s", 94, 20)  # the 30th scan and one manifest of 64 later: as far into the newest one
    _tell(rows)
    assert rows[-1][2] < 1.5 * rows[0][2], "bytes of a commit, beside chunks of their own"


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
