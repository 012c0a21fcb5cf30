"""Alarms from visit to visit: the same verdict however the scans came in, silence, doubt, and who has seen them."""

from __future__ import annotations

import json
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from configs import Alarm
from dashboards import gather, judge_findings
from monitor.alarms import Seen, after_gap, after_scan, resumed, told
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.loop import Loop
from monitor.scheduler import IntervalSlots
from monitor.visit import Epoch, Recipe, Yield, judged
from monitor.visit import Finding as VisitFinding
from pipelines import AlarmState, Change, Event, Frames, Grid, Instant, Measurement, Motion, Scan, as_datetime
from storage import Inbox, create_store, open_store, write_height_map

from .stand_ins import CALIBRATION, PATTERNS, T0, FakeLedger, FakeRig, after, whole

HOUR = 3600.0
GRID = Grid(60, 70, 0.1, -3.0, -2.0)
SMALL = Grid(4, 5, 0.1)
CAMPAIGN = """
site: {name: ground}
store: {path: s.icechunk}
rig: {name: simulated}
schedule: {every: 6 h}
calibration: {simulated: true}
metrics: [net_volume]
alarms:
  - {name: mound, metric: net_volume, unit: mm3, warn_above: 0.8, alarm_above: 1.6, confirm: [2, 3], clear_by: 0.4}
  - {name: fast, metric: net_volume, warn_rate_above_per_day: 0.2, window_days: 2, within_days: 2, alarm_above: 9}
  - {name: changed, metric: net_volume, chart: cusum, false_alarm_every_scans: 20, no_data_after_slots: 1}
environment: {csv: air.csv, temperature_c: t}
"""
VOLUMES = (0, 0.1, 0.0, 0.1, 0.05, 0.9, 1.0, 1.7, 1.8, 1.3, 1.0, 0.1, 0.1)
Capture = pytest.CaptureFixture[str]


def ground(number: int) -> Scan:
    """Rough ground with a mound of `VOLUMES` on it."""
    rough = np.random.default_rng(3).normal(0, 0.05, GRID.shape)
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    rise = VOLUMES[number] * np.exp(-2 * (x**2 + (y - 1) ** 2)) * 2 / np.pi
    noise = np.random.default_rng(number).normal(0, 0.002, GRID.shape)
    level = np.zeros(GRID.shape, np.uint8)
    height = (rough + rise + noise).astype(np.float32)
    return Scan(GRID, after(6 * HOUR * number), height, np.full(GRID.shape, 0.004, np.float32), level, level)


def verdicts(path: Path) -> tuple[list[dict[str, AlarmState]], list[str]]:
    store = open_store(path)
    alarms = [dict(store[number].alarms) for number in range(len(store))]
    return alarms, [event.text for event in store.events if event.kind == "alarm"]


def test_the_same_verdict_in_one_go_scan_by_scan_and_processed_again(tmp_path: Path, capsys: Capture) -> None:
    files = [str(tmp_path / f"{number:02}.npz") for number in range(len(VOLUMES))]
    for number, file in enumerate(files):
        write_height_map(ground(number), file)
    lines = [f"{str(after(6 * HOUR * number))[:19]}Z,{10 + number}" for number in range(len(VOLUMES))]
    (tmp_path / "air.csv").write_text("\n".join(["time,t", *lines]) + "\n")
    units = {"net_volume": "mm3", "temperature": "degree_Celsius"}
    for name in ("once", "piecewise"):
        create_store(tmp_path / name, site="ground", grid=GRID, campaign=CAMPAIGN, metrics=units).close()
    assert run_tokens(["ingest", str(tmp_path / "once"), *files]) == 0
    states, events = verdicts(tmp_path / "once")
    assert [each["mound"] for each in states] == [
        *["ok"] * 6,
        *["warning"] * 2,
        *["alarm"] * 2,
        "warning",
        "warning",
        "ok",
    ]
    assert "warning" in [each["fast"] for each in states], open_store(tmp_path / "once").series()["net_volume"]
    assert "warning" in [each["changed"] for each in states]
    assert events[0].startswith("changed: ok -> warning, net volume 0."), events
    for part in (files[:1], files[1:4], *([file] for file in files[4:])):
        assert run_tokens(["ingest", str(tmp_path / "piecewise"), *part]) == 0
    assert verdicts(tmp_path / "piecewise") == (states, events)
    for some in (["--from", "4", "--to", "6"], []):
        assert run_tokens(["process", str(tmp_path / "piecewise"), *some]) == 0, capsys.readouterr().err
        again = verdicts(tmp_path / "piecewise")
        assert again[0] == states
        # the heights that a store keeps are rounded to 0.5 um, and with them the last digit of a sigma
        assert sorted(text.split(" ±")[0] for text in again[1]) == sorted(text.split(" ±")[0] for text in events)
        air = open_store(tmp_path / "piecewise").series()["temperature"]
        assert list(air) == [10 + number for number in range(len(VOLUMES))], "no pipeline makes it anew"
    assert run_tokens(["status", str(tmp_path / "once")]) == 0
    rule = next(each for each in gather(open_store(tmp_path / "once")).limits if each.name == "mound")
    assert "2 of 3 values must be beyond a limit" in rule.rules


