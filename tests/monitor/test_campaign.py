"""A campaign with the real store and ledger: restarts, stops and kills lose nothing and double nothing."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from configs import InputError, StoreError
from monitor.campaign import run_campaign
from monitor.campaign_store import create
from monitor.clock import AcceleratedClock
from monitor.loop import BEGAN, ENDED
from monitor.settled import Settled
from monitor.standing import look
from pipelines import Calibration, PatternSet, instant
from storage import Ledger, ledger_beside, open_store
from storage.ledger import INTERRUPTED

from .campaigns import BASE, Rig, campaign_in, work

ROOT = Path(__file__).resolve().parents[2]
T0 = instant(BASE)
Start = Callable[..., subprocess.Popen[str]]
HOUR = np.timedelta64(3600 * 10**9, "ns")


def go(folder: Path, visits: int | None = None, *, at_h: float = 0, **options: object) -> list[Settled]:
    told: list[Settled] = []
    clock = AcceleratedClock(T0 + np.timedelta64(round(at_h * 3600), "s"))
    until = str(options.pop("until", None) or "") or None
    campaign = campaign_in(folder, until=until)
    run_campaign(campaign, clock=clock, rig=Rig(), on_settled=told.append, max_scans=visits, work=work)
    return told


def states(folder: Path) -> dict[int, str]:
    ledger = Ledger(ledger_beside(folder / "site.icechunk"), write=False)
    rows = ledger.rows()
    ledger.close()
    return {int((row.planned - T0) / HOUR): row.state for row in rows}


def planned_hours(folder: Path) -> list[int]:
    store = open_store(folder / "site.icechunk")
    return [int((store[number].planned - T0) / HOUR) for number in range(len(store))]


def test_of_two_that_begin_at_once_the_second_says_so(tmp_path: Path) -> None:
    campaign, patterns = campaign_in(tmp_path), PatternSet("gray", (16, 16), bits=(2, 2))
    calibration = Calibration.from_json((tmp_path / "calibration.json").read_text(encoding="utf-8"))
    first = create(campaign, calibration, patterns, "")
    with pytest.raises(StoreError, match="another process began this campaign a moment ago"):
        create(campaign, calibration, patterns, "")
    first.close()


def test_a_restart_goes_on_with_the_next_slot_and_the_same_store(tmp_path: Path) -> None:
    go(tmp_path, 3)
    go(tmp_path, 2, at_h=2.5)
    assert planned_hours(tmp_path) == [0, 1, 2, 3, 4]
    assert set(states(tmp_path).values()) == {"taken"}


def test_the_grid_of_a_campaign_without_start_is_remembered(tmp_path: Path) -> None:
    campaign = campaign_in(tmp_path, start=None)
    for begin_min in (7, 7 + 95):
        clock = AcceleratedClock(T0 + np.timedelta64(begin_min * 60, "s"))
        run_campaign(campaign, clock=clock, rig=Rig(), max_scans=1, work=work)
    ledger = Ledger(ledger_beside(campaign.store.path), write=False)
    minutes = [int((row.planned - T0) / np.timedelta64(60, "s")) for row in ledger.rows()]
    ledger.close()
    assert minutes == [7, 67, 127], "67 was missed, and 127 is on the grid of the first run"


def test_slots_of_the_time_when_nothing_ran_are_missed_with_their_cause(tmp_path: Path) -> None:
    go(tmp_path, 2)
    go(tmp_path, 1, at_h=5.5)
    assert states(tmp_path) == {0: "taken", 1: "taken", 2: "missed", 3: "missed", 4: "missed", 5: "missed", 6: "taken"}
    texts = [event.text for event in open_store(tmp_path / "site.icechunk").events if event.kind == "missed"]
    assert len(texts) == 1
    assert "missed 4 slots" in texts[0]
    assert "not running" in texts[0]


def test_the_store_notes_that_monitoring_began_and_ended(tmp_path: Path) -> None:
    go(tmp_path, 1)
    notes = [event.text for event in open_store(tmp_path / "site.icechunk").events if event.kind == "note"]
    assert [note.split(":")[0] for note in notes] == [BEGAN, ENDED]


def test_a_kill_between_commit_and_ledger_gives_no_second_scan(tmp_path: Path) -> None:
    go(tmp_path, 3)
    file = ledger_beside(tmp_path / "site.icechunk")
    import sqlite3

    with sqlite3.connect(file.file) as data:  # what the disk holds after such a kill
        data.execute("UPDATE slots SET state = 'planned', scan = NULL WHERE planned = (SELECT max(planned) FROM slots)")
    data.close()
    go(tmp_path, 1, at_h=2.1)
    assert planned_hours(tmp_path) == [0, 1, 2, 3]
    assert set(states(tmp_path).values()) == {"taken"}


def test_a_kill_during_a_scan_is_recorded_as_missed(tmp_path: Path) -> None:
    go(tmp_path, 2)
    where = ledger_beside(tmp_path / "site.icechunk")
    ledger = Ledger(where)
    ledger.plan(T0 + 2 * HOUR)
    store = open_store(tmp_path / "site.icechunk", write=True)
    ledger.reconcile(store)
    row = ledger.last()
    assert row is not None
    assert (row.state, row.cause) == ("missed", INTERRUPTED)
    assert INTERRUPTED in store.events[-1].text
    ledger.close()
    store.close()


def test_a_store_of_another_pitch_is_refused(tmp_path: Path) -> None:
    go(tmp_path, 1)
    campaign = campaign_in(tmp_path)
    other = campaign.model_copy(update={"grid": campaign.grid.model_copy(update={"pitch_mm": 0.2})})
    with pytest.raises(InputError, match=r"grid\.pitch_mm is 0\.2, but the store .* has cells of 0\.1 mm"):
        run_campaign(other, clock=AcceleratedClock(T0), rig=Rig(), work=work)


def test_a_missing_calibration_names_the_command_that_makes_it(tmp_path: Path) -> None:
    campaign = campaign_in(tmp_path)
    (tmp_path / "calibration.json").unlink()
    with pytest.raises(InputError, match="microrelief calibrate POSE_DIR"):
        run_campaign(campaign, clock=AcceleratedClock(T0), rig=Rig(), work=work)


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    go(tmp_path, 1)
    writer = open_store(tmp_path / "site.icechunk", write=True)
    try:
        with pytest.raises(StoreError, match="another writer holds this store"):
            go(tmp_path, 1)
    finally:
        writer.close()


def test_a_scan_now_is_one_visit_and_moves_no_slot(tmp_path: Path) -> None:
    go(tmp_path, 2)
    clock = AcceleratedClock(T0 + np.timedelta64(100 * 60, "s"))
    outcome = run_campaign(campaign_in(tmp_path), clock=clock, rig=Rig(), work=work, now=True)
    assert (outcome.taken, len(outcome.lags_s)) == (1, 1)
    go(tmp_path, 1, at_h=1.8)
    assert len(open_store(tmp_path / "site.icechunk")) == 4
    ledger = Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)
    minutes = [int((row.planned - T0) / np.timedelta64(60, "s")) for row in ledger.rows()]
    ledger.close()
    assert minutes == [0, 60, 100, 120]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start campaigns in processes of their own; none outlives its test."""
    started: list[subprocess.Popen[str]] = []

    def begin(folder: Path, *options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "tests.monitor.campaigns", str(folder), *options]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], word: str) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if word in line:
            return line
    raise AssertionError(f"it ended before saying {word!r}: {process.stderr.read() if process.stderr else ''}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_scan_under_way(start: Start, tmp_path: Path, number: signal.Signals) -> None:
    process = start(tmp_path, "--scan-s", "0.3", "--hours", "10000")
    read_until(process, "committed scan 1")
    time.sleep(0.05)
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, err
    assert "stopping after the scan under way" in err
    assert "stopped True" in out
    assert planned_hours(tmp_path) == list(states(tmp_path))
    assert set(states(tmp_path).values()) == {"taken"}


def test_a_signal_while_waiting_stops_at_once(start: Start, tmp_path: Path) -> None:
    process = start(tmp_path, "--real")
    read_until(process, "committed scan 0")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10)
    assert process.returncode == 0


