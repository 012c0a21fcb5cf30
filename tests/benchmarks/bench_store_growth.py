"""What a store costs as it ages: bytes of a commit by kind of file, and its latency, after few scans and after many.

``python -m tests.benchmarks.bench_store_growth [SCANS]`` appends so many (10,000) and prints them on the way;
`tests/storage/test_commit_cost.py` holds the bounds.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from pipelines import Grid
from storage import Store, create_store, open_store
from storage.icechunk_store import GIVE_BACK_EVERY, IcechunkStore
from storage.layout import FOLD
from storage.location import BRANCH
from storage.repository import root_of
from storage.rows import Known, Rows, write_rows

from .bench_store import METRICS, make_tick, relief, scratch

Tell = Callable[[str], None]

AROUND = 512
"""Scans that bytes are the mean of: as many as fill a manifest of most arrays, which grows with each."""

BLOCK = 4096
"""What a file takes on most disks is a multiple of."""

THIN = 64
"""The fewest scans that a manifest of `GRID` holds."""

GRID = Grid(40, 60, 0.05)
"""The smallest whose cells lie in files of their own, as those of every real one."""


def silent(line: str) -> None:
    """Say nothing."""


def bytes_by_kind(folder: Path) -> Counter[str]:
    """Give the bytes of a store's files by the folder that they lie in, and ``on disk`` those of all their blocks."""
    found: Counter[str] = Counter()
    for kind in ("snapshots", "manifests", "transactions", "chunks"):
        if (folder / kind).is_dir():
            sizes = [entry.stat().st_size for entry in os.scandir(folder / kind)]
            found[kind] = sum(sizes)
            found["on disk"] += sum(-(-size // BLOCK) * BLOCK for size in sizes)
    return found


def appended(folder: Path, scans: int, tell: Tell = silent) -> dict[int, dict[str, float]]:
    """Append `scans` scans, each for real; tell what the first `AROUND` commits cost, the second, fourth and so on.

    Returns
    -------
    dict of int to (dict of str to float)
        By number of scans: kB of a commit by kind of file, their ``sum``, in blocks ``on disk``, and its ``CPU ms``
        (median); opening the store and reading its last scan, ``open CPU ms``.
    """
    look_at = {scans, *(AROUND * 2**power for power in range(20) if AROUND * 2**power <= scans - AROUND)}
    rng, base = np.random.default_rng(1), relief(GRID)
    store = create_store(folder, site="bench", grid=GRID, metrics=METRICS)
    before = bytes_by_kind(folder)
    costs: list[float] = []
    found: dict[int, dict[str, float]] = {}
    for number in range(scans):
        tick = make_tick(GRID, number, rng, base)
        if number + AROUND in look_at:
            before, costs = bytes_by_kind(folder), []
        began = process_time()
        store.append(tick)
        costs.append(process_time() - began)
        if number + 1 in look_at:
            grown = bytes_by_kind(folder)
            grown.subtract(before)
            each = {kind: size / AROUND / 1e3 for kind, size in grown.items()}
            began = process_time()
            open_store(folder)[-1]
            opened = 1e3 * (process_time() - began)
            found[number + 1] = {
                **each,
                "sum": sum(each.values()) - each["on disk"],
                "CPU ms": 1e3 * median(costs),
                "open CPU ms": opened,
            }
            told = ", ".join(f"{what} {value:.1f}" for what, value in found[number + 1].items())
            tell(f"{number + 1:>6} scans; kB of a commit: {told}")
    store.close()
    return found


def aged(folder: Path, grid: Grid, base: np.ndarray, scans: int, tell: Tell = silent, *, thin: bool = False) -> Store:
    """Make a store as it is after `scans` scans and as many snapshots, in a hundredth of the time.

    The arrays, and so the chunks and the manifests that cover them, are written at once; then come the snapshots, each
    of one commit of nearly nothing. A `thin` one has the cells of one scan in `THIN`, which makes as many manifests,
    and no snapshots.
    """
    store = create_store(folder, site="bench", grid=grid, metrics=METRICS)
    assert isinstance(store, IcechunkStore)
    rng = np.random.default_rng(2)
    for number in range(2):
        store.append(make_tick(grid, number, rng, base))
    folded, more = scans // FOLD * FOLD, scans - 2

    def write(root: Any, known: Known) -> None:
        rows: list[Rows] = []
        longer: list[Rows] = []
        for path, array in root.members(max_depth=None):
            if not hasattr(array, "chunks") or array.metadata.dimension_names[0] != "time":
                continue
            if path.endswith(("/time", "/planned")):
                step = array[1] - array[0]
                rows.append(Rows(path, 2, more, array[1] + step * np.arange(1, more + 1)))
            elif path == "scans/scan":
                rows.append(Rows(path, 2, more, np.arange(2, scans)))
            elif array.ndim == 3 and thin:
                longer.append(Rows(path, 2, more, None))
                rows += [Rows(path, at, 1, array[1:2]) for at in range(THIN, scans, THIN)]
            else:
                rows.append(Rows(path, 2, more, np.repeat(array[1:2], more, axis=0)))
        for name in ("height", "dz"):
            tail = root[f"binned/{name}_tail"]
            rows.append(Rows(f"binned/{name}", 0, folded, np.repeat(tail[1:2], folded, axis=0)))
            rows.append(Rows(f"binned/{name}_tail", 0, FOLD, np.repeat(tail[1:2], FOLD, axis=0)))
        write_rows(root.store, longer, known)
        write_rows(root.store, rows, known)

    store._commit(write, "scans", {})
    for number in range(0 if thin else more):
        session = store.repository.writable_session(BRANCH)
        root_of(session, "r+").attrs["aged"] = number
        session.commit(f"scan {number}")
        if number % 1000 == 999:
            tell(f"{number + 1:>6} snapshots made")
    store.close()
    return open_store(folder, write=True)


def latency(few: int, many: int, rounds: int = 9, tell: Tell = silent) -> dict[str, tuple[float, float]]:
    """Compare what a small store costs with `few` scans and with `many`: to append, to open it and read the last scan.

    Medians of processor ms and of wall ms; both stores are asked in turn, so that the machine's mood is the same.
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
        for store in stores.values():
            store.close()
    results = {what: (median(costs[few]), median(costs[many])) for what, costs in found.items()}
    for what, (few_cost, many_cost) in results.items():
        tell(f"{what}: {few_cost:.1f} with {few} scans, {many_cost:.1f} with {many}")
    return results


def memory(commits: int, tell: Tell = silent) -> list[float]:
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


def main(scans: int = 10_000) -> None:
    """Print what commits cost on the way to `scans` scans."""
    print(f"store: {scans} scans of {GRID.rows} x {GRID.columns} cells, change and 7 metrics, each its own commit")
    with scratch() as folder:
        appended(folder / "s", scans, tell=lambda line: print(line, flush=True))


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
