"""`verify` names each kind of damage where it is, changes nothing, and finds nothing in a store that is whole."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from configs import StoreError
from monitor.cli import run_tokens
from pipelines import Grid, Tick
from storage import Ledger, create_store, ledger_beside, open_store, verify
from storage.icechunk_store import IcechunkStore

from .ticks import METRICS, at, calibration, change_of, failure, surface, tick

GRID = Grid(40, 60, 0.05)
"""Its cells do not fit into a manifest: a scan has chunk files."""


def made(folder: Path, scans: int = 5) -> Path:
    """Make a store of scans with changes, a failure and a ledger."""
    store = create_store(folder / "s", site="x", grid=GRID, metrics=METRICS)
    ledger = Ledger(ledger_beside(folder / "s"))
    kept, first = calibration(), surface(0, GRID, calibration().id)
    for number in range(scans):
        scan = surface(number, GRID, kept.id)
        change = change_of(scan, first) if number else None
        given = Tick(at(number), scan, change, dict(tick(1).metrics) if number else {}, calibration=kept)
        ledger.settle(at(number), "taken", scan=store.append(given))
    store.append(failure(scans))
    store.close()
    ledger.close()
    return folder / "s"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("whole")).parent


@pytest.fixture
def path(tmp_path: Path, whole: Path) -> Path:
    """A copy of a whole store and its ledger."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    return tmp_path / "s"


