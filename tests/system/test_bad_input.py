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

REFUSED = [
    # what, command line, exit code, words that must appear
    ("a missing capture", "{rec} gone {out}", 2, "gone: no such folder"),
    (
        "a file instead of a folder",
        "{rec} rig.json {out}",
        2,
        "is a file, a capture is a folder",
    ),
    ("an empty folder", "{rec} empty {out}", 2, "empty: no frames in it .PNG, TIFF"),
    ("an empty folder, no patterns", "{rec} empty --out o.npz", 2, "empty: no frames in it"),
    ("the folder of the captures", "{rec} many --out o.npz", 2, "many: no frames in it.*name one: a, b"),
    (
        "nothing says what was projected",
        "{rec} plain --out o.npz",
        2,
        "name the pattern file with --patterns",
    ),
    ("frames of two sizes", "{rec} sizes {out}", 2, "7.png: is 160x118, 31 of 32 frames are"),
    ("frames of two depths", "{rec} depths {out}", 2, "7.png: has 16 bits, most frames have 8"),
    ("a broken image", "{rec} broken {out}", 2, "7.png: is not a whole image"),
    ("floating-point images", "{rec} float {out}", 2, "0.tiff: has values of type float32"),
    ("a frame is missing", "{rec} fewer {out}", 2, "found 31 frames, .* has 32: take the cap"),
    ("an image too many", "{rec} more {out}", 2, "found 33 frames, .* has 32: move what is no"),
    ("a frame named twice", "{rec} twice --out o.npz", 2, "capture.json: frames names 0.png twice"),
    ("a frame that is not there", "{rec} absent --out o.npz", 2, "99.png: missing, capture.json names it"),
    ("broken JSON", "{rec} nojson --out o.npz", 2, "capture.json:1:2: not JSON"),
    ("an array that is none", "{rec} noarray {out}", 2, "frames.npy: is no whole array"),
    ("columns and rows swapped", "{rec} plain --patterns swapped.yaml --out o.npz", 2, "not in the order"),
    (
        "a typo in the pattern file",
        "{rec} plain --patterns typo.yaml --out o.npz",
        2,
        "typo.yaml:2:1: .*did you",
    ),
    (
        "pattern YAML that is none",
        "{rec} plain --patterns cut.yaml --out o.npz",
        2,
        "cut.yaml:.*: not YAML",
    ),
    (
        "no pattern file there",
        "{rec} plain --patterns no.yaml --out o.npz",
        2,
        "no.yaml: no such pattern file",
    ),
    ("too dark", "{rec} dark {out}", 1, "not one pixel could be measured"),
    ("another camera size", "{rec} small {out}", 2, "but the calibration is for 160x120"),
    (
        "no calibration",
        "reconstruct plain --calibration no.json {pat} --out o.npz",
        2,
        "`microrelief calibrate` makes one",
    ),
    (
        "a calibration that is none",
        "reconstruct plain --calibration text.txt {pat} --out o.npz",
        2,
        "text.txt: not JSON",
    ),
    ("an unknown suffix", "{rec} plain {pat} --out o.xls", 2, "unknown suffix '.xls': use .npz"),
    ("--out is a folder", "{rec} plain {pat} --out folder.nc", 2, "folder.nc: is a folder, name a file"),
    ("--out in no folder", "{rec} plain {pat} --out no/o.npz", 2, "there is no folder no"),
    (
        "a pitch in the wrong unit",
        "{rec} plain {pat} --out o.nc --pitch-mm 1e-6",
        2,
        "--pitch-mm 1e-06: makes",
    ),
    ("two poses", "calibrate board0 board1 {board} {pat}", 2, "2 poses given, at least 3 are needed"),
    ("a pose given twice", "calibrate board0 board1 board0 {board} {pat}", 2, "board0: given twice"),
    (
        "the wrong board size",
        "calibrate {poses} --board 8x5 --square-mm 2 {pat}",
        2,
        "board looks like 7x5: give --board 7x5",
    ),
    (
        "squares for corners",
        "calibrate {poses} --board 8x6 --square-mm 2 {pat}",
        2,
        "board looks like 7x5: give --board 7x5",
    ),
    ("no board in sight", "calibrate plain plain2 plain3 {board} {pat}", 2, "plain: no board of 7x5 inner corners"),
    (
        "a board size in words",
        "calibrate {poses} --board 7by5 --square-mm 2 {pat}",
        2,
        "write two numbers such as 15x8",
    ),
    ("a decimal comma", "calibrate {poses} --board 7x5 --square-mm 0,7 {pat}", 2, "--square-mm"),
    ("a square of no size", "calibrate {poses} --board 7x5 --square-mm 0 {pat}", 2, "--square-mm 0: .*positive number"),
    ("the calibration is a folder", "calibrate {poses} {board} {pat} --out folder.json", 2, "folder.json: is a folder"),
    ("a typo in a campaign", "run typo-campaign.yaml --dry-run", 2, "typo-campaign.yaml:4:12: .*did you mean 'every'"),
    ("a tab in a campaign", "run tab.yaml --dry-run", 2, "tab.yaml:2:1: not YAML: a tab: indent with spaces"),
    ("a campaign that is not there", "run no.yaml", 2, "no.yaml: no such campaign file; `microrelief init DIR`"),
    (
        "a wrong option of the rig",
        "run rig-option.yaml --dry-run",
        2,
        "rig.options.camra: unknown .*did you mean 'camera'",
    ),
    ("video of a campaign without", "video campaign.yaml", 2, "its schedule is no video"),
    ("status of nothing", "status gone.icechunk", 1, "gone.icechunk: no such store"),
    ("status of some folder", "status empty", 1, "empty: is no store"),
    ("review of a file", "review text.txt --save o.rrd", 1, "text.txt: is a file, not a store"),
    ("review of some folder", "review plain --save o.rrd", 1, "plain: is no store"),
    ("review of an empty store", "review bare.icechunk --save o.rrd", 1, "holds no scan yet"),
    ("a busy port", "review bare.icechunk --web --port {busy}", 1, "port {busy} cannot be used .*another with --port"),
    ("a port that cannot be", "review bare.icechunk --web --port 70000", 2, "port 70000 does not exist"),
    ("report of some folder", "report plain --out o", 1, "plain: is no store"),
    ("report into a file", "report bare.icechunk --out text.txt", 1, "text.txt: cannot write the report there"),
    ("report to nowhere", "report bare.icechunk", 2, "--out is missing; see `microrelief report --help`"),
    ("an option without its value", "review bare.icechunk --save", 2, "--save needs a value; see `microrelief review"),
    ("process of some folder", "process plain", 1, "plain: is no store"),
    ("process of an empty store", "process bare.icechunk", 2, "bare.icechunk: holds no scan yet"),
    ("process with no worker", "process bare.icechunk --workers 0", 2, "--workers must be at least 1, not 0"),
    (
        "process here and there",
        "process bare.icechunk --workers 2 --scheduler tcp://127.0.0.1:1",
        2,
        "--workers and --scheduler exclude each other",
    ),
    ("process a scan that is not there", "process maps.icechunk --from 7", 2, "--from 7: there is no such scan"),
    ("process from a time in words", "process maps.icechunk --from noon", 2, "--from: 'noon' is not a time"),
    ("process nothing", "process maps.icechunk --from 1 --to 0", 2, "no scan lies between them"),
    ("ingest of nothing", "ingest new.icechunk", 2, "FILES is missing; see `microrelief ingest --help`"),
    ("ingest of a file that is not there", "ingest new.icechunk gone.tif", 2, "gone.tif: no such file"),
    ("ingest of a picture", "ingest new.icechunk plain/0.png", 2, "cannot be read from '.png': give one of .npz"),
    ("ingest into some folder", "ingest plain result/height.tif", 1, "plain: is no store"),
    ("ingest of a map without cells", "ingest new.icechunk result/height.tif", 2, "no pixel scale and tie point"),
    (
        "ingest with a unit that is none",
        "ingest new.icechunk cloud.xyz --unit inch --time 2026-11-22T21:00:00Z",
        2,
        "length unit 'inch' is not known",
    ),
    ("ingest at a time without a zone", "ingest new.icechunk cloud.xyz --time 2026-11-22T21:00", 2, "has no time zone"),
    (
        "ingest with a metric that is none",
        "ingest new.icechunk cloud.xyz --time 2026-11-22T21:00:00Z --metric net_volum",
        2,
        "no such metric, did you mean 'net_volume'",
    ),
    ("export of some folder", "export plain --scan 0 --out o.tif", 1, "plain: is no store"),
    ("export of an empty store", "export bare.icechunk --scan 0 --out o.tif", 2, "holds no scan yet"),
    ("export of no scan", "export maps.icechunk --out o.tif", 2, "--scan is missing: a number or a time"),
    ("export of a scan that is not there", "export maps.icechunk --scan 7 --out o.tif", 2, "the newest is 1"),
    ("export as what it cannot be", "export maps.icechunk --scan 0 --out o.docx", 2, "choose one of .npz, .nc"),
    ("export of a baseline's change", "export maps.icechunk --scan 0 --change --out o.nc", 2, "it has no change"),
    ("export to nowhere", "export maps.icechunk --scan 0 --out no/o.nc", 2, "folder no does not exist"),
    ("patterns into a full folder", "patterns --out plain", 2, "plain: holds files already"),
    ("a pattern size in one number", "patterns --out o --size 608", 2, "give columns and rows, such as 608x684"),
    ("a demo of one scan", "demo --out o --scans 1", 2, "--scans must be at least 2"),
    ("a demo into a file", "demo --out text.txt", 2, "--out text.txt: cannot be written"),
    ("a mosaic of one tile", "mosaic h0.npz --stage stage.csv --out o.npz", 2, "needs two tiles or more"),
    ("tiles that do not overlap", "mosaic h0.npz h1.npz --stage stage.csv --out o.npz", 2, "h0.npz: overlaps no other"),
    ("no stage file", "mosaic h0.npz h1.npz --stage no.csv --out o.npz", 2, "no.csv: no such stage file"),
    ("a tile without a place", "mosaic h0.npz plain --stage stage.csv --out o.npz", 2, "no position of tile plain"),
    (
        "a decimal comma of the stage",
        "mosaic h0.npz h1.npz --stage comma.csv --out o.npz",
        2,
        "comma.csv:2: has 5 values",
    ),
    (
        "a stage file without tiles",
        "mosaic h0.npz h1.npz --stage typo.yaml --out o.npz",
        2,
        "typo.yaml:1:1: needs `tiles",
    ),
    (
        "axes that cannot be",
        "mosaic h0.npz h1.npz --stage axes.yaml --out o.npz",
        2,
        "axes.yaml:1:7: axes: must be two",
    ),
    ("a tile given twice", "mosaic h0.npz h0.npz --stage stage.csv --out o.npz", 2, "h0.npz: given twice"),
    ("a capture without calibration", "merge h0.npz plain --out o.npz", 2, "plain: is a capture, it needs the calibr"),
    ("views of two objects", "merge h0.npz h1.npz --out o.npz", 2, "h1.npz: does not fit h0.npz: .*--stage"),
    ("a turn and a board", "merge h0.npz h1.npz --stage stage.csv --same-board --out o.npz", 2, "told by one of them"),
    ("a merge into a folder", "merge h0.npz h1.npz --out folder.nc", 2, "folder.nc: is a folder, name a file"),
    (
        "a comparison with nothing",
        "compare h0.npz gone.npz --out o.npz",
        2,
        "gone.npz: no such capture folder or height",
    ),
    (
        "a comparison with text",
        "compare h0.npz text.txt --out o.npz",
        2,
        "text.txt: is no instrument file that can be read",
    ),
    ("a comparison into a picture", "compare h0.npz h1.npz --out o.tif", 2, "a comparison is an .npz file"),
    ("a method that is none", "compare h0.npz h1.npz --method icp --out o.npz", 2, "icp"),
    ("a radius in metres", "compare h0.npz h1.npz --radius 1e-4 --out o.npz", 2, "--radius 0.0001: must be more than"),
    (
        "a ball within a cell",
        "compare h0.npz h1.npz --normal-radius 0.01 --out o.npz",
        2,
        "--normal-radius 0.01: must be",
    ),
    ("a cylinder of no length", "compare h0.npz h1.npz --max-distance 0 --out o.npz", 2, "--max-distance 0: must be"),
    (
        "an error below zero",
        "compare h0.npz h1.npz --registration-error -1 --out o.npz",
        2,
        "--registration-error -1: ",
    ),
    (
        "maps that do not overlap",
        "compare h0.npz h2.npz --out o.npz",
        2,
        "h2.npz: has no measured cell in common with h0",
    ),
    (
        "maps that cannot be registered",
        "compare h0.npz h2.npz --register --out o.npz",
        1,
        "h2.npz: cannot be registered",
    ),
    ("a command that is none", "recnstruct plain", 2, "no command 'recnstruct', did you mean 'reconstruct'"),
]

