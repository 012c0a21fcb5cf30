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
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Timer

import numpy as np
import pytest

from configs import DeviceUnavailable
from monitor.campaign import run_campaign
from monitor.clock import RealClock, seconds_between
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
    """A rig that is unplugged at some slots, and soon after one of them somebody kills the process."""

    def __init__(self, unplugged: set[int], deadly: int | None, dies_after_s: float) -> None:
        super().__init__()
        self.unplugged, self.deadly, self.dies_after_s = unplugged, deadly, dies_after_s

    def capture(self, patterns: object, at: Instant) -> Frames:
        slot = round(float((at - T0) / SLOT))
        if slot == self.deadly:
            Timer(self.dies_after_s, os.kill, (os.getpid(), signal.SIGKILL)).start()
        if slot in self.unplugged:
            raise DeviceUnavailable(DEAD)
        return super().capture(patterns, at)


class Pretended(RealClock):
    """The real clock's rules on pretended seconds: no wait lasts, and once the system's clock is set."""

    def __init__(self, start: Instant, set_at: int | None, set_by_s: float) -> None:
        self.seconds, self.offset = 0.0, float(start.astype(np.int64)) * 1e-9
        self.set_at, self.set_by_s = set_at, set_by_s
        super().__init__(lambda: self.offset + self.seconds, lambda: self.seconds)

    def wait_until(self, moment: Instant, stop: Event) -> None:
        while not stop.is_set() and (left := seconds_between(self.now(), moment)) > 0:
            self.seconds += min(left, 900) + 1e-4
        if self.set_at is not None and moment >= T0 + self.set_at * SLOT:
            self.set_at = None
            self.offset += self.set_by_s


def live(folder: Path, start: int, end: int, given: argparse.Namespace | None = None) -> None:
    """One life of the process: from slot `start` to `end`, unless it is killed before."""
    given = given or arguments(folder, start, end)

    def tell(settled: Settled) -> None:
        slot = round(float((settled.planned - T0) / SLOT))
        print(f"{settled.state} {slot} {settled.number}", flush=True)

    clock = Pretended(T0 + (start - given.behind) * SLOT, given.set_at, given.set_by_s)
    until = str(T0 + end * SLOT)[:19] + "+00:00"
    rig = Unreliable(set(given.unplugged), given.deadly, given.dies_after_s)
    run_campaign(campaign_in(folder, every="6 h", until=until), clock=clock, rig=rig, on_settled=tell, work=work)


def weather(folder: Path, days: int, lives: int, seed: int, start: int = 0) -> None:
    """Live through all of it from a slot on, and look after each life."""
    chance = random.Random(seed)
    slots = 4 * days
    ends = sorted(chance.sample(range(start + 3, slots - 3), lives))
    acknowledged: dict[int, int] = {}
    for deadly in (*ends, None):
        stop_at = deadly if deadly is not None else slots
        command = [sys.executable, "-m", "tests.monitor.test_soak_campaign", str(folder), str(start), str(slots)]
        command += ["--unplugged", *map(str, chance.sample(range(slots), slots // 15))]
        command += ["--behind", str(chance.choice((0, 0, 1, 3)))]  # a computer without a battery for its clock
        if deadly is not None:
            command += ["--deadly", str(deadly), "--dies-after-s", f"{chance.uniform(0, 0.15):.3f}"]
        if stop_at > start + 6 and chance.random() < 0.7:
            hours = chance.choice((15, 1, -1, -15))
            command += ["--set-at", str(chance.randrange(start, stop_at)), f"--set-by-s={3600 * hours}"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
        assert done.returncode in ((0, -signal.SIGKILL) if deadly is not None else (0,)), done.stderr
        for line in done.stdout.splitlines():
            state, slot, number = line.split()
            if state == "taken":
                assert int(slot) not in acknowledged, "a slot was taken twice"
                acknowledged[int(slot)] = int(number)
        start = _look_around(folder, acknowledged)
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


def _look_around(folder: Path, acknowledged: dict[int, int]) -> int:
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
    """A disk that is full from the start, and has room again in the second life; then kills, as above."""
    disk = tmp_path / "disk"
    disk.mkdir()
    script = (
        f"mount -t tmpfs -o size=140m tmpfs {disk} && head -c 137500000 /dev/zero > {disk}/{BALLAST} && "
        f"{sys.executable} -m tests.monitor.test_soak_campaign {disk} 0 60 --on-a-full-disk"
    )
    done = subprocess.run(["unshare", "-m", "sh", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "not taken on the full disk" in done.stdout


def on_a_full_disk(folder: Path) -> None:
    """Fill the disk, make room, and go on to the end of the 72 days with kills."""
    live(folder, 0, 60)
    rows = _rows(folder)
    refused = [slot for slot, (state, _) in rows.items() if state == "failed"]
    assert refused, "the disk never was full"
    assert all("disk" in rows[slot][1] or "not stored" in rows[slot][1] for slot in refused)
    print(f"{len(refused)} slots not taken on the full disk")
    before = len(open_store(folder / "site.icechunk"))
    (folder / BALLAST).unlink()
    weather(folder, days=72, lives=8, seed=9, start=61)
    assert len(open_store(folder / "site.icechunk")) > before + 150


def arguments(*words: object) -> argparse.Namespace:
    """Say what a life brings."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("start", type=int)
    parser.add_argument("end", type=int)
    parser.add_argument("--unplugged", type=int, nargs="*", default=[])
    parser.add_argument("--deadly", type=int)
    parser.add_argument("--dies-after-s", type=float, default=0.0)
    parser.add_argument("--behind", type=int, default=0, help="slots that the system's clock is behind at the start")
    parser.add_argument("--set-at", type=int, help="the slot at which it is set")
    parser.add_argument("--set-by-s", type=float, default=0.0)
    parser.add_argument("--on-a-full-disk", action="store_true", help="the story of the full disk instead")
    return parser.parse_args([str(word) for word in words])


def main(words: Sequence[str]) -> None:
    """One life of the process."""
    given = arguments(*words)
    if given.on_a_full_disk:
        on_a_full_disk(given.folder)
    else:
        live(given.folder, given.start, given.end, given)


if __name__ == "__main__":
    main(sys.argv[1:])
