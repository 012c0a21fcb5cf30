"""Health: every visit has its timings and its light, failed ones too; a lamp that ages shows; the exposure follows."""

from __future__ import annotations

import json
import math
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from configs import AutoExposure, Campaign
from monitor.campaign import run_campaign
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.health_log import Health, HealthLog, Promptness, health_file, lamp_trends, promptness
from monitor.page import Sites, SiteSource
from monitor.page.prometheus import exposition
from monitor.vital_signs import VitalSigns, next_exposure, over_captures, vital_signs
from pipelines import Frames, PatternSet, instant

from .campaigns import BASE, HOLDER

T0 = instant(BASE)
PATTERNS = PatternSet("gray", (16, 16), bits=(2, 2))
BOUNDS = AutoExposure(shortest_ms=1.0, longest_ms=20.0)


def frames(white: int, black: int, dtype: type = np.uint8, saturated: float = 0.0) -> Frames:
    stack: Any = np.full((len(PATTERNS.roles), 40, 80), black, dtype)
    stack[0] = white
    stack[0, : round(40 * saturated)] = np.iinfo(dtype).max
    return Frames(stack, T0, PATTERNS, 5.0)


def test_vital_signs_are_what_the_frames_hold() -> None:
    signs = vital_signs(frames(153, 51, saturated=0.1))
    assert signs.light == pytest.approx(102 / 255)
    assert signs.dark == pytest.approx(1 / 3)
    assert signs.saturated == pytest.approx(0.1)
    assert signs.bright == 1.0
    assert signs.lamp == pytest.approx(102 / 255 / 5)
    assert vital_signs(frames(3000, 100, np.uint16)).bright == pytest.approx(3000 / 4095), "12 bits in words of 16"


def test_of_an_areas_tiles_the_brightest_and_the_middle_are_told() -> None:
    unknown = VitalSigns(math.nan, math.nan, math.nan, math.nan, 5.0)
    captures = [frames(153, 51, saturated=0.1), frames(100, 50), frames(120, 30)]
    signs = over_captures([*map(vital_signs, captures), unknown])
    assert signs.bright == 1.0
    assert signs.saturated == pytest.approx(0.1)
    assert signs.light == pytest.approx(90 / 255)
    assert signs.dark == pytest.approx(1 / 3)
    assert signs.exposure_ms == 5.0
    assert over_captures([unknown, unknown]) is unknown
    assert over_captures([signs]) is signs


@given(st.floats(0.02, 3.0), st.floats(1.0, 20.0))
def test_the_exposure_settles_within_its_bounds_and_stays(strength: float, start: float) -> None:
    """`strength` is how bright white is at 5 ms."""
    exposure, seen = start, []
    for _ in range(40):
        raw = strength * exposure / 5
        signs = VitalSigns(min(1.0, raw), min(1.0, raw), 0.0, float(raw > 1.0), exposure)
        exposure = next_exposure(signs, BOUNDS)
        assert BOUNDS.shortest_ms <= exposure <= BOUNDS.longest_ms
        seen.append(exposure)
    assert len(set(seen[-5:])) == 1, "it swings"
    level = strength * exposure / 5
    assert 0.45 <= level <= 1.0 or exposure in (1.0, 20.0)


