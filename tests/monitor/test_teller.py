"""What a video says: how it keeps up, in one line on a terminal, and elsewhere a line for each scan."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from configs import Campaign
from monitor import teller as module
from monitor.items import Visit
from monitor.pulse import PulseMeter
from monitor.settled import Settled, Tally
from monitor.slot_rules import NOT_RUNNING
from monitor.teller import Teller
from pipelines import Change, Tick
from pipelines.change import Motion

from .campaigns import campaign_in
from .stand_ins import PATTERNS, T0, FakeRig, after, flat_scan

SCAN = flat_scan(FakeRig().capture(PATTERNS, T0))


def visit(number: int, late_s: float = 0.001) -> Visit:
    made = Visit(after(number), after(number + late_s), None, Tick(after(number), SCAN))
    made.worked_out = after(number + 0.5)
    return made


def taken(number: int) -> Settled:
    nothing = np.zeros(SCAN.grid.shape, np.float32)
    tick = Tick(after(number), SCAN, Change(SCAN.grid, T0, nothing, nothing, Motion.none()))
    return Settled(after(number), "taken", "", number, tick, began=after(number + 0.001), latency_s=0.5, took_s=0.7)


MISSED = Settled(after(14), "missed", "behind by 1.3 s", count=2, first=after(13))


def video(folder: Path) -> Campaign:
    plain = campaign_in(folder).model_dump(by_alias=True, exclude_unset=True)
    return Campaign.model_validate({**plain, "schedule": {"video": {"rate_hz": 1.0}}}, context={"folder": folder})


def test_the_pulse_of_a_video() -> None:
    meter = PulseMeter(4)
    first = meter.worked(visit(0), 1)
    assert first is not None
    assert "- Hz" in first.line
    for number in range(1, 13):
        pulse = meter.worked(visit(number), 2)
    meter.settled(MISSED)
    meter.settled(Settled(after(0), "missed", NOT_RUNNING, count=5))
    pulse = meter.worked(visit(15), 3)
    assert pulse is not None
    assert pulse.rate_hz == pytest.approx(9 / 11), "ten scans, two slots between them were dropped"
    assert pulse.line == ("14 scans, 0.82 Hz, began 0.001 s late, worked out after 0.50 s, 3 of 4 under way, 2 dropped")
    failed = Visit(after(16), after(16), None, Tick(after(16)))
    assert meter.worked(failed, 1) is None


def test_each_scan_has_a_line_where_there_is_no_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tally = Tally()
    with Teller(video(tmp_path)) as teller:
        teller.worked(visit(3), 1)
        for settled in (taken(3), MISSED):
            teller.settled(settled)
            tally.add(settled)
        teller.summary(tally.outcome(stopped=False))
    assert capsys.readouterr().out.splitlines() == [
        "committed scan 3 2026-01-01T00:00:00Z lag 0.001 s worked out 0.500 s took 0.700 s",
        "missed 2 slots, 2026-01-01T00:00:13Z to 2026-01-01T00:00:14Z: behind by 1.3 s",
        "done: 1 taken, 2 dropped, lag p50 0.001 s max 0.001 s, worked out after p50 0.500 s max 0.500 s",
    ]


def test_a_scan_that_is_compared_with_nothing_says_that_an_epoch_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Teller(campaign_in(tmp_path)) as teller:
        for number in (0, 3):
            teller.settled(replace(taken(number), tick=Tick(after(number), SCAN)))
    assert capsys.readouterr().out.splitlines() == [
        "committed scan 0 2026-01-01T00:00:00Z",
        "committed scan 3 2026-01-01T00:00:00Z",
        "scan 3 begins a new epoch: later ones are compared with it, not with those before",
    ]


def test_a_schedule_that_is_over_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Teller(campaign_in(tmp_path, until="2026-01-02T00:00:00+00:00")) as teller:
        teller.summary(Tally().outcome(stopped=False))
        teller.summary(Tally().outcome(stopped=True))
    assert capsys.readouterr().out.splitlines() == [
        "done: 0 taken; the schedule ends at 2026-01-02 00:00 (schedule.until)",
        "stopped: 0 taken",
    ]


def test_on_a_terminal_one_line_stands_for_all_scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(
        module, "Console", lambda **options: Console(file=out, force_terminal=True, width=200, **options)
    )
    with Teller(video(tmp_path)) as teller:
        teller.wait(T0)
        for number in range(3):
            teller.worked(visit(number), 1)
            teller.wait(T0 + np.timedelta64(number, "s"))
            teller.settled(taken(number))
        teller.settled(MISSED)
    shown = out.getvalue()
    assert "3 scans, 1.00 Hz" in shown
    assert "committed" not in shown
    assert "behind by 1.3 s" in shown
