"""``microrelief calibrate`` and ``microrelief reconstruct`` as people call them, and what they do wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from monitor.cli import run_tokens
from pipelines import Calibration, Frames, PatternSet, parse_instant
from pipelines.reconstruction import Lens, PoseResidual, describe_calibration, rms_verdict
from storage import read_height_map, write_capture


@pytest.fixture(scope="module")
def data(shared_data: Path) -> Path:
    return shared_data / "rendered"


@pytest.fixture(scope="module")
def calibrated(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("rig") / "calibration.json"
    poses = [str(data / "calib" / f"pose{n}") for n in (0, 4, 8)]
    board = ["--board-squares", "9x16", "--square-mm", "0.85", "--reference", poses[1]]
    page = ["--report", str(file.with_suffix(".html"))]
    patterns = ["--patterns", str(data / "patterns.yaml")]
    code = run_tokens(["calibrate", *poses, *board, *patterns, "--out", str(file), *page])
    assert code == 0
    return file


def test_calibrate_writes_what_reconstruct_reads(
    data: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Calibration.from_json(calibrated.read_text())
    assert rig.rms_px["stereo"] < 0.2
    assert [pose.name for pose in rig.poses] == ["pose0", "pose4", "pose8"]
    assert rig.board == {"inner_corners": [8, 15], "square_mm": 0.85}
    assert "Calibration report" in calibrated.with_suffix(".html").read_text(encoding="utf-8")
    common = ["reconstruct", str(data / "t0"), "--calibration", str(calibrated)]
    common += ["--patterns", str(data / "patterns.yaml"), "--out"]
    assert run_tokens([*common, str(tmp_path / "t0.npz")]) == 0
    with np.load(tmp_path / "t0.npz") as points:
        assert points["xyz"].shape == (540, 960, 3)
        assert points["xyz"].dtype == np.float32
        assert points["projector"].shape == (540, 960, 2)
        seen = np.isfinite(points["sigma_z"])
        assert (seen == np.isfinite(points["xyz"][..., 2])).all()
        assert seen.mean() > 0.9
        # where the finest stripes are not resolved, in a few tiles, coarser ones stand in
        assert (points["level"][seen] == 0).mean() > 0.99
        assert points["level"][seen].max() <= 3
        known = np.load(data / "t0" / "truth_camera.npz")
        both = seen & known["lit"].astype(bool)
        assert np.median(np.abs(points["projector"][..., 0] - known["proj_col"])[both]) < 0.1
    for suffix in (".nc", ".tif", ".ply"):
        assert run_tokens([*common, str(tmp_path / f"t0{suffix}")]) == 0
    scan = read_height_map(tmp_path / "t0.nc")
    assert scan.coverage > 0.7
    said = capsys.readouterr().out
    assert "sigma_z" in said
    assert f"wrote {tmp_path / 't0.ply'}" in said


def blank_capture(folder: Path, size: tuple[int, int] = (64, 48), patterns: PatternSet | None = None) -> Path:
    patterns = patterns or PatternSet("gray", (608, 684))
    stack = np.full((len(patterns.roles), size[1], size[0]), 30, np.uint8)
    write_capture(Frames(stack, parse_instant("2026-11-22T12:00:00Z"), patterns), folder)
    return folder


def line_of(capsys: pytest.CaptureFixture[str]) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("decoding poses")]
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["P0", "P1", "--board", "15x8", "--square-mm", "0.85"], "2 poses given, at least 3 are needed"),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "0.85"], "pose0: no board of 15x8 inner corners found"),
        (["P0", "P1", "P3", "--board", "15x8", "--square-mm", "0.85"], "pose3: images of 32x24, but pose0 has 64x48"),
        (["P0", "P1", "P4", "--board", "15x8", "--square-mm", "0.85"], "pose4: its patterns are for another projector"),
        (["P0", "P1", "P5", "--board", "15x8", "--square-mm", "0.85"], "patterns along both axes"),
        (["P0", "P1", "gone", "--board", "15x8", "--square-mm", "0.85"], "gone: no such folder"),
        (
            ["P0", "P1", "P2", "--board", "15by8", "--square-mm", "0.85"],
            "--board 15by8: write two numbers such as 15x8",
        ),
        (["P0", "P1", "P2", "--board", "15x1", "--square-mm", "0.85"], "--board 15x1: a board of 15x1 inner corners"),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "-1"], "positive number of mm"),
        (["P0", "P1", "P2", "--square-mm", "0.85"], "either as --board 15x8"),
        (
            ["P0", "P1", "P2", "--charuco", "5X5_100", "--board-squares", "7x5", "--square-mm", "1"],
            "a ChArUco board needs --charuco DICT --board-squares 7x5 --square-mm and --marker-mm",
        ),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "1", "--marker-mm", "1"], "is for ChArUco boards"),
        (
            [
                "P0",
                "P1",
                "P2",
                "--charuco",
                "5X5_100",
                "--board-squares",
                "7x5",
                "--square-mm",
                "1",
                "--marker-mm",
                "2",
            ],
            "the side of a marker must be smaller than its square of 1.0 mm",
        ),
        (
            ["P0", "P1", "P2", "--charuco", "CODE", "--board-squares", "7x5", "--square-mm", "1", "--marker-mm", ".7"],
            "no marker dictionary 'CODE'; there are DICT_",
        ),
        (
            [
                "P0",
                "P1",
                "P2",
                "--charuco",
                "4X4_50",
                "--board-squares",
                "7x5",
                "--square-mm",
                "1",
                "--marker-mm",
                ".7",
            ],
            "pose0: no ChArUco board of 7x5 squares: no marker of 4X4_50 is seen",
        ),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "1", "--report", "r.pdf"], "a report is an .html file"),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "1", "--report", "no/r.html"], "there is no folder no"),
        (["P0", "P1", "P2", "--board", "15x8"], "--square-mm"),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "1", "--out", "c.yaml"], "a calibration is a .json file"),
        (["P0", "P1", "P2", "--board", "15x8", "--square-mm", "1", "--patterns", "no.yaml"], "no such pattern file"),
    ],
)
def test_what_a_beginner_does_wrong_in_calibrate(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for number in range(3):
        blank_capture(tmp_path / f"pose{number}")
    blank_capture(tmp_path / "pose3", (32, 24))
    blank_capture(tmp_path / "pose4", patterns=PatternSet("gray", (640, 480)))
    blank_capture(tmp_path / "pose5", patterns=PatternSet("gray", (608, 684), (10, 0)))
    tokens = [f"pose{word[1]}" if word[0] == "P" else word for word in words]
    assert run_tokens(["calibrate", *tokens]) == 2
    assert expected in line_of(capsys)
    assert not Path("calibration.json").exists()


def some_rig() -> Calibration:
    lens = Lens((64, 48), np.diag([100.0, 100, 1]), np.zeros(5))
    return Calibration(
        camera=lens,
        projector=replace(lens, size=(608, 684)),
        R=np.eye(3),
        t_mm=np.array([20.0, 0, 0]),
        reference=np.eye(3, 4),
        rms_px={"camera": 0.1, "projector": 0.2, "stereo": 0.16},
        poses=(PoseResidual("flat", 0.1, 0.2, 119, 120, ((31.5, 7.25),)),),
    )


@pytest.mark.parametrize(
    ("words", "expected", "code"),
    [
        (["capture", "--calibration", "rig.json", "--out", "a.xls"], "unknown suffix '.xls'", 2),
        (["capture", "--calibration", "rig.json", "--out", "no/a.npz"], "there is no folder no", 2),
        (["capture", "--calibration", "no.json", "--out", "a.npz"], "no.json: no such calibration file", 2),
        (["capture", "--calibration", "bad.json", "--out", "a.npz"], "bad.json: calibration lacks 'camera'", 2),
        (["capture", "--calibration", "text.json", "--out", "a.npz"], "text.json: not JSON", 2),
        (["gone", "--calibration", "rig.json", "--out", "a.npz"], "gone: no such folder", 2),
        (
            ["small", "--calibration", "rig.json", "--out", "a.npz"],
            "images of 32x24, but the calibration is for 64x48",
            2,
        ),
        (["other", "--calibration", "rig.json", "--out", "a.npz"], "patterns for a projector of 640x480, but", 2),
        (["capture", "--calibration", "rig.json", "--out", "a.nc", "--pitch-mm", "0"], "must be a positive number", 2),
        (["capture", "--calibration", "rig.json", "--out", "a.npz"], "not one pixel could be measured", 1),
    ],
)
def test_what_a_beginner_does_wrong_in_reconstruct(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    expected: str,
    code: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    blank_capture(tmp_path / "capture")
    blank_capture(tmp_path / "small", (32, 24))
    blank_capture(tmp_path / "other", patterns=PatternSet("gray", (640, 480)))
    (tmp_path / "rig.json").write_text(some_rig().to_json())
    (tmp_path / "bad.json").write_text("{}")
    (tmp_path / "text.json").write_text("hello")
    assert run_tokens(["reconstruct", *words]) == code
    assert expected in line_of(capsys)
    assert not list(tmp_path.glob("a.*"))


def test_what_run_refuses_reconstruct_refuses_unless_forced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two frames swapped: the same verdict as `run`; --force goes on and says so."""
    patterns = PatternSet("gray", (200, 120), bits=(8, 7))
    noise = np.random.default_rng(0).normal(0, 2, (len(patterns.roles), 96, 128))
    albedo = 0.8 + 0.2 * np.sin(np.arange(128) / 5) * np.cos(np.arange(96) / 4)[:, None]
    light = (patterns.images()[:, 12:108, 20:148] / 255 * 170 + 20) * albedo
    stack = np.clip(light + noise, 0, 255).astype(np.uint8)
    swapped = stack.copy()
    swapped[[4, 9]] = stack[[9, 4]]
    for name, frames in (("good", stack), ("swapped", swapped)):
        write_capture(Frames(frames, parse_instant("2026-11-22T12:00:00Z"), patterns), tmp_path / name)
    lens = Lens((128, 96), np.array([[200.0, 0, 59.5], [0, 200, 47.5], [0, 0, 1]]), np.zeros(5))
    projector = Lens((200, 120), np.array([[200.0, 0, 59.5], [0, 200, 59.5], [0, 0, 1]]), np.zeros(5))
    site = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 100]])
    rig = Calibration(lens, projector, np.eye(3), np.array([10.0, 0, 0]), site, {"stereo": 0.1})
    (tmp_path / "rig.json").write_text(rig.to_json())
    out = tmp_path / "o.npz"
    rest = ["--calibration", str(tmp_path / "rig.json"), "--out", str(out)]
    assert run_tokens(["reconstruct", str(tmp_path / "good"), *rest]) == 0
    assert capsys.readouterr().err == ""
    out.unlink()
    assert run_tokens(["reconstruct", str(tmp_path / "swapped"), *rest]) == 1
    line = line_of(capsys)
    assert "swapped: two frames swapped" in line
    assert line.endswith("(--force reconstructs it all the same)")
    assert not out.exists()
    assert run_tokens(["reconstruct", str(tmp_path / "swapped"), *rest, "--force"]) == 0
    assert "reconstructed by force: two frames swapped" in line_of(capsys)
    assert out.exists()


def test_a_calibration_is_told_in_words() -> None:
    rig = Calibration.from_json(some_rig().to_json())
    text = "\n".join(describe_calibration(rig))
    assert "flat      0.100         0.200  119 of 120" in text
    assert "flat: corners left out at image column, row: (32, 7)" in text
    assert "stereo rms 0.160 px: good (under 0.5 px)" in text
    assert "mirror" not in text
    mirrored = replace(rig, camera=replace(rig.camera, K=np.diag([-100.0, 100, 1])))
    assert "taken to be the camera" in "\n".join(describe_calibration(mirrored))
    assert rms_verdict(0.7).startswith("usable")
    assert rms_verdict(12.0).startswith("bad")


@pytest.mark.parametrize("command", ["calibrate", "reconstruct"])
def test_help_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens([command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "Example" in shown
    assert f"microrelief {command} " in shown
