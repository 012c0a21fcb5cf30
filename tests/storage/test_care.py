"""Care of a store: what is cited survives, what a writer or reader needs is never collected, copies are whole."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from configs import StoreError
from monitor.cli import run_tokens
from pipelines import Frames, PatternSet
from storage import (
    Ledger,
    Store,
    cite,
    collect,
    compact,
    copy_store,
    create_store,
    expire,
    ledger_beside,
    open_store,
    verify,
)
from storage import statistics as statistics_of
from storage.icechunk_store import IcechunkStore
from storage.layout import SCHEMA
from storage.room import full_at, reserve_bytes

from .test_layout import SCHEMA_1
from .test_verification import hashes, made
from .ticks import GRID, METRICS, at, failure, tick

ROOT = Path(__file__).resolve().parents[2]
NOW = timedelta(0)


def _snapshots(path: Path) -> list[str]:
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    return [snapshot.id for snapshot in store.repository.ancestry(branch="main")]


def _same(one: Store, other: Store) -> None:
    assert len(one) == len(other)
    for number in range(len(one)):
        first, second = one[number], other[number]
        for name in ("height", "sigma", "texture", "level"):
            np.testing.assert_array_equal(getattr(first.scan, name), getattr(second.scan, name))
        assert (first.change is None) == (second.change is None)
        if first.change is not None and second.change is not None:
            np.testing.assert_array_equal(first.change.dz, second.change.dz)
            np.testing.assert_array_equal(first.change.motion.matrix, second.change.motion.matrix)
        assert (first.planned, first.epoch, first.baseline) == (second.planned, second.epoch, second.baseline)
        assert first.alarms == second.alarms
    assert one.events == other.events
    assert one.series().equals(other.series())
    assert replace(one.about, location="", snapshot="", schema=0) == replace(
        other.about, location="", snapshot="", schema=0
    )


def test_expired_snapshots_go_and_cited_ones_stay(tmp_path: Path) -> None:
    path = made(tmp_path)
    everything = _snapshots(path)
    name = cite(path, everything[4])
    assert cite(path, everything[4]) == name, "once"
    assert expire(path, datetime.now(UTC) - timedelta(days=1)) == 0, "all are younger"
    before = statistics_of(path, at(9))
    assert expire(path, datetime.now(UTC)) == len(everything) - 3 - 1, "the newest three, and the first, empty one"
    assert _snapshots(path)[:3] == everything[:3]
    gone = collect(path, datetime.now(UTC), dry_run=True)
    assert collect(path, datetime.now(UTC)) == gone
    assert gone.files > 20
    after = statistics_of(path, at(9))
    assert before.bytes - after.bytes == pytest.approx(gone.bytes, abs=100), "the oldest kept has another parent"
    assert (after.tags, after.scans) == (1, 5)
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    import zarr

    then: Any = zarr.open_group(store.repository.readonly_session(tag=name).store, mode="r")
    assert then["scans/time"].shape == (2,)
    np.testing.assert_array_equal(then["scans/texture"][1], store[1].scan.texture)
    assert verify(path).findings == ()
    writer = open_store(path, write=True)
    writer.append(failure(9))
    writer.close()


def test_a_writer_is_never_robbed(tmp_path: Path) -> None:
    path = made(tmp_path)
    writer = open_store(path, write=True)
    assert isinstance(writer, IcechunkStore)
    session = writer.repository.writable_session("main")
    session.store  # noqa: B018 - a commit under way
    for act in (lambda: expire(path, datetime.now(UTC)), lambda: compact(path, NOW)):
        with pytest.raises(StoreError, match="another writer holds this store"):
            act()
    with pytest.raises(StoreError, match=r"a writer is at work .* files younger than an hour may be its own"):
        collect(path, datetime.now(UTC))
    assert collect(path, datetime.now(UTC) - timedelta(hours=2)).files == 0
    writer.append(failure(9))
    writer.close()
    assert verify(path).findings == ()


def test_compact_leaves_the_newest_whole_and_small(tmp_path: Path) -> None:
    store = create_store(tmp_path / "s", site="x", grid=GRID, metrics=METRICS)
    for number in range(12):
        store.append(tick(number))
    store.close()
    before, scan = statistics_of(tmp_path / "s", at(12)), open_store(tmp_path / "s")[3].scan.texture
    gone = compact(tmp_path / "s", NOW)
    after = statistics_of(tmp_path / "s", at(12))
    assert after.bytes < before.bytes / 2
    assert before.bytes - after.bytes == pytest.approx(gone.bytes, abs=100)
    np.testing.assert_array_equal(open_store(tmp_path / "s")[3].scan.texture, scan)
    assert verify(tmp_path / "s").findings == ()


@pytest.mark.parametrize("history", [False, True])
def test_a_copy_is_the_same_and_the_ledger_goes_along(tmp_path: Path, history: bool) -> None:
    path = made(tmp_path / "from")
    patterns = PatternSet("gray", (4, 4), bits=(2, 0))
    stack = np.random.default_rng(1).integers(0, 256, (len(patterns.roles), 6, 8)).astype(np.uint8)
    writer = open_store(path, write=True, metrics={"porosity": "1"})
    writer.append(replace(failure(6), frames=Frames(stack, at(6), patterns, 8.0)))
    before = hashes(path)
    target = tmp_path / "to" / "copy"
    assert copy_store(path, target, history=history) == 5  # while the writer holds the store
    assert hashes(path) == before
    writer.append(failure(7))
    writer.close()
    copied = open_store(target)
    _same(copied, copied)
    assert len(open_store(path).events) == len(copied.events) + 1
    assert verify(target).findings == ()
    assert (len(_snapshots(target)) > 5) == history
    with pytest.raises(StoreError, match="exists already: open it, or choose another path"):
        copy_store(path, target)
    rows = Ledger(ledger_beside(target), write=False)
    assert rows.counts()["taken"] == 5
    rows.close()
    grown = open_store(target, write=True)
    assert grown.append(failure(8)) is None
    grown.close()
    assert isinstance(copied, IcechunkStore)
    from storage.repository import root_of

    ((_, raw),) = root_of(copied.session)["raw"].groups()
    np.testing.assert_array_equal(np.cumsum(raw["differences"][0], axis=-1, dtype=np.uint8), stack)


def test_a_copy_of_the_schema_before_has_the_present_one(tmp_path: Path) -> None:
    with tarfile.open(SCHEMA_1) as archive:
        archive.extractall(tmp_path, filter="data")
    path = tmp_path / "old.icechunk"
    notes = verify(path).findings
    assert [str(note).startswith("note: store: schema 1: its chunks have no checksums") for note in notes] == [True]
    copy_store(path, tmp_path / "new")
    new = open_store(tmp_path / "new")
    assert new.about.schema == SCHEMA
    _same(open_store(path), new)
    assert verify(tmp_path / "new").findings == ()


def test_a_damaged_store_is_not_copied(tmp_path: Path) -> None:
    path = made(tmp_path)
    victim = min((path / "chunks").iterdir(), key=lambda file: file.stat().st_mtime_ns)
    victim.write_bytes(victim.read_bytes()[:-1] + b"?")
    with pytest.raises(StoreError, match=r"rows 0 to 4, cannot be read: .*; `microrelief verify` says more"):
        copy_store(path, tmp_path / "copy")
    assert sorted(each.name for each in tmp_path.iterdir() if "ledger" not in each.name) == ["s"]


WRITER = """
import sys
from storage import open_store
from tests.storage.ticks import failure
store = open_store(sys.argv[1], write=True)
for number in range(10, 100000):
    store.append(failure(number))
    print(number, flush=True)
