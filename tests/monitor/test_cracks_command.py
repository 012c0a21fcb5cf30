"""`microrelief cracks`: every crack by name, from a store to a table, to JSON and to people."""

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

GRID = Grid(140, 180, 0.02, -1.8, -1.4)
START = parse_instant("2026-01-01T00:00:00Z")


def fill(path: Path, scans: int) -> Path:
    """A crack along x that grows by 0.2 mm an hour; from the third scan on another one leaves it upwards.

    The whole lies 0.06 mm lower with each scan, as if the camera rose: the store's motions take that out.
    """
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    store = create_store(path, site="crust", grid=GRID)
    baseline = None
    for hour in range(scans):
        at = START + np.timedelta64(hour, "h")
        tip = 0.2 * hour
        away = np.hypot(np.clip(x - tip, 0, None), y + 0.4)
        if hour >= 2:
            away = np.minimum(away, np.hypot(x + 0.8, np.clip(y - 0.5, 0, None) + np.clip(-0.4 - y, 0, None)))
        height = 0.3 * bumps(2)(x, y) - 0.3 * np.clip(1 - (away / 0.08) ** 2, 0, None) - 0.06 * hour
        height += np.random.default_rng(hour).normal(0, 0.002, x.shape)
        sigma, still = np.full(GRID.shape, 0.002, np.float32), np.zeros(GRID.shape, np.uint8)
        scan = Scan(GRID, at, height.astype(np.float32), sigma, still, still)
        change = compare(scan, baseline).change if baseline is not None else None
        baseline = scan if baseline is None else baseline
        store.append(Tick(at, scan, change))
    store.close()
    return path


def test_a_crack_that_grows_and_branches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "crust.icechunk", 5)
    for name in ("cracks.csv", "cracks.parquet"):
        assert run_tokens(["cracks", str(path), "--out", str(tmp_path / name)]) == 0
    said = capsys.readouterr().out
    assert "2 cracks in the last of 5 scans" in said
    assert "2026-01-01T02:00:00Z  crack 2 branched from 1" in said
    table = pd.read_parquet(tmp_path / "cracks.parquet")
    stem = table[table["identity"] == 1]
    assert len(stem) == 5
    assert stem["tip1_speed"].iloc[1:].to_numpy() == pytest.approx(0.2, abs=0.04)
    assert stem["tip1_x"].to_numpy() == pytest.approx(0.08 + 0.2 * np.arange(5), abs=0.04)
    assert np.diff(stem["length"]) == pytest.approx(0.2, abs=0.08)  # an end is known to half a width
    branch = table[table["identity"] == 2]
    assert len(branch) == 3
    assert set(branch["from"]) == {"1"}
    assert set(branch["meets"]) == {"1"}
    header = (tmp_path / "cracks.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith("time,identity,length [mm],length_sigma [mm],width [mm],width_sigma [mm],depth [mm]")
    assert "tip1_speed [mm/h]" in header

    assert run_tokens(["cracks", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["scans"] == 5
    assert [crack["identity"] for crack in told["cracks"]] == [1, 2]
    assert told["cracks"][1]["from"] == 1
    assert [event["event"] for event in told["events"]] == ["branched"]


def test_what_cannot_be_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fill(tmp_path / "crust.icechunk", 0)
    assert run_tokens(["cracks", str(path)]) != 0
    assert "holds no scan yet" in capsys.readouterr().err
    assert run_tokens(["cracks", str(tmp_path / "none")]) != 0
    assert "no such store" in capsys.readouterr().err
