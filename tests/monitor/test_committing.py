"""Commits in groups, and disks that are full or nearly so: what is acknowledged is durable, what is refused is told."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from threading import Event as Flag

import numpy as np
import pytest

from configs import Campaign
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from monitor.loop import ROOM_AGAIN, Loop, one_after_another
from monitor.scheduler import IntervalSlots
from monitor.settled import Settled
from monitor.standing import look
from monitor.visit import Epoch, Recipe, Yield
from pipelines import Change, Event, Frames, Instant, Motion, Tick, as_datetime, instant
from storage import Ledger, LedgerWriteError, ledger_beside, open_store
from storage.ledger import INTERRUPTED

from . import campaigns
from .stand_ins import RECIPE, T0, FakeLedger, FakeRig, FakeStore, after, whole, work

ROOT = Path(__file__).resolve().parents[2]
NAMESPACES = (
    shutil.which("unshare") is not None
    and not subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode
)


@whole
def compared(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """As `work`, with a change where there is a baseline: such scans wait for their group."""
    given = work(frames, recipe, epoch, planned)
    return given if epoch is None else replace(given, tick=_with_change(given, epoch))


def _with_change(given: Yield, epoch: Epoch) -> Tick:
    scan = given.tick.scan
    assert scan is not None
    flat = np.zeros(scan.grid.shape, np.float32)
    return replace(given.tick, change=Change(scan.grid, epoch.baseline.time, flat, flat, Motion.none()))


class Video:
    """A loop at 1 Hz that commits in groups."""

    def __init__(
        self,
        every_s: float,
        rig: Callable[[int], None] = lambda number: None,
        store: Callable[[int], None] = lambda number: None,
        room: Callable[[], str] = lambda: "",
        seconds: float = 9.5,
    ) -> None:
        self.clock, self.store, self.ledger = AcceleratedClock(T0), FakeStore(store), FakeLedger()
        self.told: list[Settled] = []
        self.durable_when_told: list[int] = []
        self.loop = Loop(
            IntervalSlots(T0, timedelta(seconds=1), as_datetime(after(seconds))),
            lambda slot: 0.5,
            RECIPE,
            FakeRig(rig),
            self.store,  # type: ignore[arg-type]  # a stand-in keeps less than a store
            self.ledger,
            self.clock,
            T0 - np.timedelta64(1, "ns"),
            self._tell,
            stop=Flag(),
            work=compared,
            room=room,
            commit_every_s=every_s,
        )

    def _tell(self, settled: Settled) -> None:
        self.told.append(settled)
        self.durable_when_told.append(len(self.store))


def test_video_commits_in_groups_and_acknowledges_only_what_is_durable() -> None:
    video = Video(3.0)
    outcome = video.loop.run()
    assert (outcome.taken, outcome.missed) == (10, 0)
    assert video.store.groups == [4, 4], "the first scan, a baseline, and the last, alone, are commits of their own"
    assert [settled.number for settled in video.told] == list(range(10))
    assert video.durable_when_told == [1, 5, 5, 5, 5, 9, 9, 9, 9, 10]
    assert all(settled.took_s <= 3.0 for settled in video.told)
    assert set(video.ledger.states()) == {"taken"}


def test_a_group_is_not_kept_longer_than_it_says_where_slots_are_far_apart() -> None:
    video = Video(0.5)
    video.loop.run()
    assert video.store.groups == []
    assert video.durable_when_told == list(range(1, 11))


def test_one_bad_scan_does_not_cost_its_group() -> None:
    def refuse(number: int) -> None:
        if number in (3, 6):  # refused with its group, and again alone
            raise ValueError("17 mm does not fit")

    video = Video(3.0, store=refuse)
    outcome = video.loop.run()
    assert (outcome.taken, outcome.failed) == (9, 1)
    failed = next(settled for settled in video.told if settled.state == "failed")
    assert failed.cause == "not stored: 17 mm does not fit"
    assert [event for event in video.store.events if "17 mm" in event] == [
        "failed: 1 not stored, 2026-01-01T00:00:03Z: 17 mm does not fit"
    ]


def test_what_a_full_disk_refused_is_told_once_there_is_room(monkeypatch: pytest.MonkeyPatch) -> None:
    full = [False]

    def refuse(number: int) -> None:
        if full[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def rig(number: int) -> None:
        full[0] = 3 <= number < 6

    video = Video(0.0, rig=rig, store=refuse)
    settle = FakeLedger.settle

    def write(self: FakeLedger, planned: Instant, *rest: object, **options: object) -> None:
        if full[0]:
            raise LedgerWriteError("ledger.sqlite: the ledger was not written: database or disk is full")
        settle(self, planned, *rest, **options)  # type: ignore[arg-type]  # passed on

    monkeypatch.setattr(FakeLedger, "settle", write)
    outcome = video.loop.run()
    assert (outcome.taken, outcome.failed) == (7, 3)
    assert video.ledger.states() == ["taken"] * 3 + ["failed"] * 3 + ["taken"] * 4, "the rows that were owed are there"
    assert video.store.events == [
        "failed: 3 not stored, 2026-01-01T00:00:03Z to 2026-01-01T00:00:05Z: [Errno 28] No space left on device"
    ]


def test_no_scan_is_taken_into_the_reserve_and_that_is_said_once() -> None:
    free = iter([True, True, False, False, False, True] + [True] * 9)
    video = Video(0.0, room=lambda: "" if next(free) else "disk almost full")
    outcome = video.loop.run()
    assert (outcome.taken, outcome.failed) == (7, 3)
    assert video.ledger.states() == ["taken"] * 2 + ["failed"] * 3 + ["taken"] * 5
    events = [event for tick in video.store.ticks for event in tick.events]
    assert [event.text for event in events if event.kind == "failed"] == ["disk almost full"]
    assert Event(after(5), "note", ROOM_AGAIN) in events


class PowerCut(BaseException):
    """Ends the process, as far as a test can."""


def _video_in(folder: Path, every_s: float) -> Campaign:
    campaign = campaigns.campaign_in(folder)
    schedule = {"video": {"rate_hz": 1.0, "for": "20 s", "commit_every_s": every_s}}
    return Campaign.model_validate(
        campaign.model_dump(mode="json", by_alias=True, exclude_unset=True) | {"schedule": schedule}
    )


@whole
def _with_real_change(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    given = campaigns.work(frames, recipe, epoch, planned)
    return given if epoch is None else replace(given, tick=_with_change(given, epoch))


def test_a_crash_loses_at_most_the_last_group_and_the_ledger_says_which(tmp_path: Path) -> None:
    campaign, told = _video_in(tmp_path, 4.0), list[Settled]()
    clock = AcceleratedClock(instant(campaigns.BASE))

    class Rig(campaigns.Rig):
        taken = 0

        def capture(self, patterns: object, at: Instant) -> Frames:
            self.taken += 1
            if self.taken == 10:
                raise PowerCut
            return super().capture(patterns, at)

    with pytest.raises(PowerCut):
        run_campaign(
            campaign, clock=clock, rig=Rig(), on_settled=told.append, work=_with_real_change, lay=one_after_another
        )
    assert [settled.number for settled in told] == list(range(6)), "five seconds' scans are one commit"
    clock.advance(60)
    run_campaign(campaign, clock=clock, rig=campaigns.Rig(), max_scans=1, work=_with_real_change)
    store = open_store(campaign.store.path)
    assert len(store) == 7
    ledger = Ledger(ledger_beside(campaign.store.path), write=False)
    rows = ledger.rows()
    ledger.close()
    assert [row.state for row in rows] == ["taken"] * 6 + ["missed"] * 4 + ["taken"]
    assert {row.cause for row in rows if row.state == "missed"} == {INTERRUPTED}
    assert len([event for event in store.events if event.kind == "missed"]) == 4


def test_status_says_that_the_disk_is_almost_full(tmp_path: Path) -> None:
    campaign = campaigns.campaign_in(tmp_path)
    everything = shutil.disk_usage(tmp_path).total / 1e6
    crowded = campaign.model_copy(update={"store": campaign.store.model_copy(update={"reserve_mb": everything})})
    told: list[Settled] = []
    clock = AcceleratedClock(instant(campaigns.BASE))
    run_campaign(crowded, clock=clock, rig=campaigns.Rig(), on_settled=told.append, max_scans=2, work=campaigns.work)
    assert [settled.state for settled in told] == ["failed", "failed"]
    assert "disk almost full, no scan taken" in told[0].cause
    standing = look(campaign.store.path, clock.now(), crowded)
    assert (standing.state, standing.exit_code, standing.scans, standing.failed) == ("degraded", 4, 0, 2)
    assert standing.why.startswith("disk almost full")
    assert "lower store.reserve_mb" in standing.why


FILLED = """
import shutil, sys
from pathlib import Path
import numpy as np
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from pipelines import instant
from storage import Ledger, ledger_beside, open_store
from tests.monitor import campaigns

