"""A commit costs as much after many scans as after few, and little enough for 1 Hz video."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import pytest

from pipelines import Grid
from storage import create_store
from storage.icechunk_store import GIVE_BACK_EVERY

from ..benchmarks.bench_store import METRICS, make_tick, relief
from ..benchmarks.bench_store_growth import AROUND, GRID, aged, appended, latency, memory

LISTED = 3.0
"""Bytes by which a commit may grow with each scan that there is: 2.5, and a manifest more or less of each array."""


def _tell(line: str) -> None:
    print(line, flush=True)


@pytest.mark.soak
def test_ten_thousand_scans_take_as_long_as_ten() -> None:
    """An append, and opening a store and reading its last scan."""
    found = latency(10, 10_000, rounds=25, tell=_tell)
    for what, (few_cost, many_cost) in found.items():
        if not what.endswith("wall ms"):  # other programs on the machine change it
            assert many_cost < 2 * few_cost, what


@pytest.mark.soak
def test_ten_thousand_appends_grow_by_little(tmp_path: Path) -> None:
    """Each for real. Of the small grid here a commit is nearly all bookkeeping: of a real one's megabytes, nothing."""
    found = appended(tmp_path / "s", 10_000, tell=_tell)
    first, filled, last = found[AROUND], found[2048], found[10_000]  # by then the longest manifests are full
    assert last["sum"] - filled["sum"] < LISTED * (10_000 - 2048) / 1e3
    assert last["sum"] < 1.6 * first["sum"]
    assert last["on disk"] < 1.2 * first["on disk"]
    assert last["CPU ms"] < 2 * first["CPU ms"]
    assert last["open CPU ms"] < 2 * first["open CPU ms"]


@pytest.mark.soak
def test_the_memory_of_a_writer_levels_off() -> None:
    """Through the last two thirds of 1,536 commits, in MB; without giving back it grew by 0.07 with each."""
    found = memory(12 * GIVE_BACK_EVERY, tell=_tell)
    assert max(found[4:]) - found[3] < 5


def test_what_a_commit_writes_hardly_grows_with_the_scans_there_are(tmp_path: Path) -> None:
    """The list of manifests, which is in every snapshot: 25 bytes for each. All else is the newest scans' alone."""
    sizes: dict[int, int] = {}
    for scans in (256, 4096):
        store = aged(tmp_path / f"{scans}", GRID, relief(GRID), scans, thin=True)
        sizes[scans] = (tmp_path / f"{scans}" / "snapshots" / store.about.snapshot).stat().st_size
        store.close()
    assert sizes[4096] - sizes[256] < LISTED * (4096 - 256), sizes


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
