"""``microrelief mosaic`` and ``microrelief merge`` on surfaces in closed form and on the simulated rig."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from monitor.cli import run_tokens
from monitor.rigs.simulated import SimulatedRig
from monitor.stitching import stitch
from monitor.views import pose_matrix
from pipelines import Calibration, PatternSet, Scan, parse_instant
from pipelines import reconstruction as rec
from pipelines.scenes import SCENES
from storage import read_height_map, write_height_map
from tests.pipelines.change.scans import bumps, sampled, scan_of

from .exact_rig import exact_calibration

SURFACE = bumps(seed=4)
NOISE = 0.003


def crack(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Relief with a crack of vertical walls across all tiles."""
    return SURFACE(x, y) - 0.5 * (np.abs(y - 2.9 - 0.1 * x) < 0.1)


def tiles_of(random: np.random.Generator) -> tuple[list[Scan], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """3 x 3 tiles with a fifth of overlap; commanded and real positions, 20 um apart."""
    row, column = np.divmod(np.arange(9), 3)
    commanded = np.stack([2.4 * column, 1.92 * row, 0.0 * row], axis=1)
    real = commanded + random.normal(0, 0.02, (9, 3)) * [1, 1, 0.2]
    real[0] = 0
    tiles = []
    for x, y, z in real:
        height = sampled(lambda u, v, x=x, y=y: crack(u + x, v + y), 120, 150) + z  # type: ignore[misc]
        height += random.normal(0, NOISE, height.shape)
        tiles.append(scan_of(height, sigma=NOISE))
    return tiles, commanded, real


def test_nine_tiles_find_their_places_and_blend_into_the_true_surface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    tiles, commanded, real = tiles_of(np.random.default_rng(0))
    # the sample of tile k lies at x + real: the stage moved it by -real
    lines = ["tile,x_mm,y_mm"]
    for number, (tile, (x, y, _)) in enumerate(zip(tiles, commanded, strict=True)):
        write_height_map(tile, f"t{number}.npz")
        lines.append(f"t{number},{-y:.3f},{x:.3f}")  # and its axes lie otherwise than the image's
    Path("stage.csv").write_text("\n".join(lines))
    names = [f"t{number}.npz" for number in range(9)]
    assert run_tokens(["mosaic", *names, "--stage", "stage.csv", "--out", "all.npz"]) == 0
    said = capsys.readouterr().out
    rows = re.findall(r"^t\d\.npz +(-?\d+\.\d+) +(-?\d+\.\d+) +(-?\d+\.\d+)", said, re.MULTILINE)
    found = np.array(rows, dtype=np.float64)
    error = np.stack([found[:, 1], -found[:, 0]], axis=1) - real[:, :2]
    assert np.abs(error).max() < 0.0015
    assert np.abs(found[:, 2] - real[:, 2]).max() < 0.0015
    ratios = [float(each) for each in re.findall(r"ratio (\d\.\d+)", said)]
    assert len(ratios) >= 12
    assert np.median(ratios) == pytest.approx(1, abs=0.2)
    area = read_height_map("all.npz")
    x, y = np.meshgrid(area.grid.x_mm, area.grid.y_mm)
    truth = crack(x, y)
    assert np.isfinite(area.height[5:-5, 5:-5]).all()
    far = np.abs(np.abs(y - 2.9 - 0.1 * x) - 0.1) > 0.03  # beyond a cell and a half from the walls
    error = (area.height - truth)[far & np.isfinite(area.height)]
    assert (np.abs(error) > 0.1).mean() < 1e-4  # nothing is smeared between rim and floor
    sigma = area.sigma[far & np.isfinite(area.height)]
    inner = np.abs(error) < 0.1
    assert 1.4826 * np.median(np.abs(error[inner] / sigma[inner])) == pytest.approx(1, abs=0.15)


def test_the_uncertainty_of_a_place_is_of_the_right_size() -> None:
    scores = []
    for seed in range(2):
        tiles, commanded, real = tiles_of(np.random.default_rng(10 + seed))
        found = stitch(tiles, -commanded, axes=("x", "y"), stage_sigma_mm=0.05)
        assert not found.failed
        error = -found.placement.position_mm - real
        scores.append(error[1:, :2] / found.placement.sigma_mm[1:, :2])
    assert 0.2 < np.sqrt(np.mean(np.square(scores))) < 2


@pytest.fixture(scope="module")
def two_views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated rig sees soil, then the same soil turned by half a turn and shifted: other walls in shadow."""
    folder = tmp_path_factory.mktemp("views")
    rig = exact_calibration((480, 360))
    (folder / "rig.json").write_text(rig.to_json())
    simulated = SimulatedRig(camera=(480, 360))
    simulated.open()
    patterns, grid = PatternSet("gray", (608, 684)), rec.footprint_grid(rig)
    for number, (degrees, shift) in enumerate(((0.0, (0.0, 0.0, 0.0)), (180.0, (0.11, -0.07, 0.02)))):
        frames = simulated.capture_posed(patterns, parse_instant("2026-01-01T00:00:00Z"), (0, 0, degrees), shift)
        write_height_map(
            rec.to_scan(rec.reconstruct(frames, rig), rig, grid, frames.time), folder / f"view{number}.npz"
        )
    simulated.close()
    return folder


def test_two_sides_of_a_crack_make_one(
    two_views: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(two_views)
    Path("turns.yaml").write_text("tiles: {view0: [0, 0, 0, 0], view1: [0.15, 0, 0, 179.7]}\n")
    words = ["merge", "view0.npz", "view1.npz", "--stage", "turns.yaml", "--calibration", "rig.json", "--out", "m.npz"]
    assert run_tokens(words) == 0
    said = capsys.readouterr().out
    turned, x, y, z = (float(each) for each in re.findall(r"[-+]\d+\.\d+", said)[:4])
    assert abs(abs(turned) - 180) < 0.03
    assert [x, y, z] == pytest.approx([0.11, -0.07, -0.02], abs=0.003)
    shares, ratios = [], []
    for name in ("view0.npz", "view1.npz", "m.npz"):
        scan = read_height_map(name)
        x_mm, y_mm = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
        if name == "view1.npz":  # where its cells lie in the soil's frame
            back = pose_matrix(0.11, -0.07, 0.02, 180)
            x_mm, y_mm = back[0, 0] * x_mm + back[0, 3], back[1, 1] * y_mm + back[1, 3]
        truth = SCENES["soil"]().at(x_mm, y_mm).height(0.0)
        inside = (np.abs(x_mm) < 4.9) & (np.abs(y_mm) < 4.9)
        slope = np.hypot(*np.gradient(truth, scan.grid.pitch_mm))
        steep = inside & (slope > 1.5)
        shares.append(float(np.isfinite(scan.height[steep]).mean()))
        sure = inside & (slope < 0.5) & np.isfinite(scan.height) & (scan.level < rec.LEVEL_CONTESTED)
        error = (scan.height - truth)[sure]
        ratios.append(1.4826 * float(np.median(np.abs(error - np.median(error)) / scan.sigma[sure])))
    print(f"walls covered {np.round(shares, 3)}, error over sigma {np.round(ratios, 2)}")
    assert shares[2] > max(shares[:2]) + 0.1
    assert shares[2] > 0.9
    assert ratios[2] == pytest.approx(np.mean(ratios[:2]), rel=0.15)  # as true as the views' own


def test_rigs_that_saw_one_board_are_brought_into_one_frame(two_views: Path) -> None:
    rig = Calibration.from_json((two_views / "rig.json").read_text())
    columns, rows = 6, 5
    lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) - [2.5, 2.0]

    def calibrated(turn_deg: float, x: float, y: float, backwards: bool) -> Calibration:
        """This rig, having seen the board turned and shifted in its site frame."""
        a = np.deg2rad(turn_deg)
        site = lattice @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + [x, y]
        camera = (np.c_[site, np.zeros(len(site))] - rig.reference[:, 3]) @ rig.reference[:, :3]
        from pipelines.reconstruction.pinhole import project

        seen = project(rig.camera, camera)
        seen = seen[::-1] if backwards else seen
        nothing = (0.0, 0.0, None, None, None, None, True)
        corners = tuple(rec.CornerResidual(float(c), float(r), *nothing) for c, r in seen)
        pose = rec.PoseResidual("flat", 0.1, 0.1, 30, 30, corners=corners)
        return replace(rig, poses=(pose,), board={"inner_corners": [columns, rows], "square_mm": 1.0})

    first, second = calibrated(10, 0.2, -0.1, False), calibrated(-35, -0.3, 0.25, True)
    motions = rec.site_to_site(second, first)
    # a point of the board has these coordinates in both site frames
    a, b = np.deg2rad(10), np.deg2rad(-35)
    p = np.array([1.5, 1.0])
    one = [np.cos(a) * p[0] - np.sin(a) * p[1] + 0.2, np.sin(a) * p[0] + np.cos(a) * p[1] - 0.1]
    two = [np.cos(b) * p[0] - np.sin(b) * p[1] - 0.3, np.sin(b) * p[0] + np.cos(b) * p[1] + 0.25]
    off = [float(np.abs((m @ [*two, 0, 1])[:2] - one).max()) for m in motions]
    assert len(motions) == 2
    assert min(off) < 1e-3  # one of the two half turns
    with pytest.raises(ValueError, match="not of one board"):
        rec.site_to_site(replace(second, board={"inner_corners": [7, 5], "square_mm": 1.0}), first)


@pytest.mark.parametrize("command", ["mosaic", "merge"])
def test_help_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens([command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "Example" in shown
    assert f"microrelief {command} " in shown