def hashes(folder: Path) -> dict[str, str]:
    """Give the content of every file beneath a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("ledger.sqlite-"))
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def chunks_of(path: Path, number: int) -> list[Path]:
    """Give the chunk files that scan `number` brought, by when they were written."""
    files = sorted((path / "chunks").iterdir(), key=lambda file: file.stat().st_mtime_ns)
    each = len(files) // len(open_store(path))
    return files[number * each : (number + 1) * each]


def test_a_whole_store_has_nothing_wrong_with_it(
    tmp_path: Path, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = hashes(tmp_path)
    verified = verify(path)
    assert verified.findings == ()
    assert (verified.scans, verified.snapshots) == (5, 8)
    assert run_tokens(["verify", str(path)]) == 0
    assert "ok: 5 scans, 8 snapshots" in capsys.readouterr().out
    assert hashes(tmp_path) == before


def _turn_a_bit(path: Path) -> None:
    victim = max(chunks_of(path, 1), key=lambda file: file.stat().st_size)
    content = bytearray(victim.read_bytes())
    content[len(content) // 2] ^= 4
    victim.write_bytes(content)


def _remove_a_chunk(path: Path) -> None:
    chunks_of(path, 1)[0].unlink()


def _cut_a_chunk(path: Path) -> None:
    victim = chunks_of(path, 1)[0]
    victim.write_bytes(victim.read_bytes()[:-7])


def _edit(change: Callable[[zarr.Group], None]) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        store = open_store(path)
        assert isinstance(store, IcechunkStore)
        session = store.repository.writable_session("main")
        change(zarr.open_group(session.store, mode="r+"))
        session.commit("edited")

    return edit


def _set(name: str, index: Any, value: Any) -> Callable[[Path], None]:
    def change(root: zarr.Group) -> None:
        array = root[name]
        assert isinstance(array, zarr.Array)
        array[index] = value

    return _edit(change)


def _attribute(name: str, key: str, value: Any) -> Callable[[Path], None]:
    return _edit(lambda root: root[name].attrs.__setitem__(key, value))


def _orphan(path: Path) -> None:
    (path / "chunks" / "ABCDEFGHJKMNPQRSTVWX").write_bytes(b"left by an interrupted commit")


def _older_manifest(path: Path) -> None:
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    newest, *older = list(store.repository.ancestry(branch="main"))
    needed = {manifest.id for manifest in newest.manifests}
    victim = next(m.id for s in older for m in s.manifests if m.id not in needed)
    (path / "manifests" / victim).write_bytes(b"")


def _ledger_row(path: Path) -> None:
    ledger = Ledger(ledger_beside(path))
    ledger.settle(at(9), "taken", scan=9)
    ledger.close()


DAMAGE: list[tuple[str, Callable[[Path], None], str, str]] = [
    ("a bit turned", _turn_a_bit, "damaged", r"time 1: its checksum does not match"),
    ("a chunk gone", _remove_a_chunk, "damaged", r"(scans|change)/\w+, time 1: .*not found"),
    ("a chunk cut", _cut_a_chunk, "damaged", r"(scans|change)/\w+, time 1: its checksum"),
    ("times swapped", _set("scans/time", 3, 7), "damaged", "scans/time, scan 3: is not newer than scan 2"),
    ("a number wrong", _set("scans/scan", 2, 9), "damaged", "scans/scan, scan 2: is numbered 9"),
    ("a baseline wrong", _set("scans/baseline", 2, 4), "damaged", "scans/baseline, scan 2: baseline 4"),
    ("a change of another", _set("change/baseline_time", 2, 5), "damaged", "change/baseline_time, scan 2"),
    ("a unit changed", _attribute("scans/height", "units", "m"), "damaged", "scans/height: its unit is 'm', not 'mm'"),
    ("a scale changed", _attribute("change/dz", "scale_factor", 1.0), "damaged", "change/dz: its scale_factor is 1.0"),
    ("a sigma missing", _set("scans/sigma", (2, 9, 9), np.nan), "damaged", "scans/sigma, scan 2: 1 cells"),
    ("heights edited", _set("scans/height", (2, slice(9, 14)), 900), "damaged", "binned/height, scan 2: differs"),
    ("a calibration edited", _set("calibrations/id", 0, "other"), "damaged", "calibrations, other: its content has"),
    ("an orphan", _orphan, "note", r"files: 1 files, .* that no snapshot needs; `microrelief store gc`"),
    ("an older manifest gone", _older_manifest, "damaged", r"history: \d+ of 8 miss files"),
    ("a ledger ahead", _ledger_row, "damaged", "ledger: scan 9 of .* is not stored"),
]


@pytest.mark.parametrize(("what", "damage", "level", "told"), DAMAGE, ids=[row[0] for row in DAMAGE])
def test_damage_is_named(
    tmp_path: Path,
    path: Path,
    capsys: pytest.CaptureFixture[str],
    what: str,
    damage: Callable[[Path], None],
    level: str,
    told: str,
) -> None:
    damage(path)
    before = hashes(tmp_path)
    assert run_tokens(["verify", str(path)]) == (1 if level == "damaged" else 0)
    lines = capsys.readouterr().out.splitlines()
    assert hashes(tmp_path) == before, "nothing is made worse"
    named = [line for line in lines[:-1] if re.search(told, line)]
    assert len(named) == 1, lines
    assert named[0].startswith(f"{level}: ")
    assert "; " in named[0], "what to do"
    assert len(lines) <= 5, lines


def test_a_lost_snapshot_is_named_and_a_store_of_nothing_is_refused(
    tmp_path: Path, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    newest = max((path / "snapshots").iterdir(), key=lambda file: file.stat().st_mtime_ns)
    newest.write_bytes(b"")
    before = hashes(tmp_path)
    assert run_tokens(["verify", str(path)]) == 1
    assert "cannot be read" in capsys.readouterr().out
    assert hashes(tmp_path) == before
    for file in (path / "snapshots").iterdir():
        file.write_bytes(b"")
    with pytest.raises(StoreError, match="no snapshot holds a whole store"):
        verify(path)


def test_a_small_height_is_checked_too(tmp_path: Path) -> None:
    store = create_store(tmp_path / "s", site="x", grid=Grid(3, 5, 1.0))
    store.append(replace(tick(0), scan=surface(0, Grid(3, 5, 1.0))))
    store.close()
    assert verify(tmp_path / "s").findings == ()
