"""`microrelief track`: a table of what moves, from a store."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.cli import run_tokens
from pipelines import Grid, Scan, Tick, parse_instant
from storage import create_store

GRID = Grid(80, 80, 0.05, 0.0, 0.0)
START = parse_instant("2026-01-01T00:00:00Z")


def fill(path: Path, scans: int) -> Path:
    """A round body of 0.5 mm radius that creeps to the right by 0.2 mm a second."""
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    store = create_store(path, site="dish", grid=GRID)
    for second in range(scans):
        at = START + np.timedelta64(second, "s")
        body = 0.2 * np.clip(1 - ((x - 0.8 - 0.2 * second) ** 2 + (y - 2) ** 2) / 0.25, 0, None)
        still = np.zeros(GRID.shape, np.uint8)
        sigma = np.full(GRID.shape, 0.003, np.float32)
        store.append(Tick(at, Scan(GRID, at, body.astype(np.float32), sigma, still, still)))
    store.close()
    return path


def test_a_body_that_creeps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "dish.icechunk", 12)
    for name in ("tracks.csv", "tracks.parquet"):
        assert run_tokens(["track", str(path), "--out", str(tmp_path / name)]) == 0
    assert "1 objects in 12 scans" in capsys.readouterr().out
    table = pd.read_parquet(tmp_path / "tracks.parquet")
    assert table["speed"].median() == pytest.approx(0.2, rel=0.05)
    assert table["volume"].median() == pytest.approx(np.pi * 0.25 * 0.2 / 2, rel=0.03)
    header = (tmp_path / "tracks.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith("time,identity,x [mm],y [mm],z [mm],speed [mm/s],area [mm2],area_sigma [mm2]")


def test_what_moved_during_a_capture_is_flagged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = fill(tmp_path / "dish.icechunk", 12), tmp_path / "tracks.parquet"
    for seconds, flag in (("0.1", "no"), ("0.5", "yes")):  # 0.02 and 0.1 mm, a cell is 0.05 mm
        assert run_tokens(["track", str(path), "--out", str(out), "--capture-seconds", seconds]) == 0
        table = pd.read_parquet(out)
        assert table["moved"].iloc[0] == ""  # no speed yet
        assert (table["moved"].iloc[1:] == flag).all()
        assert ("1 objects moved by more than a cell" in capsys.readouterr().out) == (flag == "yes")


def test_what_cannot_be_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "dish.icechunk", 1)
    out = str(tmp_path / "tracks.csv")
    for tokens, said in (
        ([str(path), "--out", out], "holds 1 scan, and nothing is seen to move"),
        ([str(path), "--out", out, "--least-height-mm", "0"], "must be above 0"),
        ([str(path), "--out", out, "--capture-seconds", "0"], "must be above 0"),
        ([str(tmp_path / "none"), "--out", out], "no such store"),
    ):
        assert run_tokens(["track", *tokens]) != 0
        assert said in capsys.readouterr().err
    assert not Path(out).exists()
