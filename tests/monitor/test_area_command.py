"""``microrelief area``: tiles planned, visited by the simulated rig on its stage, resumed, and stitched."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import Area, CaptureError, DeviceUnavailable, InputError
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.recipe import stage_of
from monitor.rigs import SimulatedStage
from monitor.tile_folder import TileFolder
from monitor.tiles import TileWalk, plan_tiles
from pipelines import Frames, Instant, PatternSet, parse_instant
from storage import read_height_map, read_stage

from .exact_rig import exact_calibration

NOW = parse_instant("2026-11-22T21:00:00Z")
SETTINGS = """
site: {name: crust}
store: {path: crust.icechunk}
rig:
  name: simulated
  options: {camera: [240, 180], drift_mm: 0, scene_options: {side_mm: 40}, faults: {1: unplugged}}
schedule: {every: 1 h}
patterns: {kind: gray, size: [608, 684], bits: [8, 8]}
calibration: {file: exact.json}
area:
  stage: {kind: simulated, error_mm: 0.02}
  x_mm: [0, 5]
  y_mm: [0, 0]
  settle_s: 0.0
  tries: 1
grid: {pitch_mm: 0.1}
"""


def area(**changed: object) -> Area:
    return Area.model_validate({"stage": {"kind": "simulated"}, "x_mm": [0.0, 10.0], "y_mm": [0.0, 5.0], **changed})


@pytest.mark.parametrize("overlap", [0.05, 0.25, 0.6])
def test_tiles_cover_the_travel_with_the_overlap_and_the_way_is_short(overlap: float) -> None:
    tiles = plan_tiles(area(overlap=overlap), (6.0, 4.0))
    x, y = sorted({tile.x_mm for tile in tiles}), sorted({tile.y_mm for tile in tiles})
    assert (x[0], x[-1], y[0], y[-1]) == (0.0, 10.0, 0.0, 5.0)
    assert max(np.diff(x)) <= 4.0 * (1 - overlap) + 1e-3
    assert len(tiles) == len(x) * len(y) == len({tile.name for tile in tiles})
    way = sum(abs(a.x_mm - b.x_mm) + abs(a.y_mm - b.y_mm) for a, b in itertools.pairwise(tiles))
    assert way == pytest.approx(10.0 * len(y) + 5.0)  # to and fro, never back over what was scanned


def test_an_area_within_one_field_is_its_corners_and_one_step_less_is_one_tile_less() -> None:
    assert len(plan_tiles(area(x_mm=[0.0, 1.0], y_mm=[2.0, 2.0]), (6.0, 4.0))) == 2
    assert len(plan_tiles(area(x_mm=[0.0, 9.0], y_mm=[2.0, 2.0], overlap=0.25), (6.0, 4.0))) == 4


SMALL = PatternSet("gray", (608, 684), bits=(1, 0))


class Rig:
    """Gives frames, or raises what the script says, capture by capture."""

    def __init__(self, *script: Exception | None) -> None:
        self.script, self.opened = list(script), 0

    def open(self) -> None:
        self.opened += 1

    def close(self) -> None: ...

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        if self.script and (error := self.script.pop(0)) is not None:
            raise error
        return Frames(np.zeros((len(patterns.roles), 4, 5), np.uint8), at, patterns)


@pytest.fixture
def scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TileFolder:
    monkeypatch.setattr("monitor.tile_folder.remarks", lambda frames: ())  # black frames of a stand-in
    where = area(x_mm=[0.0, 8.0], y_mm=[0.0, 0.0], tries=2, axes=("-x", "y"))
    tiles = plan_tiles(where, (4.0, 4.0))
    assert len(tiles) == 4
    walk = TileWalk(where, Rig(), SimulatedStage(), SMALL, lambda seconds: None)
    return TileFolder(walk, tiles, tmp_path, lambda: NOW)


def test_a_tile_is_tried_again_and_one_that_stays_bad_is_left_out(scan: TileFolder) -> None:
    bad = CaptureError("capture rejected: saturation")
    scan.walk.rig = Rig(None, bad, None, bad, bad, None)
    told = {visited.tile.name: visited.cause for visited in scan.visit_all()}
    assert told == {"tile_01_01": "", "tile_01_02": "", "tile_01_03": str(bad), "tile_01_04": ""}
    stage = read_stage(scan.stage_file)
    assert list(stage.tiles) == ["tile_01_01", "tile_01_02", "tile_01_04"]
    assert (stage.axes, stage.sigma_mm) == (("-x", "y"), 0.05)
    assert isinstance(scan.walk.stage, SimulatedStage)
    assert scan.walk.stage.sample_mm == (0.0, 0.0)  # back at the first


def test_a_device_that_stays_away_ends_the_scan_and_the_next_run_goes_on(scan: TileFolder) -> None:
    gone = DeviceUnavailable("the camera went away")
    rig = scan.walk.rig = Rig(None, gone, None, gone, gone)
    with pytest.raises(DeviceUnavailable, match="went away"):
        list(scan.visit_all())
    assert rig.opened == 3  # once at first, and once after each time it went away
    (scan.folder / "tile_01_03").mkdir()
    (scan.folder / "tile_01_03" / "00_white.png").write_text("half")  # ended in the middle of writing it
    again = TileFolder(replace(scan.walk, rig=Rig()), scan.tiles, scan.folder, lambda: NOW)
    again.resume()
    assert [visited.again for visited in again.visit_all()] == [True, True, False, False]
    assert list(read_stage(scan.stage_file).tiles) == [tile.name for tile in scan.tiles]
    other = TileFolder(scan.walk, (replace(scan.tiles[0], x_mm=1.0),), scan.folder, lambda: NOW)
    with pytest.raises(InputError, match="holds tiles of another plan"):
        other.resume()


def test_a_stop_ends_after_the_tile_under_way(scan: TileFolder) -> None:
    visits = scan.visit_all()
    next(visits)
    scan.walk.stop.set()
    assert list(visits) == []
    assert list(scan.taken) == ["tile_01_01"]


def test_the_simulated_rig_scans_an_area_that_mosaic_puts_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("monitor.commands.area.RealClock", lambda: AcceleratedClock(NOW))  # the rig's noise hangs on it
    Path("soil.yaml").write_text(SETTINGS)
    Path("exact.json").write_text(exact_calibration((240, 180)).to_json())
    assert run_tokens(["area", "soil.yaml", "--out", "crust", "--dry-run"]) == 0
    assert "2 tiles" in capsys.readouterr().out
    assert not Path("crust").exists()
    assert run_tokens(["area", "soil.yaml", "--out", "crust"]) == 75  # unplugged at the second tile, and one try only
    said = capsys.readouterr()
    assert "tile_01_01: taken" in said.out
    assert "the camera does not answer; is it plugged in?" in said.err
    assert run_tokens(["area", "soil.yaml", "--out", "crust", "--height-map", "all.tif"]) == 0
    said_again = capsys.readouterr().out
    assert "tile_01_01: taken" not in said_again  # it was there
    assert "2 of 2 tiles are in crust" in said_again
    stage = SimulatedStage(error_mm=0.02)
    stage.open()
    stage.move_to(5.0, 0.0)
    real = stage.sample_mm
    line = re.search(r"tile_01_02 +(-?[\d.]+) +(-?[\d.]+) ", said_again)
    assert line is not None
    assert [float(line[1]), float(line[2])] == pytest.approx(real, abs=0.005)
    scan = read_height_map(Path("all.tif"), print)
    assert scan.grid.columns * scan.grid.pitch_mm > 17.0  # one field is about 15 mm wide
    assert scan.coverage > 0.9
    assert scan.grid.pitch_mm == pytest.approx(0.1), "the campaign's"


def test_a_simulated_stage_does_not_carry_what_a_real_rig_looks_at() -> None:
    with pytest.raises(
        InputError, match=r"area\.stage: the simulated stage carries the simulated rig's sample, and no"
    ):
        stage_of(area(), Rig())


def test_without_an_area_it_says_what_to_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "soil.yaml"
    file.write_text(SETTINGS[: SETTINGS.index("area:")])
    assert run_tokens(["area", str(file), "--out", str(tmp_path / "crust")]) == 2
    assert "has no `area:`: say where the stage goes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("x_mm: [9, 0]", r"soil\.yaml:12:9: area\.x_mm: must go from the lesser to the greater"),
        ("x_mm: [0, 0]", r"area\.x_mm: the stage goes nowhere"),
        ("axes: [x, -x]", r"area\.axes: must be one along x and one along y"),
        ("stage: {kind: gcoad}", r"soil\.yaml:11:\d+: area\.stage: .*did you mean 'gcode'"),
    ],
)
def test_a_wrong_area_is_told_at_its_place(
    wrong: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = wrong.partition(":")[0]
    lines = [line for line in SETTINGS.splitlines() if not line.strip().startswith(f"{key}:")]
    place = 11 if key != "stage" else 10
    lines.insert(place, f"  {wrong}")
    file = tmp_path / "soil.yaml"
    file.write_text("\n".join(lines))
    assert run_tokens(["area", str(file), "--out", str(tmp_path / "crust")]) == 2
    assert re.search(message, capsys.readouterr().err)