disk = Path(sys.argv[1])
campaign = campaigns.campaign_in(disk)
store = campaign.store.model_copy(update={"reserve_mb": float(sys.argv[2])})
campaign = campaign.model_copy(update={"store": store})
failed = []

def told(settled):
    if settled.state == "failed":
        failed.append(settled.cause)
        if len(failed) == 3:
            (disk / "ballast").unlink()

clock = AcceleratedClock(instant(campaigns.BASE))
outcome = run_campaign(campaign, clock=clock, rig=campaigns.Rig(), on_settled=told, max_scans=45, work=campaigns.work)
assert outcome.failed == 3, outcome
assert outcome.taken == 42, outcome
kept = open_store(campaign.store.path)
assert len(kept) == 42
for number in range(len(kept)):
    hours = float((kept[number].planned - instant(campaigns.BASE)) / np.timedelta64(1, "h"))
    assert abs(float(kept[number].scan.height[0, 0]) - hours / 1000) < 0.0003
ledger = Ledger(ledger_beside(campaign.store.path), write=False)
assert ledger.counts()["failed"] == 3 and ledger.counts()["planned"] == 0, ledger.counts()
print([event.text for event in kept.events if event.kind == "failed"])
print(failed[0])
"""


@pytest.mark.skipif(not NAMESPACES, reason="mount namespaces are not permitted here: no disk of a known size to fill")
@pytest.mark.parametrize(
    ("reserve_mb", "event", "cause"),
    [
        (0.0, "[34] not stored, .*disk is full", "not stored: .*disk is full: free some space"),
        (1.0, "disk almost full", ""),
    ],
)
def test_a_full_disk_costs_the_visits_until_there_is_room(
    tmp_path: Path, reserve_mb: float, event: str, cause: str
) -> None:
    """On a disk of 40 MB, a tmpfs in a mount namespace of its own: it is gone with the process."""
    mount = tmp_path / "disk"
    mount.mkdir()
    script = (
        f"mount -t tmpfs -o size=40m tmpfs {mount} && head -c 38500000 /dev/zero > {mount}/ballast && "
        f'exec {sys.executable} -c "$FILLED" {mount} {reserve_mb}'
    )
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "FILLED": FILLED, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    events, first = done.stdout.splitlines()[-2:]  # the log goes before
    assert len(events.split("', '")) == 1, "one event"
    assert re.search(event, events)
    assert re.search(cause, first)