WORKS = [
    # what, command line, words that must appear on standard output, words on standard error
    ("grey frames", "{rec} plain {out}", "measured 100.*wrote o.npz", ""),
    ("colour frames", "{rec} colour {out}", "measured 100.0 %", ""),
    ("colour frames among grey ones", "{rec} mixed {out}", "measured 100.0 %", ""),
    ("frames with an alpha channel", "{rec} alpha {out}", "measured 100.0 %", ""),
    ("16-bit frames", "{rec} deep {out}", "measured 100.0 %", ""),
    ("12 bits in 16", "{rec} twelve {out}", "measured 100.0 %", ""),
    ("10.png before 2.png", "{rec} many/a {out}", "measured 100.0 %", ""),
    (
        "stray files",
        "{rec} stray {out}",
        "measured 100.0 %",
        "skipped.*notes.txt, Screenshot.png",
    ),
    (
        "a stray image of floats",
        "{rec} result {out}",
        "measured 100.0 %",
        "skipped.*height.tif",
    ),
    (
        "a folder named as an image",
        "{rec} inside {out}",
        "measured 100.0 %",
        "skipped.*old.png",
    ),
    ("status of an empty store", "status bare.icechunk", "no scan yet", ""),
    ("report of an empty store", "report bare.icechunk --out o", "No data: The store holds no scan yet", ""),
]

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
