"""What a store on disk promises beyond the contract: plain readers, one writer, epochs of files, binned histories."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import icechunk
import numpy as np
import pytest
import xarray as xr
import zarr

from configs import StoreError
from pipelines import Event, Frames, Grid, PatternSet
from storage import Store, create_store, open_store
from storage.layout import SCHEMA
from storage.repository import root_of

from .ticks import GRID, METRICS, START, at, failure, surface, tick


def _made(folder: Path, scans: int = 0, **options: object) -> Store:
    store = create_store(folder, site="plot 7", grid=GRID, metrics=METRICS, **options)  # type: ignore[arg-type]  # few
    for number in range(scans):
        store.append(tick(number))
    return store


def _session(folder: Path) -> icechunk.Session:
    return icechunk.Repository.open(icechunk.local_filesystem_storage(str(folder))).readonly_session("main")


def test_plain_xarray_sees_times_places_and_millimetres(tmp_path: Path) -> None:
    _made(tmp_path / "s", 3).close()
    session = _session(tmp_path / "s")
    scans = xr.open_zarr(session.store, group="scans", consolidated=False)
    assert scans["height"].dims == ("time", "y", "x")
    assert [scans[name].attrs["units"] for name in ("height", "sigma", "y", "x")] == ["mm"] * 4
    assert scans["time"].dtype == np.dtype("datetime64[ns]")
    assert scans["time"].values[1] == surface(1).time
    assert scans["time"].encoding["units"] == "nanoseconds since 1970-01-01"
    assert scans["planned"].values[2] == at(2)
    np.testing.assert_allclose(scans["x"], GRID.x_mm)
    np.testing.assert_allclose(scans["y"], GRID.y_mm)
    truth = surface(2).height
    np.testing.assert_allclose(scans["height"][2], truth, rtol=0, atol=0.000251)
    assert np.isnan(scans["height"].values[2][np.isnan(truth)]).all()
    assert np.isnan(truth).any()
    change = xr.open_zarr(session.store, group="change", consolidated=False)
    np.testing.assert_allclose(change["dz"][2], truth - surface(0).height, rtol=0, atol=0.00026)
    assert np.isnan(change["dz"][0]).all()
    assert np.isnat(change["baseline_time"].values[0])
    assert change["baseline_time"].values[1] == surface(0).time
    metrics = xr.open_zarr(session.store, group="metrics", consolidated=False)
    assert metrics["net_volume"].attrs["units"] == metrics["net_volume_sigma"].attrs["units"] == "mm3"
    assert float(metrics["net_volume"].sel(time=surface(2).time)) == -3.0


def test_the_store_offers_that_session(tmp_path: Path) -> None:
    _made(tmp_path / "s", 2).close()
    store = open_store(tmp_path / "s")
    seen = xr.open_zarr(store.session.store, group="scans", consolidated=False)  # type: ignore[attr-defined]  # Icechunk
    assert seen.sizes["time"] == 2
    assert store.session.snapshot_id == store.about.snapshot  # type: ignore[attr-defined]  # Icechunk


def test_plain_zarr_sees_packed_steps_in_chunks_of_one_scan_and_long_tables(tmp_path: Path) -> None:
    _made(tmp_path / "s", 2).close()
    root = zarr.open_group(_session(tmp_path / "s").store, mode="r")
    height = root["scans/height"]
    assert isinstance(height, zarr.Array)
    assert (str(height.dtype), height.chunks, int(height.metadata.zarr_format)) == ("int16", (1, 20, 30), 3)
    assert (height.attrs["scale_factor"], height.attrs["add_offset"]) == (0.0005, 0.0)
    assert height.attrs["_FillValue"] == -32768
    for name in ("scans/time", "metrics/net_volume"):
        table = root[name]
        assert isinstance(table, zarr.Array)
        assert table.chunks[0] >= 128
    assert {"microrelief_schema", "campaign", "campaign_hash", "software", "site", "created"} <= set(root.attrs)


def test_one_tick_is_one_snapshot(tmp_path: Path) -> None:
    store = _made(tmp_path / "s", 2)
    store.append(failure(2))
    messages = [
        each.message
        for each in icechunk.Repository.open(icechunk.local_filesystem_storage(str(tmp_path / "s"))).ancestry(
            branch="main"
        )
    ]
    assert messages[::-1] == [
        "Repository initialized",
        "store created",
        "scan 0 of 2026-11-22T21:00:00Z",
        "scan 1 of 2026-11-23T03:00:00Z",
        "tick 2026-11-23T09:00:00Z: no scan",
    ]
    store.close()


def test_a_reader_keeps_its_snapshot_while_the_writer_goes_on(tmp_path: Path) -> None:
    store = _made(tmp_path / "s", 1)
    reader = open_store(tmp_path / "s")
    store.append(tick(1))
    assert (len(reader), len(open_store(tmp_path / "s"))) == (1, 2)
    np.testing.assert_array_equal(reader[0].scan.texture, surface(0).texture)
    with pytest.raises(StoreError, match="open to read"):
        reader.append(tick(2))
    store.close()


def test_one_writer_named_to_the_next(tmp_path: Path) -> None:
    store = _made(tmp_path / "s")
    with pytest.raises(StoreError, match=r"another writer holds this store \(pid \d+ on .* since .*Z\)"):
        open_store(tmp_path / "s", write=True)
    store.close()
    again = open_store(tmp_path / "s", write=True)
    again.append(tick(0))
    again.close()


def test_a_dead_writers_lock_does_not_hold(tmp_path: Path) -> None:
    _made(tmp_path / "s").close()
    code = (
        "import os, sys; from storage import open_store\n"
        "store = open_store(sys.argv[1], write=True); print('holds', flush=True); sys.stdin.readline()"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "s")], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    )
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "holds\n"
        with pytest.raises(StoreError, match=f"pid {child.pid} on"):
            open_store(tmp_path / "s", write=True)
        child.kill()
    open_store(tmp_path / "s", write=True).close()


def test_a_writer_continues_where_the_last_one_stopped(tmp_path: Path) -> None:
    _made(tmp_path / "s", 2).close()
    store = open_store(tmp_path / "s", write=True)
    assert store.append(tick(2)) == 2
    store.append(tick(3, baseline=None, calibration="second"))
    store.close()
    store = open_store(tmp_path / "s", write=True)
    store.append(tick(4, baseline=3, calibration="second"))
    assert [(each.epoch, each.baseline) for each in (store[n] for n in range(5))] == [(0, 0)] * 3 + [(1, 3)] * 2
    store.close()


def test_a_writer_adds_metrics(tmp_path: Path) -> None:
    _made(tmp_path / "s", 2).close()
    store = open_store(tmp_path / "s", write=True, metrics={"porosity": "1", "net_volume": "mm3"})
    assert store.about.metrics == {**METRICS, "porosity": "1"}
    measured = dict(tick(2).metrics)
    store.append(replace(tick(2), metrics={**measured, "porosity": measured["net_volume"]}))
    np.testing.assert_array_equal(store.series()["porosity"], [np.nan, np.nan, -3.0])
    store.close()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no such store"),
        (lambda path: path.write_text("hello"), "is a file"),
        (lambda path: path.mkdir(), "has no snapshots"),
        (lambda path: (path.mkdir(), (path / "00.png").write_text("x")), "has no snapshots"),
        (lambda path: zarr.create_group(path), "has no snapshots"),
        (lambda path: icechunk.Repository.create(icechunk.local_filesystem_storage(str(path))), "holds a whole store"),
    ],
)
@pytest.mark.parametrize("write", [False, True])
def test_a_path_that_is_no_store(tmp_path: Path, make: object, message: str, write: bool) -> None:
    path = tmp_path / "s"
    make(path)  # type: ignore[operator]  # a row of the table
    before = sorted(path.rglob("*")) if path.is_dir() else path.exists()
    with pytest.raises(StoreError, match=message) as caught:
        open_store(path, write=write)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    if message != "holds a whole store":
        assert (sorted(path.rglob("*")) if path.is_dir() else path.exists()) == before


def test_a_repository_of_another_program_and_a_newer_schema_are_named(tmp_path: Path) -> None:
    _made(tmp_path / "s", 1).close()
    repository = icechunk.Repository.open(icechunk.local_filesystem_storage(str(tmp_path / "s")))
    for value, message in ((SCHEMA + 1, "newer microrelief"), ("x", "not a microrelief store")):
        session = repository.writable_session("main")
        zarr.open_group(session.store).attrs["microrelief_schema"] = value
        session.commit("changed")
        with pytest.raises(StoreError, match=message):
            open_store(tmp_path / "s")


def test_a_store_is_made_once(tmp_path: Path) -> None:
    _made(tmp_path / "s").close()
    with pytest.raises(StoreError, match="exists already"):
        _made(tmp_path / "s")
    (tmp_path / "empty").mkdir()
    _made(tmp_path / "empty").close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "s"]
    with pytest.raises(StoreError, match="cannot be made"):
        _made(tmp_path / "s" / "config.yaml" / "deeper")
    for elsewhere in ("gs://bucket/site", "https://example.org/site", "s3://"):
        with pytest.raises(StoreError, match="is no place for a store"):
            open_store(elsewhere)


def test_raw_frames_are_kept_where_a_tick_holds_them(tmp_path: Path) -> None:
    store = _made(tmp_path / "s")
    assert "raw" not in root_of(_session(tmp_path / "s"))
    patterns = PatternSet("gray", (4, 4), bits=(2, 0))
    count = len(patterns.roles)
    rng = np.random.default_rng(1)
    stacks = rng.integers(0, 256, (2, count, 6, 8)).astype(np.uint8)
    store.append(replace(tick(0), frames=Frames(stacks[0], surface(0).time, patterns, 8.0)))
    store.append(replace(failure(1), frames=Frames(stacks[1], at(1), patterns, 8.0)))
    store.append(replace(tick(2), frames=Frames(stacks[0].astype(np.uint16), surface(2).time, patterns)))
    raw = root_of(_session(tmp_path / "s"))["raw"]
    kinds = sorted((sorted(name for name, _ in group.arrays()), list(group["scan"][:])) for _, group in raw.groups())
    assert [(names[0], scans) for names, scans in kinds] == [("differences", [0, -1]), ("exposure_ms", [1])]
    group = next(group for _, group in raw.groups() if "differences" in group)
    np.testing.assert_array_equal(np.cumsum(group["differences"][:], axis=-1, dtype=np.uint8), stacks)
    assert json.dumps(group.attrs["patterns"]["size"]) == "[4, 4]"
    store.close()


def test_a_grid_larger_than_a_chunk(tmp_path: Path) -> None:
    grid = Grid(530, 1030, 0.01)
    store = create_store(tmp_path / "s", site="x", grid=grid)
    scan = surface(0, grid)
    store.append(replace(tick(0), scan=scan))
    np.testing.assert_allclose(store[0].scan.height, scan.height, rtol=0, atol=0.000251)
    np.testing.assert_array_equal(store[0].scan.texture, scan.texture)
    store.close()


def test_events_come_in_the_order_of_their_time(tmp_path: Path) -> None:
    store = _made(tmp_path / "s", 1)
    late, early = Event(at(3), "note", "später"), Event(START - np.timedelta64(1, "h"), "note", "früher")
    store.append(replace(failure(3), events=(late, early)))
    assert [event.text for event in store.events if event.kind == "note"] == ["früher", "später"]
    store.close()
