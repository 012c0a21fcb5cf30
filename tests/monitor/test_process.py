"""Stored scans worked out again: the same numbers to the bit, for any number of workers, and after any kill."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from configs import InputError
from monitor.cli import run_tokens
from monitor.loop import BEGAN, ENDED
from monitor.reprocess import Outcome, process
from monitor.visit import Rules
from pipelines import Event, Tick
from storage import collect, create_store, engine, open_store, snapshots
from tests.monitor.stored import ALARM, GRID, STABLE, UNITS, at, fill, rig

ROOT = Path(__file__).resolve().parents[2]
NOW = np.datetime64("2027-01-01T00:00:00", "ns")
RULES = Rules(GRID, STABLE, None, tuple(UNITS), (ALARM,), settings="as before")
COUNT = 12


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store as a campaign leaves it; frames of scans 4 and 5 were not kept."""
    path = tmp_path_factory.mktemp("made") / "s"
    fill(path, COUNT, without=(4, 5)).close()
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "s")
    return tmp_path / "s"


def contents(path: str | Path, snapshot: str | None = None) -> dict[str, Any]:
    """Give every array of a store, and its events less the notes of processing."""
    store: Any = open_store(path)
    session = store.session if snapshot is None else store._repository.readonly_session(snapshot_id=snapshot)
    root = zarr.open_group(session.store, mode="r")
    found: dict[str, Any] = {}
    for name in ("scans", "change", "metrics", "binned", "calibrations"):
        group: Any = root[name]
        found |= {f"{name}/{each}": array[:] for each, array in group.arrays()}
    if snapshot is None:
        found["events"] = sorted(
            (str(event.time), event.kind, event.text)
            for event in store.events
            if "processed again by" not in event.text
        )
    return found


def same(one: dict[str, Any], other: dict[str, Any], but: tuple[str, ...] = ()) -> None:
    assert one.keys() == other.keys()
    for name in one.keys() - set(but):
        if name == "events":
            assert one[name] == other[name]
        else:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def run(
    path: str | Path, rules: Rules = RULES, workers: int = 1, scheduler: str | None = None, **options: Any
) -> Outcome:
    store = open_store(path, write=True)
    options = {"first": 0, "last": len(store) - 1, "now": NOW, **options}
    try:
        with engine(workers, scheduler) as spread:
            return process(store, rules, spread, **options)
    finally:
        store.close()


