"""The demo on a small camera: the whole chain, its numbers beside the truth, and going on where it ended."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from threading import Event as Flag

import numpy as np
import pytest

from configs import InputError
from monitor.cli import run_tokens
from monitor.commands.demo import our_command
from monitor.demo import judge_store, prepare, run_demo
from pipelines import Calibration
from storage import Ledger, ledger_beside, open_store

SMALL = """
site: {name: Small demo}
store: {path: demo.icechunk}
rig:
  name: simulated
  options: {scene: soil, camera: [480, 360], started: 2026-01-01T00:00:00Z}
schedule: {every: 18 h, start: 2026-01-01T00:00:00Z}
patterns: {kind: gray, size: [608, 684], bits: [9, 9]}
calibration: {simulated: true}
grid: {pitch_mm: 0.05}
register:
  stable_mm:
    - [[-7.2, -5.2], [-5.3, -5.2], [-5.3, 5.2], [-7.2, 5.2]]
    - [[5.3, -5.2], [7.2, -5.2], [7.2, 5.2], [5.3, 5.2]]
region_mm: [[-4.8, -4.8], [4.8, -4.8], [4.8, 4.8], [-4.8, 4.8]]
metrics: [net_volume, crack_opening, edge_lift]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demo of three scans."""
    out = tmp_path_factory.mktemp("demo")
    (out / "demo.yaml").write_text(SMALL)
    assert run_tokens(["demo", "--out", str(out), "--scans", "3"]) == 0
    return out


def test_leaves_a_store_a_review_and_a_report(folder: Path) -> None:
    assert (folder / "review.rrd").stat().st_size > 10_000
    assert "<html" in (folder / "report" / "report.html").read_text(encoding="utf-8")[:500].lower()
    store = open_store(folder / "demo.icechunk")
    assert [str(store[number].planned)[:13] for number in range(3)] == [
        "2026-01-01T00",
        "2026-01-01T18",
        "2026-01-02T12",
    ]
    assert not [event for event in store.events if event.kind in ("failed", "missed", "rejected")]
    store.close()


def test_scan_and_status_go_on_from_there(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Scans through rig, calibration, reconstruction and store, by the command line alone."""
    site = shutil.copytree(folder, tmp_path / "site")
    capsys.readouterr()
    for number in (3, 4):
        began = time.time()
        assert run_tokens(["scan", str(site / "demo.yaml")]) == 0
        (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("committed")]
        word, scan, count, moment = line.split()
        assert (word, scan, count) == ("committed", "scan", str(number))
        taken = np.datetime64(moment.removesuffix("Z"), "s").astype(int)
        assert began - 1 <= taken <= time.time() + 1
    assert run_tokens(["status", str(site / "demo.yaml"), "--json"]) in (0, 4)
    assert json.loads(capsys.readouterr().out)["scans"] == 5
    ledger = Ledger(ledger_beside(site / "demo.icechunk"), write=False)
    assert [row.state for row in ledger.rows()][-2:] == ["taken", "taken"]
    ledger.close()


def test_the_rig_was_calibrated_from_its_frames(folder: Path) -> None:
    (file,) = folder.glob("demo.calibration-*.json")
    calibration = Calibration.from_json(file.read_text())
    assert len(calibration.poses) >= 5
    assert calibration.rms_px["stereo"] < 0.35
    # the true focal length is 90 mm / 11.2 mm x 360 px; a calibration that was handed over would hit it exactly
    error = abs(calibration.camera.K[0, 0] / (90 / 11.2 * 360) - 1)
    assert 1e-9 < error < 0.01


def test_what_it_measured_is_near_the_truth(folder: Path) -> None:
    store = open_store(folder / "demo.icechunk")
    judged = judge_store(store, folder / "demo.yaml")
    store.close()
    assert [scan.number for scan in judged] == [1, 2]
    assert [scan.elapsed_h for scan in judged] == [18.0, 36.0]
    last = {each.metric: each for each in judged[-1].judged}
    assert set(last) == {"net_volume", "crack_opening", "edge_lift"}
    assert abs(last["net_volume"].error) < 0.01 * 92  # 10 um over the region
    assert last["crack_opening"].truth == pytest.approx(0.26, abs=0.03)
    assert abs(last["crack_opening"].error) < 0.05  # a cell
    assert last["edge_lift"].truth == pytest.approx(0.085, abs=0.015)
    assert abs(last["edge_lift"].error) < 0.02
    assert all(np.isfinite(each.sigma) and each.sigma > 0 for scan in judged for each in scan.judged)
    assert judged[-1].whole_volume_mm3 < last["net_volume"].truth  # crack floors that no ray reaches


def test_prints_measured_beside_truth_and_where_things_are(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["demo", "--out", str(folder), "--scans", "3"]) == 0
    said = capsys.readouterr().out
    assert "holds 3 scans already" in said
    for word in ("net volume, mm3", "crack opening, mm", "edge lift, mm", "error", "±", "review.rrd", "report.html"):
        assert word in said


def test_goes_on_to_n_in_all(folder: Path) -> None:
    outcome = run_demo(folder / "demo.yaml", 4)
    assert outcome is not None
    assert outcome.taken == 1
    store = open_store(folder / "demo.icechunk")
    assert len(store) == 4
    assert str(store[3].planned)[:13] == "2026-01-03T06"
    assert len(list(folder.glob("demo.calibration-*.json"))) == 1  # not calibrated anew
    store.close()
    ledger = Ledger(ledger_beside(folder / "demo.icechunk"))
    assert [row.state for row in ledger.rows()] == ["taken"] * 4
    ledger.close()
    assert run_demo(folder / "demo.yaml", 4) is None


def test_a_stop_takes_no_further_scan(folder: Path) -> None:
    stop = Flag()
    stop.set()
    outcome = run_demo(folder / "demo.yaml", 9, stop=stop)
    assert outcome is not None
    assert outcome.stopped
    assert outcome.taken == 0


def test_shipped_campaign_is_taken_and_never_overwritten(tmp_path: Path) -> None:
    file = prepare(tmp_path / "new")
    assert "scene: soil" in file.read_text()
    file.write_text("mine")
    assert prepare(tmp_path / "new").read_text() == "mine"


def test_too_few_scans_and_a_folder_that_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["demo", "--out", str(tmp_path), "--scans", "1"]) == 2
    (tmp_path / "file").write_text("")
    assert run_tokens(["demo", "--out", str(tmp_path / "file"), "--scans", "2"]) == 2
    said = capsys.readouterr().err
    assert "--scans must be at least 2" in said
    assert "cannot be written" in said


def test_a_campaign_without_a_known_soil_cannot_be_judged(tmp_path: Path) -> None:
    (tmp_path / "demo.yaml").write_text(SMALL.replace("scene: soil", "scene: board"))

    class Empty:
        class about:  # noqa: N801 - stands in for an attribute
            grid = object()

    with pytest.raises(InputError, match="soil"):
        judge_store(Empty(), tmp_path / "demo.yaml")  # type: ignore[arg-type]  # refused before it is read


def test_the_command_that_is_shown_can_be_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`make demo` does not activate its environment: there plain `microrelief` would not be found."""
    beside = tmp_path / "my env" / "microrelief"
    beside.parent.mkdir()
    beside.touch(mode=0o755)
    monkeypatch.setattr("sys.executable", str(beside.with_name("python")))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert our_command() == f"'{beside}'"
    monkeypatch.setenv("PATH", str(beside.parent))
    assert our_command() == "microrelief"
