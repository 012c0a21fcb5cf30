"""Reports that a campaign writes by itself: when a day or week is over, when an alarm goes off, once each."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from configs import ConfigError, Reports, parse_campaign
from monitor.cli import run_tokens
from monitor.recipe import campaign_hash, read_pattern_set
from monitor.reporter import Reporter, reporter_of
from monitor.settled import Settled
from pipelines import AlarmChange, AlarmState, Tick
from storage import open_store

from ..dashboards.drying import SIX_HOURS, START, drying_store
from ..dashboards.filled_store import fill_store
from .campaigns import campaign_in


class Ran:
    """A process that has ended when it is next asked."""

    def __init__(self, words: Sequence[str], code: int = 0, said: str = "") -> None:
        self.words, self.returncode, self.said = list(words), code, said

    def poll(self) -> int | None:
        return self.returncode

    def communicate(self, input: None = None, timeout: float | None = None) -> tuple[str, str]:  # noqa: A002 - Popen's
        return "", self.said


def reporter(out: Path, ran: list[Ran], zone: str = "UTC", **settings: object) -> Reporter:
    def start(words: Sequence[str]) -> Ran:
        ran.append(Ran(words))
        return ran[-1]

    return Reporter(Reports.model_validate({"out": out, **settings}), "plot.icechunk", ZoneInfo(zone), None, start)


def slots(count: int) -> list[Settled]:
    return [Settled(START + visit * SIX_HOURS, "taken", number=visit, tick=Tick(START)) for visit in range(count)]


def alarm(before: AlarmState, after: AlarmState, minute: int = 0) -> Settled:
    at = START + np.timedelta64(minute, "m")
    event = AlarmChange(at, "wide cracks", before, after).event
    return Settled(at, "taken", number=0, tick=Tick(at, events=(event,)))


def test_a_day_is_reported_on_when_the_first_slot_of_the_next_is_settled(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, every="day")
    told = [each.settled(slot) for slot in slots(8)]  # from Monday 06:00: midnight is after the third
    assert [call.words for call in ran] == [
        ["report", "plot.icechunk", "--out", str(tmp_path / f"2026-05-0{day}"), "--to", end]
        for day, end in ((4, "2026-05-04T23:59:59.999999+00:00"), (5, "2026-05-05T23:59:59.999999+00:00"))
    ]
    assert told[3:5] == [[], [f"report written: {tmp_path / '2026-05-04'}"]]


def test_a_week_ends_on_sunday_night_in_the_sites_zone(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, "America/New_York", every="week")
    for slot in slots(30):
        each.settled(slot)
    assert [call.words[3:] for call in ran] == [
        [str(tmp_path / "2026-W19"), "--to", "2026-05-10T23:59:59.999999-04:00"],
    ]


def test_an_alarm_is_reported_on_a_warning_is_not_and_options_are_handed_on(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, on_alarm=True, pdf=True, templates=tmp_path / "own")
    each.settled(alarm("ok", "warning"))
    assert ran == []
    each.settled(alarm("warning", "alarm"))
    folder = str(tmp_path / "2026-05-04T0600Z-alarm")
    assert ran[0].words == ["report", "plot.icechunk", "--out", folder, "--pdf", "--templates", str(tmp_path / "own")]


def test_an_alarm_that_flaps_has_no_report_for_each_flap_and_none_is_lost(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, on_alarm=True, alarm_rest="1 h")
    flaps: list[tuple[AlarmState, AlarmState]] = [("ok", "alarm"), ("alarm", "ok")]
    for minute in range(0, 150, 10):  # the last flap up is at 140 min
        each.settled(alarm(*flaps[minute // 10 % 2], minute))
    assert [call.words[3] for call in ran] == [str(tmp_path / f"2026-05-04T0{hour}00Z-alarm") for hour in (6, 7, 8)]
    each.close()
    assert ran[-1].words[3] == str(tmp_path / "2026-05-04T0820Z-alarm"), "what still waited, at the end"

    for name in ("2026-05-04T0820Z-alarm", "my own-alarm"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.html").touch()
    settings = Reports.model_validate({"out": tmp_path, "on_alarm": True})
    again = reporter_of(campaign_in(tmp_path).model_copy(update={"report": settings}), drying_store(1, 10))
    assert again is not None
    assert again.reported == datetime(2026, 5, 4, 8, 20, tzinfo=UTC), "a restart knows it from the folders"


def test_a_restart_goes_on_from_the_newest_scan_and_writes_no_report_twice(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, every="day", covers=timedelta(days=30))
    each.last = START
    each.settled(slots(5)[4])
    assert ran[0].words[3:5] == [str(tmp_path / "2026-05-04"), "--to"]
    assert ran[0].words[-2:] == ["--from", "2026-04-04T23:59:59.999999+00:00"]
    (tmp_path / "2026-05-04").mkdir()
    (tmp_path / "2026-05-04" / "report.html").touch()
    again = reporter(tmp_path, ran, every="day")
    again.last = START
    again.settled(slots(5)[4])
    assert len(ran) == 1


def test_a_report_that_failed_is_noted_with_its_reason_and_the_next_is_begun(tmp_path: Path) -> None:
    ran: list[Ran] = []
    each = reporter(tmp_path, ran, every="day")
    for slot in slots(4):
        each.settled(slot)
    ran[0].returncode, ran[0].said = 1, "reading\nmicrorelief: the disk is full\n"
    assert each.settled(slots(5)[4]) == ["report 2026-05-04 not written: the disk is full"]
    for slot in slots(8)[5:]:
        each.settled(slot)
    assert len(ran) == 2
    each.close()


def test_the_words_are_those_of_the_command_line(tmp_path: Path) -> None:
    path = fill_store(drying_store(6, 24), tmp_path / "plot.icechunk")

    def start(words: Sequence[str]) -> Ran:
        return Ran(words, run_tokens(list(words)))

    store = open_store(path)
    try:
        settings = Reports.model_validate({"every": "day", "out": tmp_path / "reports"})
        each = Reporter(settings, str(path), ZoneInfo("UTC"), store[0].scan.time, start)
        each.settled(Settled(START + np.timedelta64(1, "D"), "missed", "a power cut"))
    finally:
        store.close()
    assert each.settled(slots(6)[5]) == [f"report written: {tmp_path / 'reports' / '2026-05-04'}"]
    assert "2026-05-04 12:00 UTC" in (tmp_path / "reports" / "2026-05-04" / "report.html").read_text(encoding="utf-8")


def test_a_campaign_says_when_and_its_numbers_do_not_depend_on_it(tmp_path: Path) -> None:
    campaign = campaign_in(tmp_path)
    asked = campaign.model_copy(update={"report": Reports(every="week")})
    patterns = read_pattern_set(campaign)
    assert campaign_hash(asked, patterns) == campaign_hash(campaign, patterns)
    store = drying_store(1, 10)
    assert reporter_of(campaign, store) is None
    made = reporter_of(asked, store)
    assert made is not None
    assert made.last == START


def test_a_report_that_would_never_be_written_is_refused(tmp_path: Path) -> None:
    text = files("configs").joinpath("site.yaml").read_text(encoding="utf-8")
    with pytest.raises(ConfigError, match="needs every: day or week, or on_alarm: true"):
        parse_campaign(text.replace("  every: week ", "  pdf: true "), "site.yaml", tmp_path)
