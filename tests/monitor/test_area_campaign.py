"""A campaign of an area: a slot visits all tiles and is one scan, whatever happens to a tile, a device or us."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from configs import Area, Campaign, CaptureError, DeviceUnavailable, InputError
from monitor.area_plan import plan_area
from monitor.campaign import run_campaign
from monitor.check import load_scheduled
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.health import check_campaign
from monitor.health_log import HealthLog, health_file
from monitor.joined_tiles import join
from monitor.rigs import SimulatedRig, SimulatedStage
from monitor.settled import Outcome, Settled
from monitor.stage_axes import ORIENTATIONS
from pipelines import Calibration, Frames, Grid, Instant, PatternSet, Scan, instant
from storage import Ledger, ledger_beside, open_store
from storage.ledger import INTERRUPTED
from tests.pipelines.change.scans import bumps, sampled, scan_of

from .campaigns import BASE, campaign_in
from .exact_rig import exact_calibration

T0 = instant(BASE)
HOUR = np.timedelta64(3600 * 10**9, "ns")
NOISE = 0.002
AXES = ("-x", "y")
RELIEF = bumps(seed=3)
FIRST, SECOND, THIRD, FOURTH = (0.0, 0.0), (0.6, 0.0), (0.6, 0.6), (0.0, 0.6)
WHOLE = 0.95
"""A cell of 87 x 107 may be lost on each side, by where the stage stands."""
Script = Callable[[int, tuple[float, float]], None]


def swelling(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], hours: float) -> npt.NDArray[np.float64]:
    """A bump at the corner where all four tiles meet."""
    swollen: npt.NDArray[np.float64] = 0.02 * hours * np.exp(-((x - 0.3) ** 2 + (y + 0.3) ** 2) / 0.1)
    return swollen


class Crust(SimulatedRig):
    """A rig on a stage that sees a surface in closed form; `script` may raise at each capture, by hour and place."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, script: Script) -> None:
        super().__init__()
        self.script = script
        self.stage = SimulatedStage()
        self.opened = 0
        monkeypatch.setattr("monitor.area_visit.remarks", lambda frames: ())
        monkeypatch.setattr("monitor.area_visit.make_scan", self.seen)

    def carried_by(self, stage: SimulatedStage) -> None:
        self.stage = stage

    def open(self) -> None:
        self.opened += 1

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        x, y = self.stage.where()
        place = (round(x, 3), round(y, 3))
        self.script(round(float((at - T0) / HOUR)), place)
        stack = np.zeros((len(patterns.roles), 12, 16), np.uint8)
        stack[0] = 180 if place == SECOND else 100
        return Frames(stack, at, patterns)

    def seen(self, frames: Frames, calibration: Calibration, rules: Any) -> Scan:
        grid: Grid = rules.grid
        hours, told = float((frames.time - T0) / HOUR), np.array(self.stage.where())
        chance = np.random.default_rng([round(hours), *(round(1e3 * each) for each in told)])
        moved = ORIENTATIONS[AXES] @ (told + chance.normal(0, 0.01, 2))  # it stands elsewhere at each visit
        x, y = np.meshgrid(grid.x_mm - moved[0], grid.y_mm - moved[1])
        height = RELIEF(x, y) + swelling(x, y, hours) + chance.normal(0, NOISE, grid.shape)
        zeros = np.zeros(grid.shape, np.uint8)
        sigma = np.full(grid.shape, NOISE, np.float32)
        return Scan(grid, frames.time, height.astype(np.float32), sigma, zeros + 128, zeros, calibration.id)


def area_in(folder: Path, **changed: object) -> Campaign:
    campaign = campaign_in(folder)
    given = {"x_mm": [0.0, 0.6], "y_mm": [0.0, 0.6], "overlap": 0.45, "axes": AXES, "settle_s": 1.0, "tries": 1}
    area = Area.model_validate({"stage": {"kind": "simulated"}, **given, **changed})
    grid = campaign.grid.model_copy(update={"pitch_mm": 0.02})
    return campaign.model_copy(update={"area": area, "grid": grid})