@contextmanager
def cluster(count: int = 2) -> Iterator[str]:
    """A scheduler and its workers, each started from the command line."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    started: list[subprocess.Popen[Any]] = []

    def start(*words: str) -> subprocess.Popen[Any]:
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        started.append(
            subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
        )
        return started[-1]

    try:
        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        assert scheduler.stderr is not None
        address = ""
        while "Scheduler at:" not in address:
            address = scheduler.stderr.readline().decode()
            assert address, "the scheduler ended"
        address = address.split("Scheduler at:")[1].strip()
        for _ in range(count):
            start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        from distributed import Client

        with Client(address, timeout=30) as client:
            client.wait_for_workers(count, timeout=60)
        yield address
    finally:
        for each in reversed(started):
            each.terminate()
            each.wait(timeout=30)
            if each.stderr is not None:
                each.stderr.close()


def test_when_monitoring_began_and_ended_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "block.icechunk"
    store = fill(path, 2, without=(0, 1))
    notes = {f"{BEGAN}: microrelief": 0, f"{ENDED}: visits done": 1}
    for text, number in notes.items():
        store.append(Tick(at(number), events=(Event(at(number), "note", text),)))
    store.close()
    run(path)
    with closing(open_store(path)) as again:
        assert notes.keys() <= {event.text for event in again.events}


def test_the_same_recipe_gives_what_the_campaign_gave_to_the_bit(path: Path) -> None:
    before = contents(path)
    outcome = run(path)
    assert outcome.tally == {"from frames": COUNT - 2, "no frames are kept": 2}
    after = contents(path)
    # the two without frames are compared from stored heights, which are rounded to 0.5 um
    numbers = [number for number in range(COUNT) if number not in (4, 5)]
    for name in before.keys() - {"events"}:
        if name.split("/")[0] in ("scans", "change", "metrics"):
            if before[name].shape[:1] == (COUNT,):
                np.testing.assert_array_equal(before[name][numbers], after[name][numbers], err_msg=name)
            if name.startswith("scans/"):
                np.testing.assert_array_equal(before[name], after[name], err_msg=name)
        elif name == "binned/dz_tail":
            np.testing.assert_array_equal(before[name][numbers], after[name][numbers], err_msg=name)
        else:
            np.testing.assert_array_equal(before[name], after[name], err_msg=name)
    assert [event for event in before["events"] if event[1] != "alarm"] == [
        event for event in after["events"] if event[1] != "alarm"
    ]
    assert len(before["events"]) == len(after["events"])


NEW = replace(RULES, metrics=(*UNITS, "lost_volume"), stable=None, settings="new")


def test_two_workers_give_the_same_to_the_bit(path: Path, tmp_path: Path) -> None:
    shutil.copytree(path, tmp_path / "two")
    run(path, NEW, last=6)
    run(tmp_path / "two", NEW, workers=2, last=6)
    same(contents(path), contents(tmp_path / "two"))


@pytest.mark.soak
def test_a_cluster_from_the_command_line_gives_the_same_to_the_bit(path: Path, tmp_path: Path) -> None:
    shutil.copytree(path, tmp_path / "spread")
    run(path, NEW)
    with cluster() as address:
        run(tmp_path / "spread", NEW, scheduler=address)
    same(contents(path), contents(tmp_path / "spread"))


def test_twice_is_as_once(path: Path) -> None:
    first = run(path)
    once = contents(path)
    again = run(path)
    assert again.unchanged
    assert again.snapshot == first.snapshot
    other = run(path, replace(RULES, settings="named otherwise"))
    assert not other.unchanged
    same(once, contents(path))
    assert sum("processed again by" in event.text for event in open_store(path).events) == 2


def test_the_old_results_are_the_newest_until_the_end_and_stay_readable(path: Path) -> None:
    old = contents(path)
    snapshot = open_store(path).about.snapshot
    seen: list[str] = []

    def look(done: int, total: int) -> None:
        assert total == COUNT
        seen.append(open_store(path).about.snapshot)

    outcome = run(path, replace(RULES, alarms=(), stable=None), step=look)
    assert set(seen) == {snapshot}
    assert open_store(path).about.snapshot == outcome.snapshot != snapshot
    del old["events"]
    same(old, contents(path, snapshot))


def test_new_limits_are_replayed(path: Path) -> None:
    strict = ALARM.model_copy(update={"warn_above": 300.0, "alarm_above": 500.0})
    run(path, replace(RULES, alarms=(strict,)))
    store = open_store(path)
    told = [event.text.split(",")[0] for event in store.events if event.kind == "alarm"]
    # the block of 168 mm2 stands 0, 1.2, 2.4, 3.6, 4.8 mm high and begins again
    assert told[:3] == ["block: ok -> warning", "block: warning -> alarm", "block: alarm -> ok"]
    assert [store[number].alarms["block"] for number in range(6)] == ["ok", "ok", "warning", "alarm", "alarm", "ok"]


def test_a_range_leaves_the_rest_but_for_what_hangs_on_it(path: Path) -> None:
    before = contents(path)
    run(path, replace(RULES, alarms=(), stable=None, remove_background=False), first=7, last=8)
    after = contents(path)
    rest = [number for number in range(COUNT) if number not in (7, 8)]
    for name in before.keys() - {
        "events",
        "binned/dz_tail",
        "binned/height_tail",
        "calibrations/id",
        "calibrations/json",
    }:
        if before[name].shape[:1] == (COUNT,):
            np.testing.assert_array_equal(before[name][rest], after[name][rest], err_msg=name)
    # scan 0 is everyone's baseline: made again, all that were compared with it are compared again
    outcome = run(path, RULES, first=0, last=0, calibration=rig(40.0))
    assert outcome.tally == {"from frames": 1, "compared with a new baseline": COUNT - 1}


def test_a_new_calibration_starts_an_epoch_where_frames_are_kept(path: Path) -> None:
    new = rig(40.4)
    run(path, calibration=new)
    store = open_store(path)
    assert {store[number].scan.calibration_id for number in (0, 1, 2, 3, 6, 11)} == {new.id}
    assert [store[number].epoch for number in range(COUNT)] == [0, 0, 0, 0, 1, 1, *[2] * 6]
    assert [store[number].baseline for number in (3, 5, 11)] == [0, 4, 6]
    assert store[4].change is None
    assert store[7].change is not None
    assert store.calibration(new.id).id == new.id
    assert sum(event.kind == "epoch" for event in store.events) == 3


class Cut(Exception):  # noqa: N818 - an event, not an error
    """Somebody pulled the plug."""


def test_work_cut_short_goes_on_where_its_last_commit_stood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("storage.rework.COMMIT_EVERY", 4)
    path = _many(tmp_path / "s", 11)
    shutil.copytree(path, tmp_path / "through")
    rules = Rules(GRID, metrics=tuple(UNITS), settings="x")

    def cut(done: int, total: int) -> None:
        if done == 10:
            raise Cut

    with pytest.raises(Cut):
        run(path, rules, step=cut)
    outcome = run(path, rules)
    assert outcome.resumed_at == 8
    assert sum(outcome.tally.values()) == 11
    assert run(tmp_path / "through", rules).resumed_at is None
    same(contents(path), contents(tmp_path / "through"))


def test_work_cut_short_begins_again_with_other_settings_or_after_another_scan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("storage.rework.COMMIT_EVERY", 4)
    path = _many(tmp_path / "s", 8)
    rules = Rules(GRID, metrics=tuple(UNITS), settings="x")

    def cut(done: int, total: int) -> None:
        if done == 6:
            raise Cut

    with pytest.raises(Cut):
        run(path, rules, step=cut)
    assert run(path, replace(rules, settings="y")).resumed_at is None
    with pytest.raises(Cut):
        run(path, rules, step=cut)
    store = open_store(path, write=True)
    store.append(_tick(8))
    store.close()
    outcome = run(path, rules)
    assert outcome.resumed_at is None
    assert sum(outcome.tally.values()) == 9


def _tick(number: int) -> Any:
    from pipelines import Tick
    from tests.storage.ticks import surface

    scan = replace(surface(number, GRID, ""), time=at(number))
    return Tick(at(number), scan)


def _many(path: Path, count: int) -> Path:
    """A store of scans from elsewhere: heights alone."""
    store = create_store(path, site="x", grid=GRID, metrics=UNITS)
    for number in range(count):
        store.append(_tick(number))
    store.close()
    return path


def test_the_same_on_s3(s3_prefix: str, tmp_path: Path) -> None:
    url, path = f"{s3_prefix}/s", tmp_path / "s"
    fill(url, 4).close()
    fill(path, 4).close()
    before = open_store(url).about.snapshot
    rules = replace(RULES, alarms=(), settings="new")
    outcome, here = run(url, rules), run(path, rules)
    assert outcome.tally == here.tally == {"from frames": 4}
    same(contents(url), contents(path))
    assert open_store(url).about.snapshot == outcome.snapshot != before
    assert len(open_store(url, snapshot=before)) == 4
    assert run(url, rules).unchanged


@pytest.mark.soak
def test_a_cluster_from_the_command_line_reads_s3(s3_prefix: str, tmp_path: Path) -> None:
    fill(f"{s3_prefix}/s", COUNT).close()
    fill(tmp_path / "s", COUNT).close()
    run(tmp_path / "s", NEW)
    with cluster() as address:
        run(f"{s3_prefix}/s", NEW, scheduler=address)
    same(contents(f"{s3_prefix}/s"), contents(tmp_path / "s"))


def test_half_processed_scans_are_shown_to_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither what a torn reference leads to, nor the history after the end, nor what is gone back to."""
    monkeypatch.setattr("storage.rework.COMMIT_EVERY", 2)
    path = _many(tmp_path / "s", 6)
    rules, old, known = Rules(GRID, metrics=tuple(UNITS), settings="x"), contents(path), len(list(snapshots(path)))

    def cut(done: int, total: int) -> None:
        if done == 5:
            raise Cut

    with pytest.raises(Cut):
        run(path, rules, step=cut)
    collect(path, datetime.now(UTC))  # keeps what the work goes on from
    shutil.copytree(path, tmp_path / "torn")
    (tmp_path / "torn" / "refs" / "branch.main" / "ref.json").write_bytes(b"")
    same(old, contents(tmp_path / "torn"), but=("events",))
    outcome = run(path, rules)
    assert outcome.resumed_at == 4
    assert len(list(snapshots(path))) == known + 1
    (path / "snapshots" / outcome.snapshot).write_bytes(b"")
    same(old, contents(path), but=("events",))


