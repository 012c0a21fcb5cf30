"""What survives: a power cut's empty files, a full disk, kill -9 at any moment."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import storage.folder
from configs import StoreError
from pipelines import Grid
from storage import create_store, open_store

from .ticks import GRID, METRICS, failure, surface, tick
from .writers import ROOT, Nursery, check_whole, kill_at_random


def _store(folder: Path, scans: int = 0) -> None:
    store = create_store(folder, site="x", grid=GRID, metrics=METRICS)
    for number in range(scans):
        store.append(tick(number))
    store.close()


def _newest(folder: Path, kind: str) -> Path:
    return max((folder / kind).iterdir(), key=lambda path: path.stat().st_mtime_ns)


@pytest.mark.parametrize("kind", ["snapshots", "manifests", "chunks"])
@pytest.mark.parametrize("damage", ["empty", "zeros", "gone"])
def test_opens_at_the_newest_whole_snapshot_and_says_what_was_lost(tmp_path: Path, kind: str, damage: str) -> None:
    folder = tmp_path / "s"
    grid = Grid(80, 80, 0.05) if kind == "chunks" else GRID  # a smaller grid's chunks lie in manifests
    store = create_store(folder, site="x", grid=grid)
    ticks = [replace(tick(number, baseline=None), scan=surface(number, grid)) for number in range(3)]
    for each in ticks:
        store.append(each)
    store.close()
    newest = open_store(folder).about.snapshot
    assert _newest(folder, "snapshots").name == newest
    victim = _newest(folder, kind)
    size = victim.stat().st_size
    victim.unlink()
    if damage != "gone":
        victim.write_bytes(b"" if damage == "empty" else b"\0" * size)
    reader = open_store(folder)
    assert len(reader) == 2
    assert reader.events[-1].kind == "lost"
    assert f"snapshot {newest} cannot be read" in reader.events[-1].text
    assert "newest is scan 1" in reader.events[-1].text
    writer = open_store(folder, write=True)
    assert len(writer) == 2
    assert writer.append(ticks[2]) == 2
    writer.close()
    again = open_store(folder)
    assert len(again) == 3
    np.testing.assert_array_equal(again[2].scan.texture, surface(2, grid).texture)
    assert len([event for event in again.events if "cannot be read" in event.text]) == 1


def test_a_damaged_old_scan_is_one_clear_line(tmp_path: Path) -> None:
    grid = Grid(80, 80, 0.05)
    store = create_store(tmp_path / "s", site="x", grid=grid)
    for number in range(2):
        store.append(replace(tick(number, baseline=None), scan=surface(number, grid)))
        if number == 0:
            old = list((tmp_path / "s" / "chunks").iterdir())
    store.close()
    for chunk in old:
        chunk.write_bytes(b"")
    reader = open_store(tmp_path / "s")
    assert reader[1].scan.time == surface(1).time
    with pytest.raises(StoreError, match="scan 0 cannot be read") as caught:
        reader[0]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("torn", [b"", b"\0" * 35])
def test_a_torn_reference_is_mended(tmp_path: Path, torn: bytes) -> None:
    _store(tmp_path / "s", 2)
    (tmp_path / "s" / "refs" / "branch.main" / "ref.json").write_bytes(torn)
    assert len(open_store(tmp_path / "s")) == 2


def test_a_torn_reference_that_cannot_be_mended_is_one_clear_line(tmp_path: Path) -> None:
    _store(tmp_path / "s", 1)
    reference = tmp_path / "s" / "refs" / "branch.main" / "ref.json"
    reference.write_bytes(b"")
    reference.with_name("ref.json.mended").mkdir()  # in the way, as a disk that can only be read would be
    with pytest.raises(
        StoreError, match=r"ref.json was torn by a power cut and cannot be mended here: .*; open"
    ) as caught:
        open_store(tmp_path / "s")
    assert "\n" not in str(caught.value)
    assert reference.read_bytes() == b"", "nothing was made worse"


def test_nothing_whole_is_one_clear_line(tmp_path: Path) -> None:
    _store(tmp_path / "s", 1)
    for snapshot in (tmp_path / "s" / "snapshots").iterdir():
        snapshot.write_bytes(b"")
    with pytest.raises(StoreError, match="no snapshot holds a whole store") as caught:
        open_store(tmp_path / "s")
    assert "\n" not in str(caught.value)


def test_the_reference_moves_only_after_everything_is_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _store(tmp_path / "s", 1)
    store = open_store(tmp_path / "s", write=True)
    reference = tmp_path / "s" / "refs" / "branch.main" / "ref.json"
    before, seen = reference.read_text(), []

    def power_cut(folder: Path) -> None:
        seen.append(reference.read_text())
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(storage.folder, "sync_file_system", power_cut)
    with pytest.raises(StoreError, match="was not stored: Input/output error"):
        store.append(tick(1))
    assert seen == [before]
    assert reference.read_text() == before
    monkeypatch.undo()
    assert store.append(tick(1)) == 1
    store.close()


def test_syncs_the_new_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _store(tmp_path / "s")
    store = open_store(tmp_path / "s", write=True)
    synced: list[str] = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    store.append(failure(0))
    assert synced == ["ref.json", "branch.main"]
    store.close()


def _killed_at_random(nursery: Nursery, folder: Path, kills: int, seed: int) -> tuple[int, int]:
    """Kill writers of a new store; every scan of theirs is whole, and it can be gone on with."""
    _store(folder, 1)
    acknowledged, found = kill_at_random(nursery, folder, kills, seed, longest_s=0.6)
    check_whole(folder)
    store = open_store(folder, write=True)
    assert not [event for event in store.events if event.kind in ("lost", "note")]
    assert store.append(tick(found)) == found
    store.close()
    return acknowledged, found


def test_kill_9_loses_nothing_acknowledged(tmp_path: Path, nursery: Nursery) -> None:
    acknowledged, found = _killed_at_random(nursery, tmp_path / "s", kills=5, seed=20261122)
    assert found >= acknowledged >= 1


@pytest.mark.soak
def test_many_kills_lose_nothing_acknowledged(tmp_path: Path, nursery: Nursery) -> None:
    acknowledged, found = _killed_at_random(nursery, tmp_path / "s", kills=200, seed=7)
    print(f"200 kills: {acknowledged} scans acknowledged, {found} found")


FILLER = """
import sys
from pathlib import Path
from configs import StoreError
from tests.storage.ticks import tick
from storage import create_store, open_store
from pipelines import Grid
import numpy as np
from dataclasses import replace
from tests.storage.ticks import surface