@pytest.fixture
def go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Outcome, list[Settled]]]:
    """Run so many visits from an hour on; give what they came to."""

    def run(visits: int, script: Script = lambda hour, place: None, *, at_h: float = 0, **changed: object) -> Any:
        told: list[Settled] = []
        clock = AcceleratedClock(T0 + np.timedelta64(round(at_h * 3600), "s"))
        rig = Crust(monkeypatch, script)
        campaign = area_in(tmp_path, **changed)
        return run_campaign(campaign, clock=clock, rig=rig, on_settled=told.append, max_scans=visits), told

    return run


def states(folder: Path) -> dict[int, tuple[str, str]]:
    ledger = Ledger(ledger_beside(folder / "site.icechunk"), write=False)
    rows = ledger.rows()
    ledger.close()
    return {int((row.planned - T0) / HOUR): (row.state, row.cause) for row in rows}


Go = Callable[..., tuple[Outcome, list[Settled]]]


def test_three_slots_are_three_scans_on_one_grid_that_show_what_changed(go: Go, tmp_path: Path) -> None:
    outcome, told = go(3)
    assert (outcome.taken, outcome.degraded) == (3, False)
    assert [settled.took_s for settled in told] == pytest.approx([4.0] * 3)  # it settles at four tiles
    store = open_store(tmp_path / "site.icechunk")
    scans = [store[number] for number in range(3)]
    grid = scans[0].scan.grid
    assert {each.scan.grid for each in scans} == {grid}
    assert [each.scan.time for each in scans] == [T0, T0 + HOUR, T0 + 2 * HOUR]
    # 16 x 12 pixels of 0.1 mm about pixel (8, 6), seen from above, and 0.6 mm of travel each way
    assert grid.extent_mm == pytest.approx((-0.8, 0.7 + 0.6, -0.5 - 0.6, 0.6), abs=0.03)
    assert scans[0].scan.coverage > WHOLE
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    for hours in (1, 2):
        change = scans[hours].change
        assert change is not None
        assert change.motion.verdict == "good"
        error = (change.dz - swelling(x, y, hours))[2:-2, 2:-2]
        assert np.isfinite(error).mean() > 0.99
        assert np.nanmean(np.abs(error) > change.lod[2:-2, 2:-2]) < 0.05
        assert abs(np.nanmedian(error)) < 0.001


def test_health_is_that_of_all_tiles(go: Go, tmp_path: Path) -> None:
    go(1)
    (health,) = HealthLog(health_file(area_in(tmp_path))).newest(1)
    assert health.bright == pytest.approx(180 / 255), "the brightest"
    assert health.light == pytest.approx(100 / 255), "the middle"


def test_a_tile_that_fails_leaves_a_hole_and_is_told(go: Go, tmp_path: Path) -> None:
    def glare(hour: int, place: tuple[float, float]) -> None:
        if hour == 1 and place == SECOND:
            raise CaptureError("capture rejected: saturation")

    outcome, told = go(3, glare)
    assert outcome.taken == 3
    assert told[1].tick is not None
    text = "capture: a hole is left by tile_01_02: capture rejected: saturation"
    assert text in [event.text for event in told[1].tick.events]
    store = open_store(tmp_path / "site.icechunk")
    covered = [store[number].scan.coverage for number in range(3)]
    assert covered[0] > WHOLE
    assert covered[2] > WHOLE
    left, right, low, high = store[1].scan.grid.extent_mm
    alone = 0.6**2 / ((right - left) * (high - low))  # the corner that no other tile sees
    assert covered[1] == pytest.approx(1 - alone, abs=0.03)
    change = store[1].change
    assert change is not None
    assert change.motion.verdict == "good"


def test_what_costs_a_visit_costs_no_other(go: Go, tmp_path: Path) -> None:
    def script(hour: int, place: tuple[float, float]) -> None:
        if hour == 1 and place != FIRST:
            raise CaptureError("capture rejected: saturation")
        if hour == 2 and place == THIRD:
            raise DeviceUnavailable("the camera does not answer")

    outcome, told = go(4, script)
    assert (outcome.taken, outcome.failed) == (2, 2)
    assert [settled.unavailable for settled in told] == [False, False, True, False]
    too_few = "only 1 of 4 tiles could be taken: tile_01_02: capture rejected: saturation"
    assert states(tmp_path) == {
        0: ("taken", ""),
        1: ("failed", too_few),
        2: ("failed", "the camera does not answer"),
        3: ("taken", ""),
    }
    store = open_store(tmp_path / "site.icechunk")
    assert len(store) == 2
    assert store[1].scan.coverage > WHOLE  # nothing of the visits before is in it


