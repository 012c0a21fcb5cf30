"""Stores that are damaged, foreign, newer or not to be touched: one clear line, nothing made worse."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import icechunk
import pytest
import zarr

from configs import StoreError
from monitor.cli import run_tokens
from storage import create_store, open_store
from storage.layout import SCHEMA

from ..storage.test_verification import GRID, hashes, made
from ..storage.ticks import failure

NOBODY = 65534


@pytest.fixture
def here() -> Iterator[Path]:
    """A folder that another user may enter."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    for path in folder.rglob("*"):
        if path.is_dir():
            path.chmod(0o755)
    shutil.rmtree(folder)


@contextmanager
def as_somebody_else() -> Iterator[None]:
    """Root may do anything: be nobody for a while. Others are refused by the mode alone."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def _corrupt_chunk(path: Path) -> None:
    for file in sorted((path / "chunks").iterdir(), key=lambda each: each.stat().st_mtime_ns)[:3]:
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)


def _cut_manifests(path: Path) -> None:
    for file in (path / "manifests").iterdir():
        file.write_bytes(file.read_bytes()[:40])


def _newer_schema(path: Path) -> None:
    repository = icechunk.Repository.open(icechunk.local_filesystem_storage(str(path)))
    session = repository.writable_session("main")
    zarr.open_group(session.store).attrs["microrelief_schema"] = SCHEMA + 1
    session.commit("newer")


def _foreign(path: Path) -> None:
    shutil.rmtree(path)
    repository = icechunk.Repository.create(icechunk.local_filesystem_storage(str(path)))
    session = repository.writable_session("main")
    zarr.create_group(session.store, attributes={"title": "somebody else's"})
    session.commit("made")


def _photographs(path: Path) -> None:
    shutil.rmtree(path)
    path.mkdir()
    (path / "IMG_1.JPG").write_bytes(b"\xff\xd8")


NEWER = f"schema {SCHEMA + 1} was made by a newer microrelief .this one reads {SCHEMA}.: update it"
BAD = [
    # what is done to the store, command, exit code, words that must appear
    (_corrupt_chunk, "report {s} --out {o}", 1, "scan 0 cannot be read: .*checksum"),
    (_corrupt_chunk, "store copy {s} {o}", 1, "cannot be read: .*checksum.*`microrelief verify` says more"),
    (_cut_manifests, "status {s}", 1, "no snapshot holds a whole store"),
    (_cut_manifests, "verify {s}", 1, "no snapshot holds a whole store"),
    (_cut_manifests, "report {s} --out {o}", 1, "no snapshot holds a whole store"),
    (_newer_schema, "status {s}", 1, NEWER),
    (_newer_schema, "verify {s}", 1, NEWER),
    (_newer_schema, "store stat {s}", 1, NEWER),
    (_foreign, "status {s}", 1, "is an Icechunk repository, but not a microrelief store"),
    (_foreign, "verify {s}", 1, "is an Icechunk repository, but not a microrelief store"),
    (_photographs, "verify {s}", 1, "is no store"),
    (_photographs, "store compact {s}", 1, "is no store"),
]


@pytest.mark.parametrize(("damage", "line", "code", "told"), BAD, ids=[f"{r[0].__name__[1:]}, {r[1][:9]}" for r in BAD])
def test_one_clear_line_and_nothing_made_worse(
    here: Path, capfd: pytest.CaptureFixture[str], damage: Callable[[Path], None], line: str, code: int, told: str
) -> None:
    path = made(here)
    damage(path)
    before = hashes(here)
    capfd.readouterr()
    assert run_tokens(line.format(s=path, o=here / "out").split()) == code
    said = [text for text in capfd.readouterr().err.splitlines() if not re.match(r"[a-z ]+: \d+ of \d+$", text)]
    assert len(said) == 1, said
    assert re.search(told, said[0]), said
    assert str(path) in said[0]
    assert hashes(here) == before


@pytest.mark.parametrize(
    "command", ["status {s}", "verify {s}", "store stat {s}", "report {s} --out {o}", "store gc {s}"]
)
def test_no_right_to_look(here: Path, capfd: pytest.CaptureFixture[str], command: str) -> None:
    path = made(here / "closed")
    (here / "closed").chmod(0o000)
    with as_somebody_else():
        code = run_tokens(command.format(s=path, o=here / "out").split())
    said = capfd.readouterr().err.splitlines()
    assert (code, len(said)) == (1, 1), said
    assert f"{path}: cannot be read: Permission denied" in said[0]


def test_a_read_only_store_is_read_and_not_written(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = made(here / "shelf")
    before = hashes(here / "shelf")
    for folder in [here / "shelf", *(each for each in path.rglob("*") if each.is_dir()), path]:
        folder.chmod(0o555)
    for file in (each for each in (here / "shelf").rglob("*") if each.is_file()):
        file.chmod(0o444)
    with as_somebody_else():
        assert run_tokens(["status", str(path)]) in (0, 4)
        assert run_tokens(["verify", str(path)]) == 0
        assert run_tokens(["store", "stat", str(path)]) == 0
        said = [line for line in capfd.readouterr().err.splitlines() if not re.fullmatch(r"[a-z ]+: \d+ of \d+", line)]
        assert said == []
        for line in (["store", "compact", str(path)], ["store", "expire", str(path)]):
            assert run_tokens(line) == 1
            said = capfd.readouterr().err.splitlines()
            assert len(said) == 1
            assert "cannot be opened for writing: Permission denied" in said[0]
        with pytest.raises(StoreError, match="cannot be opened for writing: Permission denied"):
            open_store(path, write=True)
        with pytest.raises(StoreError, match="cannot be made: Permission denied"):
            create_store(here / "shelf" / "other", site="x", grid=GRID)
    assert hashes(here / "shelf") == before


def test_a_disk_that_turns_read_only_costs_the_tick_and_no_more(here: Path) -> None:
    path = made(here)
    store = open_store(path, write=True)
    before = hashes(here)
    for folder in path.iterdir():
        if folder.is_dir():
            folder.chmod(0o555)
    with as_somebody_else(), pytest.raises(StoreError, match="was not stored"):
        store.append(failure(9))
    for folder in path.iterdir():
        if folder.is_dir():
            folder.chmod(0o755)
    assert hashes(here) == before
    store.append(failure(9))
    store.close()
    assert open_store(path).events[-1] == failure(9).events[0]
