"""Height maps of other scanners get all that lies behind the store, and leave it again for other programs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.cli import run_tokens
from monitor.visit import Rules, compare_with
from pipelines import Grid, Scan
from storage import create_store, open_store, read_height_map, read_raster, write_height_map

from .campaigns import campaign_in

GRID = Grid(60, 70, 0.1, -3.0, -2.0)
START = np.datetime64("2026-11-22T21:00:00", "ns")


def mound(number: int, sigma: float = 0.01) -> Scan:
    """Rough ground on which a mound of 0.5 mm3 more stands with every scan."""
    rng = np.random.default_rng(3)
    rough = rng.normal(0, 0.05, GRID.shape)
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    spread = 0.5
    rise = 0.5 * number * np.exp(-(x**2 + (y - 1) ** 2) / (2 * spread**2)) / (2 * np.pi * spread**2)
    noise = np.random.default_rng(number).normal(0, 0.005, GRID.shape)
    level = np.zeros(GRID.shape, np.uint8)
    height = (rough + rise + noise).astype(np.float32)
    time = START + np.timedelta64(6 * number, "h")
    return Scan(GRID, time, height, np.full(GRID.shape, sigma, np.float32), level, level)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_files_of_many_formats_become_one_series(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    suffixes = (".npz", ".tif", ".nc", ".gsf", ".las", ".ply")
    names = [f"{number}{suffix}" for number, suffix in enumerate(suffixes)]
    for number, name in enumerate(names):
        write_height_map(mound(number), here / name)
    assert run_tokens(["ingest", "s.icechunk", *reversed(names[:4]), "--sigma-mm", "0.01"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "committed scan 0 2026-11-22T21:00:00Z from 0.npz"
    assert len(told) == 4
    assert run_tokens(["ingest", "s.icechunk", *names, "--sigma-mm", "0.01"]) == 0  # again, as files arrive
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "0.npz: the scan of 2026-11-22T21:00:00Z is there already, left alone"
    assert [line.split()[0] for line in told[4:]] == ["committed", "committed"]
    store = open_store("s.icechunk")
    assert store.about.site == "s"
    series = store.series()
    assert [moment.hour for moment in pd.DatetimeIndex(series.index)] == [21, 3, 9, 15, 21, 3]
    for number in range(1, 6):
        volume, sigma = series["net_volume"].iloc[number], series["net_volume_sigma"].iloc[number]
        assert volume == pytest.approx(0.5 * number, abs=max(3 * sigma, 0.02))
    assert "imported from 3.gsf" in [event.text for event in store.events]


def test_a_file_is_worked_out_as_a_visit_would(here: Path) -> None:
    for number in range(2):
        write_height_map(mound(number), here / f"{number}.npz")
    assert run_tokens(["ingest", "s", "0.npz", "1.npz", "--metric", "net_volume"]) == 0
    store = open_store("s")
    finding = compare_with(store[0].scan, mound(1), Rules(mound(1).grid, metrics=("net_volume",)))
    assert finding.change is not None
    np.testing.assert_allclose(store[1].change.dz, finding.change.dz, atol=0.000251)  # type: ignore[union-attr]
    assert store.series()["net_volume"].iloc[1] == finding.metrics["net_volume"].value


def test_times_come_from_the_file_or_the_command_line(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        np.savez(here / f"{number}.npz", height=mound(number).height, pitch_mm=0.1)
    assert run_tokens(["ingest", "s", "0.npz"]) == 2
    assert capfd.readouterr().err == "microrelief: 0.npz: does not say when it was measured: give --time\n"
    assert not (here / "s").exists()
    assert run_tokens(["ingest", "s", "0.npz", "1.npz", "--time", "2026-11-22T21:00:00Z"]) == 2
    assert "give --every too" in capfd.readouterr().err
    line = ["ingest", "s", "0.npz", "1.npz", "2.npz", "--time", "2026-11-22 22:00", "--zone", "Europe/Berlin"]
    assert run_tokens([*line, "--every", "6 h"]) == 0
    store = open_store("s")
    assert [store[number].scan.time for number in range(3)] == [START + np.timedelta64(6 * n, "h") for n in range(3)]
    # without a sigma there is a change, but no level of detection
    assert store[1].change is not None
    assert np.isnan(store[1].change.lod).all()
    assert run_tokens(["report", "s", "--out", "o"]) in (0, 3)  # says so, and divides by nothing
    assert "so nobody can tell how much of it is certain" in (here / "o/report.html").read_text(encoding="utf-8")
    assert run_tokens(["ingest", "s", "0.npz", "--time", "2026-11-22T22:00:00Z"]) == 1
    assert "is not newer than the newest one stored" in capfd.readouterr().err


def test_a_wrong_file_among_good_ones_costs_nothing(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_height_map(mound(0), here / "a.npz")
    (here / "b.tif").write_bytes(b"no tiff")
    assert run_tokens(["ingest", "s", "a.npz", "b.tif"]) == 2
    assert "b.tif: is no readable .tif height map" in capfd.readouterr().err
    assert not (here / "s").exists()


def test_a_new_store_on_cells_of_another_size(here: Path) -> None:
    write_height_map(mound(0), here / "a.tif")
    assert run_tokens(["ingest", "s", "a.tif", "--pitch-mm", "0.2"]) == 0
    store = open_store("s")
    grid = store.about.grid
    assert grid is not None
    assert (grid.shape, grid.pitch_mm) == ((30, 35), 0.2)
    assert (grid.x0_mm, grid.y0_mm) == pytest.approx((-3.0, -2.0))
    np.testing.assert_allclose(store[0].scan.height, mound(0).height[::2, ::2], atol=0.000251)


def test_surfaces_of_nanometres_get_fine_steps_and_a_coarse_store_refuses_them(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    fine = mound(0).height * 1e-5
    np.savez(here / "fine.npz", height=fine, pitch_mm=mound(0).grid.pitch_mm, time="2026-11-22T21:00:00Z")
    write_height_map(mound(0), here / "coarse.npz")
    assert run_tokens(["ingest", "s", "fine.npz"]) == 0
    assert run_tokens(["verify", "s"]) == 0
    kept = open_store("s")
    np.testing.assert_allclose(kept[0].scan.height, fine, rtol=0, atol=0.01 * np.nanstd(fine))
    np.testing.assert_allclose(kept.window()["height"].values[0], kept[0].scan.height, rtol=1e-5)
    assert run_tokens(["ingest", "t", "coarse.npz"]) == 0
    assert run_tokens(["ingest", "t", "fine.npz"]) == 2
    assert "t keeps steps of 500 nm: ingest it into a new store" in capfd.readouterr().err
    assert len(open_store("t")) == 1


def test_export_of_scan_change_and_series(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        write_height_map(mound(number), here / f"{number}.npz")
    run_tokens(["ingest", "s", "0.npz", "1.npz", "2.npz"])
    store = open_store("s")
    for suffix in (".npz", ".nc", ".tif", ".gsf", ".las", ".ply"):
        assert run_tokens(["export", "s", "--scan", "-2", "--out", f"one{suffix}"]) == 0
        back = read_raster(here / f"one{suffix}", grid=GRID)
        assert back.time == store[1].scan.time
        np.testing.assert_allclose(back.height, store[1].scan.height, atol=0.6e-6, rtol=2e-7)
        assert run_tokens(["export", "s", "--scan", "2026-11-23T08:00:00Z", "--change", "--out", f"dz{suffix}"]) == 0
        back = read_raster(here / f"dz{suffix}", grid=GRID)
        np.testing.assert_allclose(back.height, store[2].change.dz, atol=0.6e-6, rtol=2e-7)  # type: ignore[union-attr]
    assert "wrote dz.ply: change at scan 2 of 2026-11-23T09:00:00Z" in capsys.readouterr().out
    assert run_tokens(["export", "s", "--series", "--out", "s.parquet"]) == 0
    pd.testing.assert_frame_equal(pd.read_parquet(here / "s.parquet"), store.series())
    exact = read_height_map(here / "one.nc")
    assert replace(exact, texture=store[1].scan.texture).grid == store[1].scan.grid


def test_a_campaigns_store_takes_no_map_into_its_past(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    create_store(here / "s", site="x", grid=GRID).close()
    write_height_map(mound(0), here / "a.npz")
    assert run_tokens(["ingest", "s", "a.npz", "--pitch-mm", "1"]) == 2
    assert "--pitch-mm and --metric are for a new store" in capfd.readouterr().err


def test_a_store_on_s3_and_a_campaign_whose_files_lie_elsewhere(
    here: Path, s3_prefix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"{s3_prefix}/my-site"
    for number in range(3):
        write_height_map(mound(number), here / f"{number}.npz")
    for names in (["0.npz"], ["1.npz", "2.npz"]):
        assert run_tokens(["ingest", url, *names]) == 0
    assert open_store(url).about.site == "my site"
    kept = campaign_in(here).model_dump(mode="json", by_alias=True, exclude_defaults=True)
    text = json.dumps({**kept, "store": url, "patterns": "nowhere/patterns.yaml", "calibration": {"file": "c.json"}})
    other = create_store(
        f"{url}-2", site="x", grid=GRID, campaign=text, campaign_hash="abc", metrics={"net_volume": "mm3"}
    )
    other.close()
    assert run_tokens(["ingest", f"{url}-2", "0.npz", "1.npz"]) == 0
    capsys.readouterr()
    assert run_tokens(["process", f"{url}-2"]) == 0
    assert "2 no frames are kept" in capsys.readouterr().out
    assert "settings abc" in open_store(f"{url}-2").events[-1].text
