"""What a commit costs, beside the floor: the same arrays, packed alike and compressed by nothing, written and synced.

``python -m tests.benchmarks.bench_store`` prints the table; `tests/storage/test_commit_cost.py` holds its bounds.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from pipelines import Change, Grid, Measurement, Motion, Scan, Tick
from storage import cell_history, create_store, open_store
from storage.layout import FOLD
from storage.rows import Rows, write_rows

START = np.datetime64("2026-01-01T00:00:00", "ns")
METRICS = dict.fromkeys(("net", "gained", "lost", "area", "length", "opening", "lift"), "mm")


def make_tick(grid: Grid, number: int, rng: np.random.Generator, base: np.ndarray) -> Tick:
    """A soil-like scan: relief, 4 um of noise, 3 % of holes, a change and seven metrics."""
    hole = rng.random(grid.shape) < 0.03
    height = (base + rng.normal(0, 0.004, grid.shape)).astype(np.float32)
    height[hole] = np.nan
    sigma = np.where(hole, np.nan, rng.normal(0.004, 0.0003, grid.shape)).astype(np.float32)
    texture = np.clip(120 + 200 * base + rng.normal(0, 3, grid.shape), 0, 255).astype(np.uint8)
    time = START + np.timedelta64(6 * number, "h")
    scan = Scan(grid, time, height, sigma, texture, np.where(hole, 255, 0).astype(np.uint8), "calibration")
    if number == 0:
        return Tick(time, scan)
    change = Change(grid, START, (height - base).astype(np.float32), np.float32(1.96) * sigma, Motion.none())
    return Tick(time, scan, change, {name: Measurement(rng.normal(), 0.1) for name in METRICS}, {"lift": "ok"})


def relief(grid: Grid) -> np.ndarray:
    """Hills of a few hundred um."""
    y, x = np.meshgrid(grid.y_mm, grid.x_mm, indexing="ij")
    return (0.2 * np.sin(x / 1.7) * np.cos(y / 2.3) + 0.05 * np.sin(x * 3.1 + y * 2.2)).astype(np.float32)


def floor_seconds(tick: Tick, folder: Path) -> float:
    """Write the same cells raw to one file, as packed as the store packs them, and sync it."""
    assert tick.scan is not None
    assert tick.change is not None
    began = perf_counter()
    with (folder / "floor.npz").open("wb") as handle:
        np.savez(
            handle,
            height=np.nan_to_num(tick.scan.height * 2000).astype(np.int16),
            dz=np.nan_to_num(tick.change.dz * 2000).astype(np.int16),
            sigma=tick.scan.sigma,
            lod=tick.change.lod,
            texture=tick.scan.texture,
            level=tick.scan.level,
        )
        handle.flush()
        os.fsync(handle.fileno())
    return perf_counter() - began


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder on the disk that the tests use."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def size_of(folder: Path) -> int:
    """Bytes in all files of a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def append_against_floor(cells: int, repeats: int = 9) -> tuple[float, float, float, float]:
    """Give medians of append and floor, interleaved (s), the read of one scan (s), and the commit's bytes."""
    grid = Grid(cells, cells, 0.02)
    rng = np.random.default_rng(1)
    base = relief(grid)
    appends, floors = [], []
    with scratch() as folder:
        store = create_store(folder / "s", site="bench", grid=grid, metrics=METRICS)
        store.append(make_tick(grid, 0, rng, base))
        before = size_of(folder / "s")
        for number in range(1, repeats + 1):
            tick = make_tick(grid, number, rng, base)
            floors.append(floor_seconds(tick, folder))
            began = perf_counter()
            store.append(tick)
            appends.append(perf_counter() - began)
        size = (size_of(folder / "s") - before) / repeats
        store.close()
        reader = open_store(folder / "s")
        began = perf_counter()
        reader[-1]
        read = perf_counter() - began
    return median(appends), median(floors), read, size


def history_cost(scans: int = 1000) -> tuple[float, float]:
    """Give seconds for the history of one 8x8 cells at 1440 x 2560, and for reading files as large as its chunks."""
    grid = Grid(1440, 2560, 0.005)
    rows, columns = grid.rows // 8, grid.columns // 8
    rng = np.random.default_rng(1)
    coarse = (2000 * relief(grid)[::8, ::8]).astype(np.int16)
    with scratch() as folder:
        store = create_store(folder / "s", site="bench", grid=grid)
        folded = scans - scans % FOLD
        written = [Rows("binned/time", 0, scans, START.astype(np.int64) + np.arange(scans) * 10**9)]
        for first in range(0, folded, FOLD):
            block = coarse + rng.integers(-3, 4, (FOLD, rows, columns)).astype(np.int16)
            written.append(Rows("binned/height", first, FOLD, block))
        tail = coarse + rng.integers(-3, 4, (scans - folded, rows, columns)).astype(np.int16)
        written += [Rows("binned/height_tail", slot, 1, tail[slot : slot + 1]) for slot in range(len(tail))]
        for group in (written[:1], *([rows] for rows in written[1:])):  # in order: each lengthens the array
            store._commit(lambda root, known, group=group: write_rows(root.store, group, known), "coarse", {})  # type: ignore[attr-defined]  # nobody waits for a thousand scans at full size
        store.close()
        sizes = sorted(path.stat().st_size for path in (folder / "s" / "chunks").iterdir())
        (folder / "long").write_bytes(bytes(sizes[-1]))
        (folder / "short").write_bytes(bytes(sizes[len(sizes) // 2]))
        times, floors = [], []
        for _ in range(5):
            reader = open_store(folder / "s")
            began = perf_counter()
            history = cell_history(reader, 6.0, 3.0)
            times.append(perf_counter() - began)
            began = perf_counter()
            for _ in range(folded // FOLD):
                (folder / "long").read_bytes()
            for _ in range(scans - folded):
                (folder / "short").read_bytes()
            floors.append(perf_counter() - began)
        assert history.shape == (scans,)
    return min(times), min(floors)


def main() -> None:
    """Print the table."""
    print("store: one tick (scan, change, 7 metrics) as one durable transaction")
    print(f"{'grid':>12} {'append':>9} {'floor':>9} {'ratio':>6} {'read':>8} {'a scan':>9} {'bits a cell':>12}")
    for cells in (500, 1000):
        append, floor, read, size = append_against_floor(cells)
        print(
            f"{cells:>5} x {cells:<4} {append * 1e3:6.0f} ms {floor * 1e3:6.0f} ms {append / floor:6.1f} "
            f"{read * 1e3:5.0f} ms {size / 1e6:6.2f} MB {8 * size / cells**2:12.1f}"
        )
    print("floor: the same cells, packed alike, in one npz, synced")
    took, floor = history_cost()
    print(
        f"  1440 x 2560  history of 8x8 cells over 1,000 scans: {took * 1e3:.0f} ms; "
        f"files as large read: {floor * 1e3:.1f} ms"
    )


if __name__ == "__main__":
    main()
