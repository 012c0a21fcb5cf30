"""Everything a beginner gets wrong: one clear line, the right exit code, nothing left; and what must simply work."""

from __future__ import annotations

import json
import logging
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from monitor.cli import run_tokens
from pipelines import Calibration, Grid, Lens, PatternSet, Scan, Tick
from storage import create_store, write_patterns

from .mistakes import REFUSED, WORKS

CAMERA = (160, 120)
PATTERNS = PatternSet("gray", (200, 120), bits=(8, 7))
DISPARITY = 20
CAMPAIGN = """\
site: {name: Plot}
store: {path: plot.icechunk}
rig: {name: simulated, options: {camera: [160, 120]}}
schedule: {every: 6 h}
calibration: {simulated: true}
metrics: [net_volume]
"""

Edit = Callable[[int, npt.NDArray[Any]], npt.NDArray[Any] | None]


def seen(number: int, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """What a camera sees of a projected image on an even plane, facing both."""
    return np.ascontiguousarray(image[: CAMERA[1], DISPARITY : DISPARITY + CAMERA[0]] // 255 * 180 + 20)


def write_frames(folder: Path, edit: Edit = lambda number, image: image, suffix: str = ".png") -> Path:
    folder.mkdir(parents=True)
    for number, image in enumerate(PATTERNS.images()):
        changed = edit(number, seen(number, image))
        if changed is not None:
            cv2.imwrite(str(folder / f"{number}{suffix}"), changed)
    return folder


def chessboard() -> npt.NDArray[np.float64]:
    """8x6 squares of 16 px on a white ground."""
    row, column = np.mgrid[0 : CAMERA[1], 0 : CAMERA[0]]
    dark = ((row - 12) // 16 + (column - 16) // 16) % 2 == 1
    board = (row >= 12) & (row < 108) & (column >= 16) & (column < 144)
    return np.where(board & dark, 0.2, 1.0)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that the tables name."""
    here = tmp_path_factory.mktemp("bad")
    grey = write_frames(here / "plain")
    for name in ("plain2", "plain3", "many/a", "many/b", "broken", "more", "stray", "result", "inside"):
        shutil.copytree(grey, here / name)
    write_frames(here / "sizes", lambda n, image: image[:-2] if n == 7 else image)
    write_frames(here / "depths", lambda n, image: image.astype(np.uint16) * 257 if n == 7 else image)
    write_frames(here / "fewer", lambda n, image: None if n == 5 else image)
    write_frames(here / "float", lambda n, image: image.astype(np.float32), ".tiff")
    write_frames(here / "colour", lambda n, image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    write_frames(here / "mixed", lambda n, image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if n % 3 else image)
    write_frames(here / "alpha", lambda n, image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGRA))
    write_frames(here / "deep", lambda n, image: image.astype(np.uint16) * 257)
    write_frames(here / "twelve", lambda n, image: image.astype(np.uint16) * 16, ".tiff")
    write_frames(here / "dark", lambda n, image: image // 200)
    write_frames(here / "small", lambda n, image: image[:60, :80])
    for number in range(3):
        write_frames(here / f"board{number}", lambda n, image: (image * chessboard()).astype(np.uint8))
    (here / "broken" / "7.png").write_bytes((grey / "7.png").read_bytes()[:60])
    shutil.copy(grey / "0.png", here / "more" / "32.png")
    cv2.imwrite(str(here / "stray" / "Screenshot.png"), np.zeros((40, 50, 3), np.uint8))
    (here / "stray" / "notes.txt").write_text("north side")
    cv2.imwrite(str(here / "result" / "height.tif"), np.zeros((12, 16), np.float32))
    (here / "inside" / "old.png").mkdir()
    names = [f"{number}.png" for number in range(32)]
    for name, listed in (("twice", [*names[:-1], "0.png"]), ("absent", [*names[:-1], "99.png"])):
        shutil.copytree(grey, here / name)
        about = {"microrelief_capture": 1, "patterns": PATTERNS.as_mapping(), "frames": listed}
        (here / name / "capture.json").write_text(json.dumps(about))
    shutil.copytree(grey, here / "nojson")
    (here / "nojson" / "capture.json").write_text("{")
    for name in ("empty", "noarray", "folder.nc", "folder.json"):
        (here / name).mkdir()
    (here / "noarray" / "frames.npy").write_text("no array")
    (here / "text.txt").write_text("hello")
    lens = Lens(CAMERA, np.array([[200.0, 0, 79.5], [0, 200.0, 59.5], [0, 0, 1]]), np.zeros(5))
    projector = Lens(PATTERNS.size, np.array([[200.0, 0, 79.5], [0, 200.0, 59.5], [0, 0, 1]]), np.zeros(5))
    site = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 100]])
    rig = Calibration(lens, projector, np.eye(3), np.array([10.0, 0, 0]), site, {"stereo": 0.1})
    (here / "rig.json").write_text(rig.to_json())
    write_patterns(PATTERNS, here / "patterns")
    text = (here / "patterns" / "patterns.yaml").read_text()
    (here / "swapped.yaml").write_text(text.replace("columns, rows]", "rows, columns]"))
    (here / "typo.yaml").write_text(text.replace("size:", "sizes:"))
    (here / "cut.yaml").write_text(text.replace("120]", "120", 1))
    for number in range(2):
        height = cv2.GaussianBlur(np.random.default_rng(number).normal(0, 1, (60, 60)).astype(np.float32), (0, 0), 3)
        np.savez(here / f"h{number}.npz", height=height, pitch_mm=0.02)
    np.savez(here / "h2.npz", height=height, pitch_mm=0.02, x0_mm=500.0)
    (here / "stage.csv").write_text("tile,x_mm,y_mm\nh0,0,0\nh1,900,0\n")
    (here / "comma.csv").write_text("tile,x_mm,y_mm\nh0,0,5,0,5\nh1,1,0\n")
    (here / "axes.yaml").write_text("axes: [x, -x]\ntiles: {h0: [0, 0], h1: [1, 0]}\n")
    (here / "campaign.yaml").write_text(CAMPAIGN)
    (here / "typo-campaign.yaml").write_text(CAMPAIGN.replace("every", "evry"))
    (here / "rig-option.yaml").write_text(CAMPAIGN.replace("camera", "camra"))
    (here / "tab.yaml").write_text(CAMPAIGN.replace("site: {name: Plot}", "site:\n\tname: Plot"))
    create_store(here / "bare.icechunk", site="Plot", grid=Grid(10, 12, 0.1), metrics={"net_volume": "mm3"}).close()
    (here / "cloud.xyz").write_text("".join(f"{n % 9} {n // 9} {n / 7:.3f}\n" for n in range(81)))
    with closing(create_store(here / "maps.icechunk", site="Plot", grid=Grid(4, 5, 0.1))) as store:
        for number in range(2):
            cells = np.full((4, 5), 0.1 * number, np.float32)
            level = np.zeros((4, 5), np.uint8)
            time = np.datetime64(f"2026-11-2{number}T21:00:00", "ns")
            store.append(Tick(time, Scan(Grid(4, 5, 0.1), time, cells, cells * 0 + 0.01, level, level)))
    return here


@pytest.fixture(scope="module")
def busy() -> Iterator[int]:
    """A port that somebody listens on."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield int(taken.getsockname()[1])


def begin(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in the folder, with the log of a new process: an earlier command line may have set it up."""
    monkeypatch.chdir(place)
    monkeypatch.setattr(logging.getLogger("microrelief"), "handlers", [])
    monkeypatch.setattr(logging.getLogger("microrelief"), "propagate", False)


def words(line: str, port: int) -> list[str]:
    return shlex.split(
        line.format(
            rec="reconstruct --calibration rig.json",
            out="--patterns patterns/patterns.yaml --out o.npz",
            pat="--patterns patterns/patterns.yaml",
            board="--board 7x5 --square-mm 2",
            poses="board0 board1 board2",
            busy=port,
        )
    )


def told(text: str) -> list[str]:
    """Lines for a person, less the progress of long work."""
    return [line for line in text.splitlines() if not re.match(r"[a-z ]+: \d+ of \d+$", line)]


def contents(folder: Path) -> set[str]:
    return {str(each.relative_to(folder)) for each in folder.rglob("*")}


@pytest.mark.parametrize(("what", "line", "code", "expected"), REFUSED, ids=[row[0] for row in REFUSED])
def test_one_clear_line_and_nothing_left(
    place: Path,
    busy: int,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    what: str,
    line: str,
    code: int,
    expected: str,
) -> None:
    begin(place, monkeypatch)
    before = contents(place)
    assert run_tokens(words(line, busy)) == code
    said = told(capfd.readouterr().err)  # by file descriptor: what C libraries print counts too
    assert len(said) == 1, said
    assert re.search(expected.replace("{busy}", str(busy)), said[0]), said[0]
    assert contents(place) == before


@pytest.mark.parametrize(("what", "line", "expected", "aside"), WORKS, ids=[row[0] for row in WORKS])
def test_what_is_no_mistake_works(
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    what: str,
    line: str,
    expected: str,
    aside: str,
) -> None:
    begin(place, monkeypatch)
    assert run_tokens(words(line, 0)) == 0
    out, err = capfd.readouterr()
    assert re.search(expected, out, re.DOTALL), out
    if "{out}" in line:
        with np.load("o.npz") as points:
            depth = points["xyz"][..., 2]
        assert np.nanmedian(depth) == pytest.approx(200 * 10 / DISPARITY, rel=1e-3)
        Path("o.npz").unlink()
    shutil.rmtree("o", ignore_errors=True)
    said = told(err)
    assert len(said) == bool(aside), said
    assert re.search(aside, "".join(said)), said


@pytest.mark.parametrize(
    ("line", "code", "expected"),
    [
        (
            "reconstruct broken --calibration rig.json --patterns patterns/patterns.yaml --out o.npz",
            2,
            "7.png: is not a whole image",
        ),
        ("run typo-campaign.yaml", 2, "typo-campaign.yaml:4:12:"),
        ("status empty", 1, "empty: is no store"),
    ],
)
def test_the_program_itself_says_one_line(place: Path, line: str, code: int, expected: str) -> None:
    command = [sys.executable, "-m", "monitor.cli", *shlex.split(line)]
    root = str(Path(__file__).resolve().parents[2])
    before = contents(place)
    done = subprocess.run(
        command, cwd=place, env={**os.environ, "PYTHONPATH": root}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == code
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert expected in done.stderr
    assert contents(place) == before