LIMIT = Alarm(name="mound", metric="net_volume", warn_above=1.0, alarm_above=2.0, no_data_after_slots=3)
RECIPE = Recipe(SMALL, patterns=PATTERNS, calibration=CALIBRATION, metrics=("net_volume",), alarms=(LIMIT,))


def scan_at(time: Instant) -> Scan:
    zeros = np.zeros(SMALL.shape, np.uint8)
    flat = np.zeros(SMALL.shape, np.float32)
    return Scan(SMALL, time, flat, flat + np.float32(0.01), zeros, zeros, CALIBRATION.id)


class Bench:
    """A loop on a real store whose scans measure what a script says; None is a rig that fails, a text a doubt."""

    def __init__(self, path: Path, script: list[float | str | None]) -> None:
        self.path, self.script = path, script
        self.clock, self.ledger, self.last = AcceleratedClock(T0), FakeLedger(), T0 - np.timedelta64(1, "ns")
        create_store(path, site="bench", grid=SMALL, metrics={"net_volume": "mm3"}).close()

    def run(self, visits: int) -> None:
        with closing(open_store(self.path, write=True)) as store:
            loop = Loop(
                IntervalSlots(T0, timedelta(hours=1), as_datetime(after(99 * HOUR))),
                lambda slot: 600.0,
                RECIPE,
                FakeRig(),
                store,
                self.ledger,
                self.clock,
                self.last,
                work=whole(self.work),
                notes=False,
                inbox=Inbox(self.path),
            )
            loop.run(visits)
            self.last = loop.last

    def work(self, frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
        now = self.script.pop(0)
        if now is None:
            raise ValueError("too dark")
        scan = scan_at(frames.time)
        if epoch is None:
            return judged(VisitFinding(scan), recipe, {}, planned)
        doubt = now if isinstance(now, str) else ""
        motion = Motion(np.eye(4), 0.001, 0.9, 0.5, 0.001, 0.001, "doubtful" if doubt else "good", doubt)
        nothing = np.zeros(SMALL.shape, np.float32)
        change = Change(SMALL, epoch.baseline.time, nothing, nothing, motion)
        value = 9.0 if isinstance(now, str) else now
        finding = VisitFinding(scan, change, {"net_volume": Measurement(value, 0.1)})
        return judged(finding, recipe, epoch.watches, planned)

    def told(self) -> list[str]:
        return [event.text for event in open_store(self.path).events if event.kind == "alarm"]


SCRIPT: list[float | str | None] = [0.0, 0.5, 1.5, None, "half moved", 2.5, "half moved", None, None, 2.5, 0.5]
TOLD = [
    "mound: ok -> warning, net volume 1.50 ± 0.10 mm³, above the limit of 1 mm³",
    "mound: warning -> alarm, net volume 2.50 ± 0.10 mm³, above the limit of 2 mm³",
    "mound: alarm -> no data, 3 slots in a row without a value to judge, the last: too dark",
    "mound: no data -> alarm, net volume 2.50 ± 0.10 mm³, above the limit of 2 mm³",
    "mound: alarm -> ok, net volume 0.50 ± 0.10 mm³",
]


@pytest.mark.parametrize("restart_after", [[11], [1] * 11, [5, 3, 3]])
def test_silence_and_doubt_raise_and_clear_nothing_and_too_much_of_it_is_no_data(
    tmp_path: Path, restart_after: list[int]
) -> None:
    bench = Bench(tmp_path / "s", list(SCRIPT))
    for visits in restart_after:
        bench.run(visits)
    assert bench.told() == TOLD
    notes = [event.text for event in open_store(tmp_path / "s").events if event.kind == "note"]
    assert notes == ["registration doubtful: half moved; no alarm is judged by it"] * 2


def test_missed_slots_are_no_data(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "s", [0.0, 0.5, 0.5])
    bench.run(2)
    bench.clock.advance(5 * HOUR)
    bench.run(1)
    assert [text.split(",")[0] for text in bench.told()] == ["mound: ok -> no data", "mound: no data -> ok"]
    assert "4 slots in a row" in bench.told()[0]


def test_a_rig_that_never_answers_is_no_data_until_the_first_scan(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "s", [None, None, None, 0.0])
    bench.run(3)
    assert [text.split(",")[0] for text in bench.told()] == ["mound: ok -> no data"]
    bench.run(1)
    assert [text.split(",")[0] for text in bench.told()][1:] == ["mound: no data -> ok"]


def test_a_new_baseline_tells_that_it_clears_an_alarm() -> None:
    raised = after_scan([LIMIT], {}, Seen(T0, "good", {"net_volume": Measurement(3.0, 0.1)}))
    cleared = after_scan([LIMIT], raised, Seen(after(60), "", {}))
    (change,) = told([LIMIT], raised, cleared, after(60), Seen(after(60), "", {}))
    assert (change.before, change.after) == ("alarm", "ok")
    assert "new baseline" in change.why


def test_silence_alone_tells_once() -> None:
    one = after_gap([LIMIT], {}, 3, "missed")
    two = after_gap([LIMIT], one, 1, "missed")
    assert len(told([LIMIT], {}, one, T0)) == 1
    assert told([LIMIT], one, two, T0) == ()


def in_alarm(path: Path) -> Bench:
    bench = Bench(path, [0.0, 2.5, 2.5, 0.5, 2.5])
    bench.run(2)
    return bench


def test_an_acknowledgement_is_kept_shown_and_lasts_as_long_as_the_exceedance(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = in_alarm(tmp_path / "s")
    monkeypatch.setattr("monitor.commands.ack.RealClock", lambda: AcceleratedClock(after(1.5 * HOUR)))
    path = str(tmp_path / "s")
    assert run_tokens(["status", path]) == 3
    assert "not acknowledged" in capsys.readouterr().out
    assert run_tokens(["ack", path, "mound", "--by", "Ann", "--note", "seen: sealed"]) == 0
    assert capsys.readouterr().out == "acknowledged mound: alarm since 2026-01-01T01:00:00Z\n"
    assert run_tokens(["status", path]) == 3, "who has seen it has not mended it"
    assert "acknowledged by Ann: seen: sealed, " in capsys.readouterr().out
    store = open_store(path)
    (kept,) = [event for event in store.events if event.kind == "acknowledged"]
    assert kept.text == "mound: acknowledged by Ann: seen: sealed"
    assert "Acknowledged by Ann: seen: sealed" in judge_findings(gather(store)).reasons[0]
    for _ in range(3):  # alarm still, ok, alarm anew
        bench.run(1)
    assert run_tokens(["status", path, "--json"]) == 3
    words = json.loads(capsys.readouterr().out)["alarm_words"]["mound"]
    assert words.endswith("not acknowledged")


def test_an_acknowledgement_reaches_a_running_campaign(tmp_path: Path, capsys: Capture) -> None:
    bench = in_alarm(tmp_path / "s")
    path = str(tmp_path / "s")
    with closing(open_store(path, write=True)):
        assert run_tokens(["ack", path, "mound", "--by", "Ann"]) == 0
        assert "takes it into the store with its next visit" in capsys.readouterr().out
        assert run_tokens(["status", path]) == 3
        assert "acknowledged by Ann" in capsys.readouterr().out
    assert not [event for event in open_store(path).events if event.kind == "acknowledged"]
    bench.run(1)
    assert [event.text for event in open_store(path).events if event.kind == "acknowledged"] == [
        "mound: acknowledged by Ann"
    ]
    assert not (tmp_path / "s.inbox").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["mond"], 2, "no alarm 'mond', did you mean 'mound'?"),
        (["mound", "--by", "a:b"], 2, "a name has no colon"),
    ],
)
def test_acknowledgements_that_cannot_be(
    tmp_path: Path, capsys: Capture, words: list[str], code: int, said: str
) -> None:
    in_alarm(tmp_path / "s")
    assert run_tokens(["ack", str(tmp_path / "s"), *words]) == code
    assert said in capsys.readouterr().err


