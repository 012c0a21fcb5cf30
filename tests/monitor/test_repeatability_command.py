"""``microrelief repeatability``: a noise model from a store's scans, kept in it and used from then on."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from monitor.cli import run_tokens
from pipelines import Grid, Scan, Tick, parse_instant
from pipelines.change import NoiseModel
from storage import copy_store, create_store, open_store

GRID = Grid(60, 80, 0.05, 0.0, 0.0)
START = parse_instant("2026-01-01T00:00:00Z")


@pytest.fixture
def still(tmp_path: Path) -> Path:
    """Six scans of one rough surface, 2 um of noise each where 1 um is stated."""
    random = np.random.default_rng(0)
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    surface = 0.05 * np.sin(9 * x + 2 * y) * np.cos(7 * y)
    store = create_store(tmp_path / "still.icechunk", site="still", grid=GRID, metrics={"net_volume": "mm3"})
    for number in range(6):
        at = START + np.timedelta64(number, "h")
        height = (surface + random.normal(0, 0.002, GRID.shape)).astype(np.float32)
        flat = np.zeros(GRID.shape, np.uint8)
        store.append(Tick(at, Scan(GRID, at, height, np.full(GRID.shape, 0.001, np.float32), flat, flat)))
    store.close()
    return tmp_path / "still.icechunk"


def test_it_is_kept_and_used(still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, file = str(still), tmp_path / "noise.json"
    assert run_tokens(["repeatability", path, "--from", "0", "--to", "5", "--out", str(file)]) == 0
    said = capsys.readouterr().out
    assert "WARNING" not in said
    model = NoiseModel.from_json(file.read_text(encoding="utf-8"))
    assert f"noise model {model.id} kept in {path}" in said
    assert float(re.findall(r"level, in pairs not fitted to: (\S+) %", said)[0]) == pytest.approx(5, abs=1.5)
    assert model.gain == pytest.approx(2.0, rel=0.05)
    store = open_store(still)
    assert store.about.noise is not None
    assert store.about.noise.id == model.id
    assert model.snapshot
    assert any(model.id in event.text for event in store.events)
    store.close()

    copy_store(still, tmp_path / "copy.icechunk")
    copied = open_store(tmp_path / "copy.icechunk")
    assert copied.about.noise is not None
    assert copied.about.noise.id == model.id
    copied.close()

    assert run_tokens(["process", path]) == 0
    store = open_store(still)
    change = store[4].change
    assert change is not None
    assert np.nanmedian(change.lod) == pytest.approx(1.96 * 0.002 * np.sqrt(2), rel=0.05)
    assert change.significant.mean() == pytest.approx(0.05, abs=0.015)
    assert any("processed again" in event.text and model.id in event.text for event in store.events)
    store.close()


def test_a_dry_run_keeps_nothing(still: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["repeatability", str(still), "--from", "1", "--to", "3", "--dry-run"]) == 0
    assert "3 scans" in capsys.readouterr().out
    store = open_store(still)
    assert store.about.noise is None
    assert not any("noise model" in event.text for event in store.events)
    store.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "names no stable areas: say between which scans nothing changed"),
        (["--from", "2", "--to", "2"], "two or more scans"),
        (["--from", "0", "--to", "77"], "there is no such scan"),
        (["--from", "0", "--to", "2", "--out", "noise.txt"], "must be a .json file"),
    ],
)
def test_what_cannot_be_done_is_said(
    still: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert run_tokens(["repeatability", str(still), *words]) != 0
    assert said in capsys.readouterr().err


def test_help_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["repeatability", "--help"]) == 0
    assert "microrelief repeatability " in capsys.readouterr().out