grid = Grid(300, 300, 0.01)
folder = Path(sys.argv[1])
store = create_store(folder, site="x", grid=grid)
number = 0
try:
    while number < 500:
        noise = np.random.default_rng(number).normal(0, 1, grid.shape).astype(np.float32)
        store.append(replace(tick(number, baseline=None), scan=replace(surface(number, grid), height=noise)))
        number += 1
except StoreError as error:
    print("refused:", error)
assert number == len(store), (number, len(store))
store.close()
seen = open_store(folder)
assert len(seen) == number > 3, len(seen)
assert seen[-1].scan.time == surface(number - 1).time
(folder.parent / "ballast").unlink()
store = open_store(folder, write=True)
assert store.append(replace(tick(number, baseline=None), scan=surface(number, grid))) == number
store.close()
print("readable and writable again:", len(open_store(folder)))
"""


def test_a_full_disk_refuses_the_scan_and_keeps_the_store(tmp_path: Path) -> None:
    """A tmpfs of 16 MB, in a mount namespace of its own: it is gone with the process."""
    mount = tmp_path / "disk"
    mount.mkdir()
    script = (
        f"mount -t tmpfs -o size=16m tmpfs {mount} && head -c 4000000 /dev/zero > {mount}/ballast && "
        f'exec {sys.executable} -c "$FILLER" {mount}/s'
    )
    if shutil.which("unshare") is None or subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode:
        pytest.skip("mount namespaces are not permitted here: no disk of a known size to fill")
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "FILLER": FILLER, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert "the disk is full" in done.stdout
    assert "readable and writable again" in done.stdout