"""


def test_copies_and_collections_beside_a_busy_writer(tmp_path: Path) -> None:
    path = made(tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        for number, history in enumerate((False, True)):
            copy_store(path, tmp_path / f"copy{number}", history=history)
            collect(path, datetime.now(UTC) - timedelta(hours=1))
            assert [f for f in verify(tmp_path / f"copy{number}").findings if f.level == "damaged"] == []
        child.kill()
    assert [finding for finding in verify(path).findings if finding.level == "damaged"] == []


def test_stat_tells_size_growth_and_the_day_the_disk_is_full(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(tmp_path)
    assert run_tokens(["store", "stat", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    on_disk = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    assert (told["scans"], told["snapshots"], told["bytes"]) == (5, 8, on_disk)
    assert told["bytes_per_scan"] == pytest.approx(on_disk / 5)
    assert told["bytes_per_day"] == pytest.approx(on_disk / 5 * 4, rel=0.01), "four scans a day"
    pace = full_at(at(0), told["free"], told["bytes"], at(0), at(4), told["scans"])
    assert (told["disk_full"] is None) == (pace is None)
    assert set(told["by_group"]) == {"binned", "calibrations", "change", "events", "metrics", "scans"}
    assert sum(told["kinds"].values()) < on_disk
    assert run_tokens(["store", "stat", str(path)]) == 0
    assert "growth" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "code", "told"),
    [
        ("store copy {s}", 2, "name where the copy goes"),
        ("store gc {s} other", 2, "gc takes one store, not other too"),
        ("store stat {s} --dry-run", 2, "--dry-run goes with gc"),
        ("store copy {s} {t} --older-than 1d", 2, "--older-than goes with gc, expire, compact"),
        ("store gc {s} --older-than 5", 2, "--older-than: '5' is not a length of time"),
        ("store mend {s}", 2, "mend"),
        ("store gc {t}", 1, "no such store"),
        ("verify {t}", 1, "no such store"),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, code: int, told: str
) -> None:
    create_store(tmp_path / "s", site="x", grid=GRID).close()
    before = hashes(tmp_path)
    assert run_tokens(line.format(s=tmp_path / "s", t=tmp_path / "t").split()) == code
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert hashes(tmp_path) == before


def test_a_report_tags_the_snapshot_that_it_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = made(tmp_path)
    newest = _snapshots(path)[0]
    assert run_tokens(["report", str(path), "--out", str(tmp_path / "report")]) in (0, 3)
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    assert store.repository.lookup_tag(f"cited-{newest}") == newest
    capsys.readouterr()


def test_the_day_the_disk_is_full() -> None:
    """101 scans, one a day, of 1 MB each: 50 MB last fifty days."""
    first, last, now = at(0), at(400), at(404)
    days = np.timedelta64(50, "D")
    assert full_at(now, 50e6, 101e6, first, last, 101) == now + days
    assert full_at(now, 500e6, 101e6, first, last, 101) == now + 10 * days
    assert full_at(now, 50e6, 2e6, first, first + np.timedelta64(11, "s"), 2) is None, "two by hand are no pace"
    assert full_at(now, 50e6, 60e6, first, first + np.timedelta64(60, "s"), 60) is not None, "a minute of video is"
    for free, used, scans in ((50e6, 1e6, 1), (50e6, 0, 101), (1e12, 1e3, 101)):
        assert full_at(now, free, used, first, last, scans) is None, "not known, or a century away"


@pytest.mark.parametrize(
    ("total", "scan", "reserve"),
    [(1e12, 1e6, 500e6), (1e12, 100e6, 1e9), (8e9, 1e6, 400e6), (40e6, 5e5, 2e6), (40e6, 5e6, 10e6)],
)
def test_the_reserve(total: float, scan: float, reserve: float) -> None:
    assert reserve_bytes(total, scan) == pytest.approx(reserve)