def test_a_second_signal_stops_in_the_middle(start: Start, tmp_path: Path) -> None:
    process = start(tmp_path, "--scan-s", "20")
    read_until(process, "capturing")
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    assert "once more stops at once" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10)
    assert process.returncode != 0
    assert states(tmp_path) == {0: "planned"}, "the next start settles it as missed"


def kill_and_resume(start: Start, folder: Path, kills: int, chance: random.Random, spread_s: float = 0.6) -> None:
    """Kill at random, start again; then everything that was acknowledged is there once, and every slot has an end."""
    acknowledged: set[int] = set()
    hours = round(33 * spread_s) * (kills + 1)  # at 0.03 s and more each, some are left at the last kill
    for _ in range(kills):
        process = start(folder, "--hours", str(hours), "--scan-s", "0.03")
        acknowledged.add(int(read_until(process, "committed scan").split()[-1]))
        time.sleep(chance.uniform(0, spread_s))
        os.kill(process.pid, signal.SIGKILL)
        out, _ = process.communicate()
        acknowledged.update(int(line.split()[-1]) for line in out.splitlines() if line.startswith("committed scan"))
    process = start(folder, "--hours", str(hours))
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    acknowledged.update(int(line.split()[-1]) for line in out.splitlines() if line.startswith("committed scan"))
    stored, settled = planned_hours(folder), states(folder)
    assert stored == sorted(set(stored)), "a slot has two scans"
    assert acknowledged <= set(stored), "an acknowledged scan is lost"
    assert sorted(settled) == list(range(hours + 1)), "a slot has no row"
    assert [hour for hour, state in settled.items() if state == "taken"] == stored
    assert set(settled.values()) <= {"taken", "missed"}
    assert sum(state == "missed" for state in settled.values()) <= kills
    store = open_store(folder / "site.icechunk")
    for number in (0, len(store) // 2, len(store) - 1):
        hour = stored[number]
        assert abs(float(store[number].scan.height[0, 0]) - hour % 1000 / 1000) < 0.0006


def test_kill_9_loses_nothing_and_doubles_nothing(start: Start, tmp_path: Path) -> None:
    kill_and_resume(start, tmp_path, 2, random.Random(1), spread_s=0.2)


def test_kill_9_in_a_campaign_of_the_simulated_rig(start: Start, tmp_path: Path) -> None:
    process = start(tmp_path, "--simulated", "--hours", "4")
    read_until(process, "committed scan 1")
    time.sleep(0.1)  # in the middle of the third
    process.kill()
    process.communicate()
    process = start(tmp_path, "--simulated", "--hours", "4")
    _, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert sorted(states(tmp_path)) == [0, 1, 2, 3, 4]
    stored = planned_hours(tmp_path)
    assert stored == [hour for hour, state in states(tmp_path).items() if state == "taken"]
    assert {0, 1} <= set(stored)
    assert len(stored) >= 4
    series = open_store(tmp_path / "site.icechunk").series()
    assert list(series["scan"]) == list(range(len(stored)))
    assert series["net_volume"].notna().tolist() == [False] + [True] * (len(stored) - 1)
    lifted = series["gained_volume"].to_numpy()[1:]
    assert (np.diff(lifted) > 0.1).all(), f"the soil goes on drying where it was, it is not wet again: {lifted}"


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(5))
def test_many_kills(start: Start, tmp_path: Path, seed: int) -> None:
    kill_and_resume(start, tmp_path, 20, random.Random(seed))


