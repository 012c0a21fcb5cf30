"""After a power cut: whatever files of the newest commit are empty or cut, the store opens at a whole snapshot."""

from __future__ import annotations

import os
import random
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines import Frames, Grid, PatternSet, Tick
from storage import Store, create_store, open_store

from .ticks import METRICS, at, calibration, failure, surface, tick

GRID = Grid(40, 60, 0.05)
"""Its cells do not fit into a manifest: a scan has chunk files."""

KINDS = ("snapshots", "manifests", "chunks", "refs", "")
PATTERNS = PatternSet("gray", (4, 4), bits=(2, 0))


def _tick(number: int) -> Tick:
    """A visit with everything that a commit can hold."""
    kept = calibration(1 + number / 100)
    scan = surface(number, GRID, kept.id)
    stack = np.random.default_rng(number).integers(0, 256, (len(PATTERNS.roles), 40, 60)).astype(np.uint8)
    frames = Frames(stack, scan.time, PATTERNS, 8.0)
    return replace(tick(number), scan=scan, change=None, calibration=kept, frames=frames, events=failure(number).events)


def _made(folder: Path, scans: int) -> tuple[Path, Path]:
    """Make a store as it was synced, and as it was one commit later."""
    store = create_store(folder / "after", site="x", grid=GRID, metrics=METRICS)
    for number in range(scans):
        if number == scans - 1:
            shutil.copytree(folder / "after", folder / "before")
        store.append(_tick(number))
    store.close()
    return folder / "before", folder / "after"


def _new_files(before: Path, after: Path, kind: str) -> list[Path]:
    names = [path.relative_to(after) for path in (after / kind).rglob("*") if path.is_file()]
    fresh = [n for n in names if not (before / n).exists() or (before / n).read_bytes() != (after / n).read_bytes()]
    return sorted(name for name in fresh if name.name != "writer.lock")


def _everything(store: Store) -> int:
    """Read all that the newest commits touched; return how many scans there are."""
    for number in range(max(0, len(store) - 2), len(store)):
        stored = store[number]
        np.testing.assert_array_equal(stored.scan.texture, surface(number, GRID).texture)
        store.calibration(stored.scan.calibration_id)
    assert list(store.series()["scan"]) == list(range(len(store)))
    assert len([event for event in store.events if event.kind == "failed"]) == len(store)
    return len(store)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("scans", "choices"),
    [(4, 2), pytest.param(64, 100, marks=pytest.mark.soak)],  # the 64th folds the coarse histories and touches the most
)
def test_opens_at_a_whole_snapshot(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], kind: str, scans: int, choices: int
) -> None:
    before, after = _made(tmp_path, scans)
    files = _new_files(before, after, kind)
    assert files, kind
    draw = random.Random(f"{kind} {choices}")
    found = {scans - 1: 0, scans: 0}
    for number in range(choices):
        folder = tmp_path / f"s{number}"
        shutil.copytree(after, folder, copy_function=os.link)
        torn = draw.sample(files, draw.randint(1, min(len(files), 4)))
        for name in torn:
            whole = (folder / name).read_bytes()
            (folder / name).unlink()  # the others' link stays whole
            (folder / name).write_bytes(whole[: draw.choice([0, draw.randrange(len(whole))])])
        reader = open_store(folder)
        count = _everything(reader)
        found[count] += 1
        lost = [event for event in reader.events if event.kind == "lost"]
        assert len(lost) == (count == scans - 1), (torn, lost)
        assert not lost or f"newest is scan {scans - 2}" in lost[0].text
        writer = open_store(folder, write=True)
        assert writer.append(_tick(count + 1)) == count
        writer.close()
        again = open_store(folder)
        assert (len(again), again[-1].planned) == (count + 1, at(count + 1))
        shutil.rmtree(folder)
        if number % 25 == 24:
            print(f"{kind or 'any'}: {number + 1} choices, scans found: {found}", flush=True)
    assert kind not in ("snapshots", "chunks", "manifests") or found[scans] == 0, "a torn file was not noticed"
    assert capfd.readouterr().err == "", "one event says it, no log of a library"
    print(f"{kind or 'any'}: {choices} choices among {len(files)} new files; scans found: {found}")
