"""Seventy-two simulated days of a six-hourly campaign, killed, unplugged, with its clock set and its disk full.

No committed scan is lost or doubled, every slot that was missed is listed with its cause, and `status` is right after
each blow. The short version runs in the suite, the long one in `make soak`.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from configs import DeviceUnavailable
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from monitor.settled import Settled
from monitor.standing import look
from pipelines import Frames, Instant, instant
from storage import Ledger, ledger_beside, open_store

from .campaigns import BASE, Rig, campaign_in, work

ROOT = Path(__file__).resolve().parents[2]
T0 = instant(BASE)
SLOT = np.timedelta64(6 * 3600 * 10**9, "ns")
DEAD = "the camera does not answer"
BALLAST = "ballast"


class Unreliable(Rig):
    """A rig that is unplugged at some slots, and at some waits for somebody to kill the process."""

    def __init__(self, unplugged: set[int], deadly: int | None) -> None:
        super().__init__()
        self.unplugged, self.deadly = unplugged, deadly

    def capture(self, patterns: object, at: Instant) -> Frames:
        slot = round(float((at - T0) / SLOT))
        if slot == self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        if slot in self.unplugged:
            raise DeviceUnavailable(DEAD)
        return super().capture(patterns, at)


class Jumpy(AcceleratedClock):
    """An accelerated clock that is set forward by two slots, once, when a slot comes."""

    def __init__(self, start: Instant, jumps_at: int | None) -> None:
        super().__init__(start)
        self.jumps_at = jumps_at

    def wait_until(self, moment: Instant, stop: object) -> None:
        super().wait_until(moment, stop)  # type: ignore[arg-type]  # the loop's own flag
        if self.jumps_at is not None and moment >= T0 + self.jumps_at * SLOT:
            self.jumps_at = None
            self.advance(2.5 * 6 * 3600)


def live(folder: Path, start: int, end: int, unplugged: set[int], deadly: int | None, jumps_at: int | None) -> None:
    """One life of the process: from slot `start` to `end`, unless it is killed before."""

    def tell(settled: Settled) -> None:
        slot = round(float((settled.planned - T0) / SLOT))
        print(f"{settled.state} {slot} {settled.number}", flush=True)

    clock = Jumpy(T0 + start * SLOT, jumps_at)
    until = str(T0 + end * SLOT)[:19] + "+00:00"
    campaign = campaign_in(folder, every="6 h", until=until)
    run_campaign(campaign, clock=clock, rig=Unreliable(unplugged, deadly), on_settled=tell, work=work)


def weather(folder: Path, days: int, lives: int, seed: int) -> None:
    """Live through all of it, and look after each life."""
    chance = random.Random(seed)
    slots = 4 * days
    ends = sorted(chance.sample(range(3, slots - 3), lives))
    acknowledged: dict[int, int] = {}
    start = 0
    for deadly in (*ends, None):
        stop_at = deadly if deadly is not None else slots
        unplugged = set(chance.sample(range(slots), slots // 15))
        jumps_at = chance.randrange(start, stop_at) if stop_at > start + 6 and chance.random() < 0.5 else None
        command = [sys.executable, "-m", "tests.monitor.test_soak_campaign", str(folder), str(start), str(slots)]
        command += ["--unplugged", *map(str, unplugged)]
        command += ["--deadly", str(deadly)] if deadly is not None else []
        command += ["--jumps-at", str(jumps_at)] if jumps_at is not None else []
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
        assert done.returncode in ((0, -signal.SIGKILL) if deadly is not None else (0,)), done.stderr
        for line in done.stdout.splitlines():
            state, slot, number = line.split()
            if state == "taken":
                assert int(slot) not in acknowledged, "a slot was taken twice"
                acknowledged[int(slot)] = int(number)
        start = _look_around(folder, acknowledged, slots)
        if start > slots:
            break
        start += chance.randrange(0, 3)  # the machine is off for a while
    rows = _rows(folder)
    assert sorted(rows) == list(range(slots + 1)), "a slot without an end"
    assert all(cause for state, cause in rows.values() if state != "taken"), "an end without a cause"


def _rows(folder: Path) -> dict[int, tuple[str, str]]:
    ledger = Ledger(ledger_beside(folder / "site.icechunk"), write=False)
    rows = ledger.rows()
    ledger.close()
    return {round(float((row.planned - T0) / SLOT)): (row.state, row.cause) for row in rows}


def _look_around(folder: Path, acknowledged: dict[int, int], slots: int) -> int:
    """Compare store, ledger and status with what was acknowledged; give the slot after the newest."""
    store = open_store(folder / "site.icechunk")
    stored = [round(float((store[number].planned - T0) / SLOT)) for number in range(len(store))]
    assert stored == sorted(set(stored)), "a scan twice"
    assert all(stored[number] == slot for slot, number in acknowledged.items()), "an acknowledged scan is lost"
    rows = _rows(folder)
    newest = max(rows)
    now = T0 + newest * SLOT + np.timedelta64(60 * 10**9, "ns")
    standing = look(folder / "site.icechunk", now, campaign_in(folder, every="6 h"))
    assert standing.scans == len(stored)
    assert standing.missed == sum(state == "missed" for state, _ in rows.values())
    assert standing.failed == sum(state == "failed" for state, _ in rows.values())
    assert standing.last is not None
    assert round(float((standing.last - T0) / SLOT)) == stored[-1]
    recent = [rows[slot][0] for slot in sorted(rows)[-28:]]
    bad = any(state in ("missed", "failed") for state in recent)
    assert standing.state == ("degraded" if bad or standing.overdue else "ok"), standing.why
    return newest + 1


def test_six_days_of_weather(tmp_path: Path) -> None:
    weather(tmp_path, days=6, lives=2, seed=1)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_seventy_two_days_of_weather(tmp_path: Path, seed: int) -> None:
    weather(tmp_path, days=72, lives=25, seed=seed)


@pytest.mark.soak
@pytest.mark.skipif(
    shutil.which("unshare") is None or bool(subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode),
    reason="needs leave to mount a small disk",
)
def test_seventy_two_days_on_a_disk_that_fills_and_is_mended(tmp_path: Path) -> None:
    """A disk of 40 MB that is full from the start, and has room again in the second life; kills go on."""
    disk = tmp_path / "disk"
    disk.mkdir()
    script = (
        f"mount -t tmpfs -o size=40m tmpfs {disk} && head -c 37500000 /dev/zero > {disk}/{BALLAST} && "
        f"{sys.executable} -m tests.monitor.test_soak_campaign {disk} 0 60 --weather"
    )
    done = subprocess.run(["unshare", "-m", "sh", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "not taken on the full disk" in done.stdout


def on_a_full_disk(folder: Path) -> None:
    """Fill the disk, make room, and go on to the end of the 72 days with kills."""
    live(folder, 0, 60, set(), None, None)
    rows = _rows(folder)
    refused = [slot for slot, (state, _) in rows.items() if state == "failed"]
    assert refused, "the disk never was full"
    assert all("disk" in rows[slot][1] or "not stored" in rows[slot][1] for slot in refused)
    print(f"{len(refused)} slots not taken on the full disk")
    (folder / BALLAST).unlink()
    before = len(open_store(folder / "site.icechunk"))
    live(folder, 61, 100, set(), None, None)
    assert len(open_store(folder / "site.icechunk")) >= before + 39
    assert sorted(_rows(folder)) == list(range(101))


def main() -> None:
    """One life of the process."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("start", type=int)
    parser.add_argument("end", type=int)
    parser.add_argument("--unplugged", type=int, nargs="*", default=[])
    parser.add_argument("--deadly", type=int)
    parser.add_argument("--jumps-at", type=int)
    parser.add_argument("--weather", action="store_true", help="the story of the full disk instead")
    given = parser.parse_args()
    if given.weather:
        on_a_full_disk(given.folder)
    else:
        live(given.folder, given.start, given.end, set(given.unplugged), given.deadly, given.jumps_at)


if __name__ == "__main__":
    main()