def test_what_is_well_cannot_be_acknowledged(tmp_path: Path, capsys: Capture) -> None:
    Bench(tmp_path / "s", [0.0, 0.5]).run(2)
    assert run_tokens(["ack", str(tmp_path / "s"), "mound"]) == 2
    assert "mound is ok: there is nothing to acknowledge" in capsys.readouterr().err


def test_the_state_of_an_alarm_does_not_grow_with_the_campaign() -> None:
    """Every visit costs the same, at scan 10 as at scan 10,000: it carries what its window holds."""
    rule = Alarm(name="a", metric="net_volume", warn_rate_above_per_day=9.0, window_days=2, chart="ewma")
    watches = after_scan([rule], {}, Seen(T0, "", {}))
    for number in range(1, 200):
        metrics = {"net_volume": Measurement(float(np.sin(number)), 0.1)}
        watches = after_scan([rule], watches, Seen(after(number * 6 * HOUR), "good", metrics))
    assert len(watches["a"].values) == 9


def test_an_alarm_that_is_new_to_a_campaign_looks_back_too(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "s", [0.0, 0.5, 0.6, 0.7])
    bench.run(4)
    new = Alarm(name="new", metric="net_volume", chart="cusum")
    watch = resumed([new], open_store(tmp_path / "s"))["new"]
    assert watch.chart.known == 3


def test_the_inbox_passes_over_what_is_no_event(tmp_path: Path) -> None:
    inbox = Inbox(tmp_path / "s.icechunk")
    inbox.put(Event(T0, "acknowledged", "mound: acknowledged"))
    (tmp_path / "s.inbox" / "junk.json").write_text("{")
    ((file, event),) = inbox.waiting()
    assert event.text == "mound: acknowledged"
    inbox.taken([file])
    assert inbox.waiting() == ()
