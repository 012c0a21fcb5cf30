"""What a commit costs, beside the floor: the same arrays, packed alike and compressed by nothing, written and synced.

``python -m tests.benchmarks.bench_store`` prints the table; `tests/storage/test_commit_cost.py` holds its bounds.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from pipelines import Change, Grid, Measurement, Motion, Scan, Tick
from storage import Store, cell_history, create_store, open_store
from storage.icechunk_store import GIVE_BACK_EVERY, IcechunkStore
from storage.layout import FOLD
from storage.location import BRANCH
from storage.repository import root_of
from storage.rows import Known, Rows, write_rows

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


def aged(folder: Path, grid: Grid, base: np.ndarray, scans: int, tell: Callable[[str], None]) -> Store:
    """Make a store as it is after `scans` scans and as many snapshots, in a hundredth of the time.

    The arrays, and so the chunks and the manifests that cover them, are written at once; then come the snapshots, each
    of one commit of nearly nothing.
    """
    store = create_store(folder, site="bench", grid=grid, metrics=METRICS)
    assert isinstance(store, IcechunkStore)
    rng = np.random.default_rng(2)
    for number in range(2):
        store.append(make_tick(grid, number, rng, base))
    folded, more = scans // FOLD * FOLD, scans - 2

    def write(root: Any, known: Known) -> None:
        rows = []
        for path, array in root.members(max_depth=None):
            if not hasattr(array, "chunks") or array.metadata.dimension_names[0] != "time":
                continue
            if path.endswith(("/time", "/planned")):
                step = array[1] - array[0]
                rows.append(Rows(path, 2, more, array[1] + step * np.arange(1, more + 1)))
            elif path == "scans/scan":
                rows.append(Rows(path, 2, more, np.arange(2, scans)))
            else:
                rows.append(Rows(path, 2, more, np.repeat(array[1:2], more, axis=0)))
        for name in ("height", "dz"):
            tail = root[f"binned/{name}_tail"]
            rows.append(Rows(f"binned/{name}", 0, folded, np.repeat(tail[1:2], folded, axis=0)))
            rows.append(Rows(f"binned/{name}_tail", 0, FOLD, np.repeat(tail[1:2], FOLD, axis=0)))
        write_rows(root.store, rows, known)

    store._commit(write, "scans", {})
    for number in range(more):
        session = store.repository.writable_session(BRANCH)
        root_of(session, "r+").attrs["aged"] = number
        session.commit(f"scan {number}")
        if number % 1000 == 999:
            tell(f"{number + 1:>6} snapshots made")
    store.close()
    return open_store(folder, write=True)


def growth(
    few: int, many: int, rounds: int = 9, tell: Callable[[str], None] = lambda line: None
) -> dict[str, tuple[float, float]]:
    """Compare what a small store costs with `few` scans and with `many`: to append, to open it and read the last scan.

    Medians of processor ms and of wall ms; both stores are asked in turn, so that the machine's mood is the same. And
    the kB of a commit, the mean of as many as fill a manifest, which grows with each. `tell` hears how far it is.
    """
    grid = Grid(20, 30, 0.05)
    rng = np.random.default_rng(1)
    base = relief(grid)
    found: dict[str, dict[int, list[float]]] = {}

    def cost(what: str, count: int, work: Callable[[], Any]) -> None:
        wall, processor = perf_counter(), process_time()
        work()
        for unit, took in (("processor", process_time() - processor), ("wall", perf_counter() - wall)):
            found.setdefault(f"{what}, {unit} ms", {}).setdefault(count, []).append(took * 1e3)

    with scratch() as folder:
        stores = {count: aged(folder / str(count), grid, base, count, tell) for count in (few, many)}

        def append(count: int) -> None:
            stores[count].append(make_tick(grid, len(stores[count]), rng, base))

        for _ in range(rounds):
            for count in stores:
                cost("append", count, lambda count=count: append(count))  # type: ignore[misc]  # bound now
                cost("open and read the last scan", count, lambda count=count: open_store(folder / str(count))[-1])  # type: ignore[misc]  # bound now
        tell("commits in turn measured")
        written = {}
        for count in stores:
            before = size_of(folder / str(count))
            for _ in range(FOLD):
                append(count)
            written[count] = (size_of(folder / str(count)) - before) / FOLD / 1e3
            stores[count].close()
    results = {what: (median(costs[few]), median(costs[many])) for what, costs in found.items()}
    results["a commit, kB"] = written[few], written[many]
    for what, (few_cost, many_cost) in results.items():
        tell(f"{what}: {few_cost:.1f} with {few} scans, {many_cost:.1f} with {many}")
    return results


def memory(commits: int, tell: Callable[[str], None] = lambda line: None) -> list[float]:
    """Give a writer's memory, MB, after each `GIVE_BACK_EVERY` commits of small scans."""
    grid = Grid(8, 8, 0.05)
    rng, base = np.random.default_rng(1), relief(grid)
    found = []
    with scratch() as folder:
        store = create_store(folder / "s", site="bench", grid=grid, metrics=METRICS)
        for number in range(commits):
            store.append(make_tick(grid, number, rng, base))
            if len(store) % GIVE_BACK_EVERY == 0:
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                found.append(pages * os.sysconf("SC_PAGESIZE") / 1e6)
                tell(f"{number + 1:>6} commits: {found[-1]:.1f} MB")
        store.close()
    return found


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
    growth(10, 10_000, tell=lambda line: print(f"  20 x 30   {line}"))
    took, floor = history_cost()
    print(
        f"  1440 x 2560  history of 8x8 cells over 1,000 scans: {took * 1e3:.0f} ms; "
        f"files as large read: {floor * 1e3:.1f} ms"
    )


if __name__ == "__main__":
    main()