def test_coarse_histories_follow_across_a_fold(tmp_path: Path) -> None:
    path = _many(tmp_path / "s", 66)
    run(path, Rules(GRID, metrics=tuple(UNITS), settings="x"), first=62, last=65)
    found = contents(path)
    assert found["binned/dz"].shape[0] == 64
    for number, row in ((62, found["binned/dz"][62]), (63, found["binned/dz"][63]), (65, found["binned/dz_tail"][1])):
        fine = found["change/dz"][number][8:16, 8:16] * 0.0005
        assert row[1, 1] * 0.0005 == pytest.approx(fine.mean(), abs=0.0005)  # both are rounded to 0.5 um
    assert (found["binned/dz"][:62] == np.iinfo(found["binned/dz"].dtype).min).all()


def test_kill_9_and_the_next_run_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _many(tmp_path / "s", 36)
    old = contents(path)
    shutil.copytree(path, tmp_path / "through")
    command = [sys.executable, "-m", "monitor.cli", "process", str(path), "--from", "28"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    running = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    while "processing scans: 4 of 8" not in (line := running.stderr.readline()):
        assert line, "it ended"
    running.send_signal(signal.SIGKILL)
    running.wait()
    running.stderr.close()
    same(old, contents(path))
    assert run_tokens(["process", str(path), "--from", "28"]) == 0
    assert "went on at scan 32" in capsys.readouterr().out
    assert run_tokens(["process", str(tmp_path / "through"), "--from", "28"]) == 0
    same(contents(path), contents(tmp_path / "through"))


def test_the_command_says_what_it_did(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["process", str(path), "--from", "2026-11-23T00:00:00Z", "--to", "5"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("scans 3 to 5 processed again, snapshot ")
    assert [line.strip() for line in told[1:]] == ["1 from frames", "2 no frames are kept"]
    assert run_tokens(["process", str(path), "--from", "3", "--to", "2026-11-23T02:30:00Z"]) == 0
    assert "scans 3 to 5: processed so already, nothing to do" in capsys.readouterr().out


def test_no_scheduler_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("storage.spread.CONNECT_S", 1)
    with pytest.raises(InputError, match="no scheduler answers there"), engine(scheduler="tcp://127.0.0.1:9"):
        pass