def test_a_device_that_comes_back_within_the_tries_costs_nothing(go: Go) -> None:
    away = [True]

    def loose(hour: int, place: tuple[float, float]) -> None:
        if hour == 1 and place == THIRD and away.pop():
            away.append(False)
            raise DeviceUnavailable("the camera does not answer")

    outcome, told = go(2, loose, tries=2)
    assert outcome.taken == 2
    assert told[1].took_s == pytest.approx(4.0 + 1.0 + 10.0)  # looked for again after ten seconds


class Killed(BaseException):
    """What no handler catches: the process ends here."""


def test_a_half_visited_slot_of_a_killed_process_ends_as_missed_once(go: Go, tmp_path: Path) -> None:
    def kill(hour: int, place: tuple[float, float]) -> None:
        if hour == 1 and place == THIRD:
            raise Killed

    with pytest.raises(Killed):
        go(3, kill)
    assert states(tmp_path)[1] == ("planned", "")
    go(1, at_h=1.5)
    assert states(tmp_path) == {0: ("taken", ""), 1: ("missed", INTERRUPTED), 2: ("taken", "")}
    store = open_store(tmp_path / "site.icechunk")
    assert len(store) == 2
    assert store[1].scan.coverage > WHOLE


def test_a_store_of_another_area_is_refused(go: Go) -> None:
    go(1)
    with pytest.raises(InputError, match=r"area: its height maps would reach from .* give store\.path another name"):
        go(1, at_h=1, x_mm=[0.0, 1.8])
    with pytest.raises(InputError, match=r"area: needs axes"):
        go(1, at_h=1, axes=None)


@given(
    axes=st.sampled_from(sorted(ORIENTATIONS)),
    start=st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    way=st.tuples(st.floats(0, 9), st.floats(0.1, 9)),
    pitch=st.sampled_from([0.02, 0.05, 0.1]),
)
def test_the_grid_holds_every_tile_where_the_stage_is_told_to_go(
    axes: tuple[str, str], start: tuple[float, float], way: tuple[float, float], pitch: float
) -> None:
    field = Grid(40, 60, pitch, -1.3, 0.7)
    travel = {name: (low, low + far) for name, low, far in zip(("x_mm", "y_mm"), start, way, strict=True)}
    plan = plan_area(Area.model_validate({"stage": {"kind": "simulated"}, "axes": axes, **travel}), field)
    moved = np.array([ORIENTATIONS[axes] @ (tile.x_mm, tile.y_mm) for tile in plan.tiles])
    edges = np.array(field.extent_mm) - moved[:, [0, 0, 1, 1]]  # left, right, low, high of each tile
    inside = (edges - plan.grid.extent_mm) * [1, -1, 1, -1]
    assert inside.min() > -1e-3 * pitch
    assert inside.min(axis=0).max() < pitch  # and no cell more than it takes
    # its cells are those of the tiles: on the raster of a tile at the stage's zero
    off = (np.array([plan.grid.x0_mm - field.x0_mm, plan.grid.y0_mm - field.y0_mm]) / pitch) % 1
    assert np.minimum(off, 1 - off).max() < 1e-6


def test_a_tile_that_nothing_joins_to_the_others_is_left_out() -> None:
    chance = np.random.default_rng(5)
    places = np.array([[0.0, 0.0], [1.6, 0.0], [3.2, 0.0], [6.4, 0.0]])  # the one between the last two is missing
    scans = []
    for x, _ in places:
        height = sampled(lambda u, v, x=x: RELIEF(u + x, v), 100, 120)  # type: ignore[misc]  # the place of this turn
        scans.append(scan_of(height + chance.normal(0, NOISE, height.shape), sigma=NOISE))
    stage_mm = np.c_[-places, np.zeros(4)]
    joined = join(scans, "abcd", stage_mm, axes=("x", "y"), stage_sigma_mm=0.05, bow_mm=0.0)
    assert joined.members == (0, 1, 2)
    assert joined.left_out == {3: "it overlaps no other tile that was taken"}
    assert np.abs(joined.placement.position_mm[:, :2] + places[:3]).max() < 0.001
    alone = join(scans[3:], "d", stage_mm[3:], axes=("-x", "y"), stage_sigma_mm=0.05, bow_mm=0.0)
    assert alone.members == (0,)
    assert alone.placement.position_mm.tolist() == [[6.4, 0.0, 0.0]]


