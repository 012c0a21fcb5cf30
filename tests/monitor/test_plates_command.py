"""`microrelief plates`: every plate by name, from a store to a table, to JSON and to people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.cli import run_tokens
from pipelines import Grid, Scan, Tick, parse_instant
from pipelines.change import compare
from storage import create_store
from tests.pipelines.change.scans import bumps

GRID = Grid(150, 200, 0.02, -2.0, -1.5)
START = parse_instant("2026-01-01T00:00:00Z")
LIFT = 0.02
"""By which the rims rise with each scan, mm."""


def fill(path: Path, scans: int) -> Path:
    """Two plates beside a crack along y, whose rims curl up; in the third scan the right one breaks along x."""
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    store = create_store(path, site="crust", grid=GRID)
    baseline = None
    still = np.zeros(GRID.shape, np.uint8)
    for hour in range(scans):
        at = START + np.timedelta64(hour, "h")
        away = np.abs(x)
        if hour >= 2:
            away = np.minimum(away, np.hypot(y, np.clip(-x, 0, None)))
        height = 0.3 * bumps(2)(x, y) - 0.3 * np.clip(1 - (away / 0.08) ** 2, 0, None)
        height += LIFT * hour * np.exp(-np.maximum(0, np.abs(x) - 0.08) / 0.8)
        height += np.random.default_rng(hour).normal(0, 0.002, x.shape)
        scan = Scan(GRID, at, height.astype(np.float32), np.full(GRID.shape, 0.002, np.float32), still, still)
        change = compare(scan, baseline, stable=np.abs(x) > 1.6).change if baseline is not None else None
        baseline = scan if baseline is None else baseline
        store.append(Tick(at, scan, change))
    store.close()
    return path


def test_plates_that_curl_and_one_that_breaks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "crust.icechunk", 4)
    for name in ("plates.csv", "plates.parquet"):
        assert run_tokens(["plates", str(path), "--out", str(tmp_path / name)]) == 0
    said = capsys.readouterr().out
    assert "3 plates in the last of 3 compared scans" in said
    assert "2026-01-01T02:00:00Z  plate 3 broke from" in said
    table = pd.read_parquet(tmp_path / "plates.parquet")
    assert list(table.groupby(level=0)["identity"].nunique()) == [2, 3, 3]
    left = table[table["x"] < -0.5]
    assert left["identity"].nunique() == 1, "a plate keeps its name"
    assert np.diff(left["lift"]) == pytest.approx(0.8 * LIFT * (1 - np.exp(-1)), abs=0.3 * LIFT)
    broken = table[table["identity"] == 3]
    assert set(broken["from"]) == set(table[(table["x"] > 0) & (table["identity"] != 3)]["identity"].astype(str))
    header = (tmp_path / "plates.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith("time,identity,x [mm],y [mm],area [mm2],area_sigma [mm2],lift [mm],lift_sigma [mm]")

    assert run_tokens(["plates", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [plate["identity"] for plate in told["plates"]] == [1, 2, 3]
    assert [event["event"] for event in told["events"]] == ["broke"]


def test_what_cannot_be_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "crust.icechunk", 1)
    assert run_tokens(["plates", str(path)]) != 0
    assert "holds 1 scan, and a plate has curled only against a scan before" in capsys.readouterr().err
    assert run_tokens(["plates", str(tmp_path / "none")]) != 0
    assert "no such store" in capsys.readouterr().err