def settings(**keys: Any) -> dict[str, Any]:
    return {
        "site": {"name": "health"},
        "store": {"path": "site.icechunk"},
        "rig": {"name": "simulated", "options": {"camera": [320, 240], "pace": 1, **keys.pop("options", {})}},
        "schedule": {"every": "12 h"},
        "calibration": {"simulated": True},
        "grid": {"pitch_mm": 0.1},
        "register": {"stable_mm": HOLDER},
        **keys,
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose exposure is far too long at first: rejected, until it has found its own way."""
    folder = tmp_path_factory.mktemp("health")
    keys = settings(
        options={"exposure_ms": 15.0, "faults": {4: "unplugged"}}, exposure={"shortest_ms": 1, "longest_ms": 30}
    )
    with (folder / "site.yaml").open("w") as file:
        YAML().dump(keys, file)
    campaign = Campaign.model_validate(keys, context={"folder": folder})
    run_campaign(campaign, clock=AcceleratedClock(T0), max_scans=9)
    return folder


def kept(folder: Path) -> tuple[Health, ...]:
    campaign = Campaign.model_validate(settings(), context={"folder": folder})
    return HealthLog(health_file(campaign)).newest(100)


def test_every_visit_is_kept_the_failed_and_rejected_too(folder: Path) -> None:
    visits = kept(folder)
    assert len(visits) == 9
    assert {each.state for each in visits} == {"rejected", "failed", "taken"}
    for each in visits:
        if each.state == "failed":
            assert math.isnan(each.light)
            continue
        assert each.capture_s > 0
        assert each.work_s > 0
        assert each.exposure_ms > 0
        assert 0 < each.light < 1
        assert each.lag_s == 0
    assert visits[-1].verdict == "good"
    assert visits[-1].residual_mm < 0.05


def test_a_wrong_exposure_mends_itself_and_says_so(folder: Path) -> None:
    from storage import open_store

    visits = kept(folder)
    exposures = [each.exposure_ms for each in visits if each.state != "failed"]
    assert exposures[0] == 15.0
    assert exposures == sorted(exposures, reverse=True)
    assert visits[0].saturated > 0.5
    assert visits[-1].saturated < 0.05
    notes = [event.text for event in open_store(folder / "site.icechunk").events if event.text.startswith("exposure ")]
    assert notes[0].startswith("exposure 15.00 ms -> 10.50 ms: ")


def test_the_command_tells_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["health", str(folder / "site.yaml")]) == 0
    out = capsys.readouterr().out
    assert "registration good" in out
    assert "lamp's light for the same exposure:" in out
    assert run_tokens(["health", str(folder / "site.yaml"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["visits"]) == 5
    assert set(told["trends"]) == {"lamp", "dark"}


def test_status_and_metrics_tell_how_the_newest_visit_kept_its_slot(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_tokens(["status", str(folder / "site.yaml"), "--json"]) in (0, 4)
    told = json.loads(capsys.readouterr().out)["prompt"]
    assert (told["lag_s"], told["dropped"], told["visits"]) == (0.0, 0, 9)
    assert told["latency_s"] >= 0
    campaign = Campaign.model_validate(settings(), context={"folder": folder})
    text = exposition(Sites([SiteSource(campaign.store.path, campaign)], lambda: T0 + np.timedelta64(5, "D"))).decode()
    assert 'microrelief_lag_seconds{site="site"} 0.0' in text
    assert 'microrelief_latency_seconds{site="site"}' in text


def test_without_a_run_it_says_how_it_comes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (tmp_path / "site.yaml").open("w") as file:
        YAML().dump(settings(), file)
    assert run_tokens(["health", str(tmp_path / "site.yaml")]) == 2
    assert "`microrelief run` keeps it with each visit" in capsys.readouterr().err


def test_a_log_of_an_older_version_goes_on_and_counts_what_is_dropped(tmp_path: Path) -> None:
    file = tmp_path / "old.sqlite"
    with closing(sqlite3.connect(file)) as data, data:
        data.execute("CREATE TABLE health (planned INTEGER PRIMARY KEY, state TEXT, lag_s REAL, capture_s REAL)")
        data.execute("INSERT INTO health VALUES (1, 'taken', 0.5, NULL)")
    log = HealthLog(file)
    (old,) = log.newest(9)
    assert (old.lag_s, old.dropped, math.isnan(old.latency_s)) == (0.5, 0, True)
    log.add(Health(2, "taken", 0.1, latency_s=0.7))
    log.add_dropped(2)
    log.add_dropped(1)
    assert [each.dropped for each in log.newest(9)] == [0, 3]
    assert promptness(log.newest(9)) == Promptness(0.1, 0.7, 3, 2)
    assert promptness(()) is None


def test_a_lamp_that_ages_shows_through_changes_of_the_exposure() -> None:
    rng = np.random.default_rng(3)
    visits = []
    for number in range(200):
        exposure = 5.0 if number < 90 else 6.0
        light = 0.5 * (1 - 0.0005 * number / 4) * exposure / 5 * (1 + 0.004 * rng.standard_normal())
        planned = int((T0 + np.timedelta64(6 * number, "h")).astype("datetime64[ns]").astype(np.int64))
        visits.append(Health(planned, "taken", 0.0, exposure_ms=exposure, light=light, dark=0.1, saturated=0.0))
    line = lamp_trends(visits)["lamp"]
    assert line.low < -0.0005 < line.high
    assert line.significant
    assert not lamp_trends(visits)["dark"].significant