SOIL = """\
site: {name: crust}
store: {path: crust.icechunk}
rig:
  name: simulated
  options:
    camera: [240, 180]
    pace: 30
    scene_options: {side_mm: 14, hairline_mm: 0.001, opening_mm: 0, depth_mm: 0, lift_mm: 0}
schedule: {every: 1 h, start: 2026-01-01T00:00:00Z}
patterns: {kind: gray, size: [608, 684], bits: [8, 8]}
calibration: {file: exact.json}
grid: {pitch_mm: 0.1}
register:
  stable_mm: [[[-10, -8], [-7.5, -8], [-7.5, 8], [-10, 8]], [[7.5, -8], [10, -8], [10, 8], [7.5, 8]]]
region_mm: [[-6.5, -6.5], [6.5, -6.5], [6.5, 6.5], [-6.5, 6.5]]
area:
  stage: {kind: simulated, error_mm: 0.02}
  x_mm: [-3, 3]
  y_mm: [-3, 3]
  axes: [x, y]
  settle_s: 20.0
"""


def test_the_simulated_rig_follows_soil_that_settles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "crust.yaml"
    file.write_text(SOIL)
    (tmp_path / "exact.json").write_text(exact_calibration((240, 180)).to_json())
    assert run_tokens(["run", str(file), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "area: 4 tiles, together 21.1 x 17.5 mm; a scan needs 2 of them" in said
    assert "a visit takes 1 min 20 s to settle at all tiles; travel, capture and work come beside" in said
    assert "WARNING" not in said
    campaign = load_scheduled(file).campaign
    (stage,) = (each for each in islice(check_campaign(campaign), 2) if each.what == "stage")
    assert (stage.level, stage.told) == ("ok", "answers, and stands at x 0, y 0 mm")
    outcome = run_campaign(campaign, clock=AcceleratedClock(T0), max_scans=2)
    assert outcome.taken == 2
    store = open_store(tmp_path / "crust.icechunk")
    change = store[1].change
    assert change is not None
    assert change.motion.verdict == "good"
    assert store[1].scan.coverage > 0.95
    fallen = -0.1 * (1 - np.exp(-30 / 30.0)) * 13.0**2  # mm3, over the region: thirty hours of drying in an hour
    row = store.series().iloc[1]
    assert abs(row["net_volume"] - fallen) < 3 * row["net_volume_sigma"]
    assert row["net_volume_sigma"] < 0.01 * abs(fallen)
    file.write_text(SOIL.replace("every: 1 h", "every: 50 s"))
    assert run_tokens(["run", str(file), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"a visit takes 1 min 20 s, as measured \(median of 2\)", said)
    assert "WARNING: that is longer than the 50 s between slots: those due meanwhile are missed" in said


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("every: 1 h, start: 2026-01-01T00:00:00Z", "video: {rate_hz: 1}", r":9:\d+: schedule\.video: follows one fie"),
        ("grid:", "retain: {raw_frames: all}\ngrid:", r":12:\d+: retain\.raw_frames: frames of an area's tiles are n"),
        ("grid:", "exposure: {shortest_ms: 1, longest_ms: 9}\ngrid:", r":12:\d+: exposure: would follow each tile of"),
        ("  axes: [x, y]\n", "", r":16:\d+: area: needs axes, such as .*`microrelief area CAMPAIGN --out DIR` finds"),
        ("settle_s: 20.0", "least_tiles: 0", r":21:\d+: area\.least_tiles: must be more than 0"),
    ],
)
def test_what_cannot_be_had_on_a_schedule_is_told_at_its_place(
    right: str, wrong: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "crust.yaml"
    file.write_text(SOIL.replace(right, wrong))
    assert run_tokens(["run", str(file)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(message, line), line
    assert [path.name for path in tmp_path.iterdir()] == ["crust.yaml"]
