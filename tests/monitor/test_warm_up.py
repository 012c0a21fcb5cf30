"""Warming up: nothing that it does counts, and where it fails the campaign goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from configs import Campaign, CaptureError
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock
from monitor.rigs import RIGS
from monitor.settled import Outcome, Settled
from monitor.visit import Epoch, Recipe, Yield
from pipelines import Frames, Instant, PatternSet, format_instant, instant
from storage import open_store, write_capture

from . import campaigns
from .campaigns import BASE, campaign_in
from .stand_ins import whole

T0 = instant(BASE)
PATTERNS = PatternSet("gray", (16, 16), bits=(2, 2))


class CountingRig(campaigns.Rig):
    """Numbers its captures from 0; knows every rig that was made."""

    made: list[CountingRig] = []  # noqa: RUF012 - each test begins with an empty one

    def __init__(self, *, fails: bool = False, started: str | None = None) -> None:
        super().__init__()
        self.fails = fails and not self.made
        self.started = started
        self.captures = 0
        self.is_open = False
        self.made.append(self)

    def open(self) -> None:
        self.is_open = True

    def capture(self, patterns: object, at: Instant) -> Frames:
        assert self.is_open
        if self.fails:
            raise CaptureError("a frame was dropped")
        frames = super().capture(patterns, at)
        frames.stack[0, 0, 0] = self.captures
        self.captures += 1
        return frames

    def close(self) -> None:
        self.is_open = False


class Watched:
    """A campaign run on stand-ins, and what was seen of it."""

    def __init__(self) -> None:
        self.epochs: list[Epoch | None] = []
        self.worked: list[int] = []
        self.said: list[str] = []
        self.settled: list[Settled] = []

    def work(self, frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
        self.epochs.append(epoch)
        self.worked.append(int(frames.stack[0, 0, 0]))
        return campaigns.work(frames, recipe, epoch, planned)

    def run(self, campaign: Campaign, visits: int, at: Instant = T0, *, now: bool = False) -> Outcome:
        return run_campaign(
            campaign,
            clock=AcceleratedClock(at),
            on_settled=self.settled.append,
            on_wait=lambda slot: self.said.append("waiting"),
            on_stage=self.said.append,
            max_scans=visits,
            work=whole(self.work),
            now=now,
        )


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    monkeypatch.setitem(RIGS, "counting", CountingRig)
    monkeypatch.setattr(CountingRig, "made", [])
    return Watched()


def on_rig(campaign: Campaign, name: str, **options: object) -> Campaign:
    rig = campaign.rig.model_copy(update={"name": name, "options": options})
    return campaign.model_copy(update={"rig": rig})


def test_the_chain_has_run_twice_before_the_first_slot_and_nothing_of_it_counts(
    tmp_path: Path, watched: Watched
) -> None:
    outcome = watched.run(on_rig(campaign_in(tmp_path, "1 s"), "counting"), 3)
    assert outcome.taken == 3
    assert watched.said == ["opening the rig", "warming up", "waiting", "waiting", "waiting"]
    assert watched.worked == [0, 1, 0, 1, 2], "the campaign has a rig of its own, which nobody used before"
    assert [epoch is None for epoch in watched.epochs] == [True, False, True, False, False]
    assert [rig.is_open for rig in CountingRig.made] == [False, False]
    store = open_store(tmp_path / "site.icechunk")
    assert [stored.planned for stored in (store[0], store[1], store[2])] == [
        T0 + np.timedelta64(second, "s") for second in range(3)
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "calibration.json",
        "ledger.sqlite",
        "site.health.sqlite",
        "site.icechunk",
    ]


def test_visits_that_are_far_apart_need_none(tmp_path: Path, watched: Watched) -> None:
    watched.run(on_rig(campaign_in(tmp_path, "1 h"), "counting"), 1)
    watched.run(on_rig(campaign_in(tmp_path, "1 s"), "counting"), 1, T0 + np.timedelta64(90, "s"), now=True)
    assert "warming up" not in watched.said
    assert len(CountingRig.made) == 2


def test_where_it_fails_it_says_so_and_the_campaign_goes_on(tmp_path: Path, watched: Watched) -> None:
    outcome = watched.run(on_rig(campaign_in(tmp_path, "1 s"), "counting", fails=True), 2)
    assert outcome.taken == 2
    assert watched.said[2] == "not warmed up, the first scans may be late: CaptureError: a frame was dropped"


@pytest.mark.parametrize("count", [1, 2])
def test_a_replay_loses_no_capture(tmp_path: Path, watched: Watched, count: int) -> None:
    for number in range(count):
        stack = np.zeros((len(PATTERNS.roles), 12, 16), np.uint8)
        stack[0, 0, 0] = number
        write_capture(Frames(stack, T0, PATTERNS), tmp_path / "captures" / f"visit_{number}")
    outcome = watched.run(on_rig(campaign_in(tmp_path, "1 s"), "replay", folder=tmp_path / "captures"), count)
    assert outcome.taken == count
    assert watched.worked[2:] == list(range(count))


def test_a_scene_that_ages_goes_on_from_the_first_scan(tmp_path: Path, watched: Watched) -> None:
    campaign = on_rig(campaign_in(tmp_path, "1 h", start=None), "counting")
    first = T0 + np.timedelta64(1234567891, "ns")
    watched.run(campaign, 2, first)
    watched.run(campaign, 1, first + np.timedelta64(30, "h"))
    watched.run(campaign, 1, first + np.timedelta64(60, "h"))
    begun = format_instant(open_store(tmp_path / "site.icechunk")[0].scan.time)
    assert [rig.started for rig in CountingRig.made] == [None, begun, begun]
    watched.run(on_rig(campaign, "counting", started="2025-01-01T00:00:00Z"), 1, first + np.timedelta64(90, "h"))
    assert CountingRig.made[-1].started == "2025-01-01T00:00:00Z", "what the campaign says goes before"


def test_an_hour_off_at_every_second_is_told_once_and_recorded_whole(tmp_path: Path, watched: Watched) -> None:
    campaign = on_rig(campaign_in(tmp_path, "1 s"), "counting")
    watched.run(campaign, 1)
    outcome = watched.run(campaign, 1, T0 + np.timedelta64(3_600_000 + 900, "ms"))
    assert (outcome.missed, outcome.away, outcome.taken) == (3_600, 3_600, 1)
    assert [settled.count for settled in watched.settled] == [1, 3_600, 1]
    assert watched.settled[1].told == (
        "missed 3600 slots, 2026-01-01T00:00:01Z to 2026-01-01T01:00:00Z: microrelief was not running"
    )