def test_a_place_below_a_file_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("not a folder")
    campaign = campaign_in(tmp_path)
    below = campaign.store.model_copy(update={"path": tmp_path / "note.txt" / "site.icechunk"})
    stages: list[str] = []
    with pytest.raises(InputError, match=r"note\.txt is a file, not a folder"):
        run_campaign(campaign.model_copy(update={"store": below}), clock=AcceleratedClock(T0), on_stage=stages.append)
    assert stages == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_that_may_not_be_written_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir(mode=0o500)
    campaign = campaign_in(tmp_path)
    for path, said in (("mine/site.icechunk", "may not write into"), ("mine/new/site.icechunk", "cannot be made")):
        there = campaign.model_copy(update={"store": campaign.store.model_copy(update={"path": tmp_path / path})})
        with pytest.raises(InputError, match=said):
            run_campaign(there, clock=AcceleratedClock(T0))


@pytest.mark.parametrize("pitch_mm", [20.0, 0.0002])
def test_a_pitch_in_another_unit_is_refused_with_what_the_camera_sees(pitch_mm: float, tmp_path: Path) -> None:
    campaign = campaign_in(tmp_path)
    wrong = campaign.model_copy(update={"grid": campaign.grid.model_copy(update={"pitch_mm": pitch_mm})})
    with pytest.raises(InputError, match=r"grid\.pitch_mm is .*a camera pixel is about .* mm wide"):
        run_campaign(wrong, clock=AcceleratedClock(T0), rig=Rig(), work=work, max_scans=1)


def test_a_region_off_the_grid_is_refused_with_what_the_grid_covers(tmp_path: Path) -> None:
    far = campaign_in(tmp_path).model_copy(update={"region_mm": ((50.0, 50.0), (60.0, 50.0), (60.0, 60.0))})
    with pytest.raises(InputError, match="region_mm holds no cell: the height map reaches from"):
        run_campaign(far, clock=AcceleratedClock(T0), rig=Rig(), work=work, max_scans=1)


def test_a_store_that_lost_scans_is_degraded(tmp_path: Path) -> None:
    go(tmp_path, 3)
    path = tmp_path / "site.icechunk"
    newest = max((path / "snapshots").iterdir(), key=lambda file: file.stat().st_mtime_ns)
    newest.write_bytes(b"")  # as a power cut may leave it
    standing = look(path, T0 + 3 * HOUR, campaign_in(tmp_path))
    assert standing.state == "degraded"
    assert "what came after is lost" in standing.why
