"""`microrelief resolution`: images and captures, edges and bars, focus series; mistakes in one line with code 2."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from monitor.cli import run_tokens
from monitor.rigs import SimulatedRig
from monitor.rigs.optics_model import paper_optics
from pipelines import Calibration, PatternSet, parse_instant
from pipelines.reconstruction import object_pixel_um
from storage import write_capture
from tests.pipelines.reconstruction.charts import bars, edge, true_resolution_um


def save(file: Path, image: npt.NDArray[np.uint8]) -> str:
    file.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    return str(file)


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    code = run_tokens(["resolution", *words])
    out, err = capsys.readouterr()
    return code, out, err


def test_an_edge_in_an_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = save(tmp_path / "chart.png", edge((200, 220), 2.0, 5.0))
    code, out, _ = run(capsys, image, "--pixel-um", "4", "--json")
    found = json.loads(out)["charts"][0]
    assert code == 0
    assert found["resolution_um"] == pytest.approx(true_resolution_um(2.0, 4.0), rel=0.05)
    assert found["threshold_reached"]
    _, out, _ = run(capsys, image, "--pixel-um", "4", "--roi", "20,20,160,160", "--threshold", "0.2")
    assert "resolves lines of 14" in out  # pi 2 4 / sqrt(-2 ln 0.2) = 14.0
    assert "at contrast 0.2" in out
    assert "20.00 um  contrast  0.4" in out


def test_bars_in_an_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image, elements = bars(2.5, 3.0)
    rois = [word for (g, e), box in elements.items() for word in ("--roi", f"{g}.{e}:{','.join(map(str, box))}")]
    _, out, _ = run(capsys, save(tmp_path / "usaf.png", image), "--pixel-um", "3", *rois, "--json")
    found = json.loads(out)["charts"][0]
    assert found["resolution_um"] == pytest.approx(true_resolution_um(2.5, 3.0), rel=0.05)
    assert len(found["line_um"]) == len(elements)


def test_depth_of_field_of_a_series(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images = [save(tmp_path / f"{n}.png", edge((200, 200), sigma, 5.0)) for n, sigma in enumerate((5.0, 1.5, 1.5, 5.0))]
    words = (*images, "--z-mm", "-3,-1,1,3", "--pixel-um", "4")
    code, out, _ = run(capsys, *words, "--line-um", "20")
    assert code == 0
    assert "at z -3 mm: resolves lines of 2" in out
    assert "depth of field for lines of 20 um: " in out
    assert "at least" not in out
    _, out, _ = run(capsys, *words, "--line-um", "20", "--json")
    depth = json.loads(out)["depth_of_field"]
    assert -3 < depth["low_mm"] < -1
    assert depth["high_mm"] == pytest.approx(-depth["low_mm"], abs=0.1)
    _, out, _ = run(capsys, *words, "--line-um", "90")
    assert "at least 6.00 mm, -3.00 to +3.00 mm" in out


def test_a_capture_tells_its_stripes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = SimulatedRig(scene="board", camera=(640, 480), exposure_ms=4.6, drift_mm=0.0)
    rig.open()
    start = parse_instant("2026-01-01T00:00:00Z")
    patterns = PatternSet("gray", (608, 684), bits=(10, 0))
    write_capture(rig.capture_posed(patterns, start, (0, 0, 6.0), (0, 0, 0)), tmp_path / "capture")
    optics = paper_optics((640, 480))
    camera, projector = optics.camera, optics.projector
    turn = projector.R @ camera.R.T
    reference = np.column_stack([camera.R.T, -camera.R.T @ camera.t_mm])
    known = Calibration(
        camera.lens, projector.lens, turn, projector.t_mm - turn @ camera.t_mm, reference, {"stereo": 0.0}
    )
    (tmp_path / "calibration.json").write_text(known.to_json())
    box = _outer_edge(tmp_path / "capture")
    code, out, err = run(
        capsys, str(tmp_path / "capture"), "--calibration", str(tmp_path / "calibration.json"), "--roi", box
    )
    assert code == 0, err
    assert "finest stripes (columns): contrast 0." in out
    assert object_pixel_um(known) == pytest.approx(11_200 / 480, rel=0.01)


def _outer_edge(capture: Path) -> str:
    """A box on the board's outer edge, half black square and half white ground, turned by 6 degrees."""
    white = cv2.imread(str(next(capture.glob("00_*.png"))), cv2.IMREAD_GRAYSCALE)
    assert white is not None
    from pipelines.reconstruction.slanted_edge import find_edge

    return ",".join(map(str, find_edge(white)))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no chart: give an image or a capture folder"),
        (("none.png", "--pixel-um", "4"), "none.png: no such image or capture folder"),
        (("A",), "give the camera's pixel on the object: --pixel-um or --calibration, one of them"),
        (("A", "--pixel-um", "-1"), "--pixel-um -1.0: must be above 0"),
        (("A", "A", "--pixel-um", "4"), "--z-mm is missing"),
        (("A", "A", "--pixel-um", "4", "--z-mm", "1,1"), "--z-mm 1,1: a focus series needs two or more different"),
        (("A", "--pixel-um", "4", "--z-mm", "0,1"), "--z-mm 0,1: 2 heights for 1 images"),
        (("A", "--pixel-um", "4", "--z-mm", "low"), "--z-mm low: give heights with commas"),
        (("A", "--pixel-um", "4", "--line-um", "15"), "--line-um: a depth of field needs several images and --z-mm"),
        (("A", "--pixel-um", "4", "--threshold", "2"), "--threshold 2.0: must lie between 0 and 1"),
        (("A", "--pixel-um", "4", "--roi", "here"), "--roi here: give COLUMN,ROW,WIDTH,HEIGHT"),
        (("A", "--pixel-um", "4", "--roi", "0,0,9000,90"), "the box 0,0,9000,90 leaves the image of 120x120"),
        (("A", "--pixel-um", "4", "--roi", "5.9:0,0,90,90"), "elements 1 to 6, not 5.9"),
        (("A", "--pixel-um", "4", "--roi", "0,0,90,90", "--roi", "0,0,80,80"), "one box of an edge is enough"),
        (("A", "--pixel-um", "4", "--levels", "1,2"), "--levels: an edge brings its own levels"),
        (("A", "--pixel-um", "4"), "found no straight edge"),
    ],
)
def test_mistakes(words: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grey = save(tmp_path / "even.png", np.full((120, 120), 90, np.uint8))
    code, out, err = run(capsys, *(grey if word == "A" else word for word in words))
    assert code == 2
    assert out == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1
