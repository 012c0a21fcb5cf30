"""What every store of STORES promises."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import InputError, MicroreliefError, StoreError
from pipelines import Event, Grid, Instant, Measurement, Tick
from storage import STORES, Store, create_store
from storage.layout import SCHEMA

from .ticks import GRID, METRICS, at, calibration, change_of, failure, surface, tick


@pytest.fixture(params=[*STORES, "icechunk on S3"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    kind, _, on_s3 = request.param.partition(" on ")
    made = create_store(
        f"{request.getfixturevalue('s3_prefix')}/site.icechunk" if on_s3 else tmp_path / "site.icechunk",
        site="plot 7",
        grid=GRID,
        campaign="site: plot 7\n",
        campaign_hash="abc123",
        metrics=METRICS,
        software="microrelief 0.0",
        kind=kind,
    )
    yield made
    made.close()


def test_is_a_store(store: Store) -> None:
    assert isinstance(store, Store)


def test_an_empty_store_can_be_read(store: Store) -> None:
    assert len(store) == 0
    for number in (-1, 0):
        with pytest.raises(IndexError, match="holds 0"):
            store[number]
    assert store.events == ()
    assert store.window().sizes["time"] == 0
    series = store.series()
    assert list(series.columns) == ["scan", "net_volume", "net_volume_sigma", "edge_lift", "edge_lift_sigma"]
    assert len(series) == 0
    assert str(series.index.tz) == "UTC"  # type: ignore[attr-defined]  # a DatetimeIndex, by the protocol


def test_says_what_it_is(store: Store) -> None:
    about = store.about
    assert (about.site, about.grid, about.campaign) == ("plot 7", GRID, "site: plot 7\n")
    assert (about.campaign_hash, about.software, about.schema) == ("abc123", "microrelief 0.0", SCHEMA)
    assert about.metrics == METRICS
    store.append(tick(0))
    assert store.about.snapshot != about.snapshot


def test_gives_back_what_it_was_given(store: Store) -> None:
    given = [tick(number, alarm="warning") for number in range(3)]
    assert [store.append(each) for each in given] == [0, 1, 2]
    assert len(store) == 3
    for number, each in enumerate(given):
        stored = store[number]
        scan, truth = stored.scan, each.scan
        assert truth is not None
        assert (stored.number, stored.epoch, stored.baseline, stored.planned) == (number, 0, 0, at(number))
        assert (scan.time, scan.grid, scan.calibration_id) == (truth.time, truth.grid, "first")
        np.testing.assert_allclose(scan.height, truth.height, rtol=0, atol=0.000251)
        np.testing.assert_allclose(scan.sigma, truth.sigma, rtol=0.008)
        np.testing.assert_array_equal(scan.texture, truth.texture)
        np.testing.assert_array_equal(scan.level, truth.level)
        assert stored.alarms == dict(each.alarms)
    assert store[0].change is None
    change, truth_change = store[-1].change, given[2].change
    assert change is not None
    assert truth_change is not None
    np.testing.assert_allclose(change.dz, truth_change.dz, rtol=0, atol=0.000251)
    np.testing.assert_allclose(change.lod, truth_change.lod, rtol=0.004)
    np.testing.assert_array_equal(change.motion.matrix, truth_change.motion.matrix)
    assert replace(change.motion, matrix=np.eye(4), sigma_xy_mm=0.0).reason == "few stable cells"
    for name in ("residual_mm", "overlap", "conditioning", "sigma_z_mm", "sigma_xy_mm", "verdict"):
        np.testing.assert_equal(getattr(change.motion, name), getattr(truth_change.motion, name))
    assert change.baseline_time == store[0].scan.time
    with pytest.raises(IndexError, match="no scan 3"):
        store[3]
    assert store[-3].number == 0


def test_a_measured_cell_stays_measured_and_a_hole_stays_a_hole(store: Store) -> None:
    store.append(tick(0))
    scan = store[0].scan
    np.testing.assert_array_equal(np.isnan(scan.height), np.isnan(surface(0).height))
    np.testing.assert_array_equal(np.isnan(scan.sigma), np.isnan(scan.height))
    assert (scan.sigma[np.isfinite(scan.sigma)] > 0).all()


def test_series(store: Store) -> None:
    for number in range(3):
        store.append(tick(number))
    series = store.series()
    assert series.attrs["units"] == METRICS
    assert list(series["scan"]) == [0, 1, 2]
    np.testing.assert_array_equal(series["net_volume"], [np.nan, -1.5, -3.0])
    np.testing.assert_array_equal(series["net_volume_sigma"], [np.nan, 0.25, 0.25])
    assert series["edge_lift_sigma"].isna().all()
    assert series.index[1].asm8 == surface(1).time
    assert series.index.name == "time"


WINDOWS: tuple[tuple[Instant | None, Instant | None, list[int]], ...] = (
    (None, None, [0, 1, 2, 3]),
    (at(1), None, [1, 2, 3]),
    (None, at(2), [0, 1]),
    (surface(1).time, surface(2).time, [1, 2]),
    (at(9), None, []),
)


def test_window(store: Store) -> None:
    for number in range(4):
        store.append(tick(number))
    for first, last, expected in WINDOWS:
        window = store.window(first, last)
        assert list(window["scan"].values) == expected
        assert dict(window.sizes) == {"time": len(expected), "y": GRID.rows, "x": GRID.columns}
        names = {"height", "sigma", "texture", "level", "dz", "lod", "scan", "epoch", "planned", "calibration"}
        assert set(window.data_vars) == names
        assert window["x"].attrs["units"] == window["y"].attrs["units"] == "mm"
        np.testing.assert_allclose(window["x"], GRID.x_mm)
        assert window["time"].dtype == np.dtype("datetime64[ns]")
        if expected:
            np.testing.assert_allclose(window["height"][-1], surface(expected[-1]).height, rtol=0, atol=0.000251)
            assert window["planned"].values[-1] == at(expected[-1])
            assert str(window["calibration"].values[-1]) == "first"


def test_a_failed_visit_leaves_only_its_events(store: Store) -> None:
    store.append(tick(0))
    assert store.append(failure(1)) is None
    assert len(store) == 1
    assert store.events[-1] == Event(at(1), "failed", "the camera did not answer")
    assert store.append(tick(2)) == 1


def test_another_calibration_starts_an_epoch(store: Store) -> None:
    store.append(tick(0))
    store.append(tick(1))
    with pytest.raises(StoreError, match="starts an epoch"):
        store.append(tick(2, baseline=1, calibration="second"))
    store.append(tick(2, baseline=None, calibration="second"))
    store.append(tick(3, baseline=2, calibration="second"))
    assert [(store[n].epoch, store[n].baseline) for n in range(4)] == [(0, 0), (0, 0), (1, 2), (1, 2)]
    epochs = [event for event in store.events if event.kind == "epoch"]
    assert [event.time for event in epochs] == [surface(0).time, surface(2).time]
    assert "first -> second" in epochs[1].text


def test_an_epoch_event_chooses_a_new_baseline(store: Store) -> None:
    store.append(tick(0))
    chosen = Event(at(1), "epoch", "the site was watered")
    store.append(replace(tick(1, baseline=None), events=(chosen,)))
    assert (store[1].epoch, store[1].baseline) == (1, 1)
    assert [event for event in store.events if event.kind == "epoch"][1:] == [chosen]


def test_a_scan_without_change_keeps_its_epoch(store: Store) -> None:
    store.append(tick(0))
    store.append(tick(1, baseline=None))
    store.append(tick(2))
    assert [(store[n].epoch, store[n].baseline) for n in range(3)] == [(0, 0)] * 3
    assert store[1].change is None


def _twisted(what: str) -> Tick:
    scan = surface(1)
    other = Grid(GRID.rows, GRID.columns, GRID.pitch_mm, GRID.x0_mm + 1, GRID.y0_mm)
    height = scan.height.copy()
    height[10, 10] = 17.0
    return {
        "another grid": Tick(at(1), replace(scan, grid=other)),
        "not newer": Tick(at(1), replace(surface(0), height=scan.height)),
        "not one of this store's": Tick(at(1), scan, metrics={"porosity": Measurement(0.1, 0.01)}),
        "but the baseline of epoch 0 is scan 0": Tick(at(1), scan, change_of(scan, surface(7))),
        "17 mm does not fit": Tick(at(1), replace(scan, height=height)),
        "inf mm does not fit": Tick(at(1), replace(scan, height=np.full_like(height, np.inf))),
    }[what]


def test_refuses_what_does_not_fit_and_stays_as_it_was(store: Store) -> None:
    store.append(tick(0))
    before = store.about.snapshot
    for message in (
        "another grid",
        "not newer",
        "not one of this store's",
        "but the baseline of epoch 0 is scan 0",
        "17 mm does not fit",
        "inf mm does not fit",
    ):
        with pytest.raises(StoreError, match=message) as caught:
            store.append(_twisted(message))
        assert "\n" not in str(caught.value)
        assert isinstance(caught.value, MicroreliefError)
        assert (len(store), store.about.snapshot) == (1, before)
    assert store.append(tick(1)) == 1


def test_keeps_each_calibration_once(store: Store) -> None:
    first, second = calibration(), calibration(1.1)
    for number, each in enumerate((first, first, second)):
        scan = surface(number, calibration_id=each.id)
        store.append(Tick(at(number), scan, calibration=each))
    assert store.calibration(first.id).as_mapping() == first.as_mapping()
    assert store.calibration(second.id).id == second.id
    with pytest.raises(KeyError, match="no calibration 'third'"):
        store.calibration("third")


def test_a_closed_store_takes_nothing(store: Store) -> None:
    store.append(tick(0))
    store.close()
    store.close()
    with pytest.raises(StoreError):
        store.append(tick(1))
    assert len(store) == 1


def test_heights_of_metres_fit_where_the_grid_is_wide(tmp_path: Path) -> None:
    wide = Grid(8, 8, 100.0)
    for kind in STORES:
        store = create_store(tmp_path / kind, site="wall", grid=wide, kind=kind)
        scan = surface(0, wide)
        store.append(Tick(at(0), scan))
        assert np.nanmax(np.abs(scan.height)) > 100
        np.testing.assert_allclose(store[0].scan.height, scan.height, rtol=0, atol=0.00026)
        store.close()


def test_an_unknown_kind_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="choose one of icechunk, memory"):
        create_store(tmp_path / "s", site="x", grid=GRID, kind="tape")
