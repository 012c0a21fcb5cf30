"""Questions to a store: which scan, what a place did, what was known when; and the example in the documents."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from configs import InputError, StoreError
from pipelines import Grid, Tick, as_datetime, format_instant
from storage import (
    STORES,
    Store,
    cell_history,
    coarse_maps,
    create_store,
    find_scan,
    line_history,
    open_store,
    snapshots,
)
from storage.icechunk_store import IcechunkStore
from storage.location import location_of
from storage.past import Moment

from .ticks import GRID, METRICS, at, change_of, failure, surface, tick

ROOT = Path(__file__).resolve().parents[2]


def _filled(place: Path | str, kind: str = "icechunk") -> Store:
    made = create_store(place, site="x", grid=GRID, metrics=METRICS, kind=kind)
    for number in range(3):
        made.append(tick(number))
    return made


@pytest.fixture(scope="module", params=list(STORES))
def store(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    made = _filled(tmp_path_factory.mktemp("reading") / "s", request.param)
    yield made
    made.close()


def test_a_scan_by_its_time(store: Store) -> None:
    taken, second = surface(1).time, np.timedelta64(1, "s")
    assert (
        find_scan(store, taken, "exact") == find_scan(store, taken, "before") == find_scan(store, taken, "after") == 1
    )
    assert find_scan(store, taken + second, "before") == find_scan(store, taken - second, "after") == 1
    assert find_scan(store, taken + second) == find_scan(store, taken - second) == 1
    assert (find_scan(store, at(-100)), find_scan(store, at(100))) == (0, 2)
    half = np.timedelta64(3, "h")
    assert find_scan(store, taken + half) == 1, "equally near: the earlier"
    assert find_scan(store, taken + half + np.timedelta64(1, "ns")) == 2


@pytest.mark.parametrize(
    ("hours", "which", "told"),
    [
        (1, "exact", "no scan at"),
        (-1, "before", "no scan before"),
        (100, "after", "no scan after"),
        (0, "next", "one of"),
    ],
)
def test_no_such_scan_is_one_line(store: Store, hours: int, which: str, told: str) -> None:
    time = surface(0).time + np.timedelta64(hours, "h")
    with pytest.raises(InputError, match=told) as caught:
        find_scan(store, time, which)  # type: ignore[arg-type]  # one of them is wrong
    assert "\n" not in str(caught.value)


def test_a_cell_through_time(store: Store) -> None:
    x, y = GRID.x_mm[17], GRID.y_mm[9]
    for name, truth in (
        ("height", [np.nanmean(surface(n).height[8:16, 16:24]) for n in range(3)]),
        ("dz", [np.nan, *(np.nanmean((surface(n).height - surface(0).height)[8:16, 16:24]) for n in (1, 2))]),
    ):
        history = cell_history(store, x, y, name)  # type: ignore[arg-type]  # two literals
        np.testing.assert_allclose(history.values, truth, rtol=0, atol=0.000251)
        assert (history.dims, history.attrs["units"], history.dtype.name) == (("time",), "mm", "float32")
        assert list(history["time"].values) == [surface(n).time for n in range(3)]
        assert float(history["x"]) == pytest.approx(GRID.x_mm[16:24].mean())
        assert float(history["y"]) == pytest.approx(GRID.y_mm[8:16].mean())


def test_coarse_maps_are_what_the_histories_of_their_cells_say(store: Store) -> None:
    for name in ("height", "dz"):
        history = cell_history(store, GRID.x_mm[17], GRID.y_mm[9], name)
        maps = [each[1, 2] for _, each in coarse_maps(store, [0, 1, 2], name)]
        np.testing.assert_array_equal(maps, history.values)


def test_a_line_through_time(store: Store) -> None:
    start, end = (GRID.x_mm[0], GRID.y_mm[0]), (GRID.x_mm[-1], GRID.y_mm[-1])
    line = line_history(store, start, end)
    assert line.dims == ("time", "distance")
    assert float(line["distance"][-1]) == pytest.approx(np.hypot(GRID.x_mm[-1] - start[0], GRID.y_mm[-1] - start[1]))
    for point in range(line.sizes["distance"]):
        x, y = np.interp(float(line["distance"][point]), [0, float(line["distance"][-1])], [0, 1]) * (
            np.array(end) - start
        ) + np.array(start)
        np.testing.assert_array_equal(line[:, point].values, cell_history(store, float(x), float(y)).values)
    assert line_history(store, start, start).sizes["distance"] == 1


def test_the_same_from_a_bucket(s3_prefix: str) -> None:
    _filled(s3_prefix).close()
    store = open_store(s3_prefix)
    assert find_scan(store, surface(1).time) == 1
    history = cell_history(store, GRID.x_mm[17], GRID.y_mm[9])
    truth = [np.nanmean(surface(n).height[8:16, 16:24]) for n in range(3)]
    np.testing.assert_allclose(history.values, truth, rtol=0, atol=0.000251)
    newest, *_, oldest = snapshots(s3_prefix)
    assert (len(open_store(s3_prefix, snapshot=newest.id)), len(open_store(s3_prefix, as_of=oldest.written))) == (3, 0)


@pytest.mark.parametrize(("x", "y", "axis"), [(-0.74, -0.4, "x"), (0.0, 0.58, "y")])
def test_a_place_beyond_the_grid_is_told(store: Store, x: float, y: float, axis: str) -> None:
    with pytest.raises(InputError, match=f"^{axis} must lie on the grid, from -"):
        cell_history(store, x, y)
    with pytest.raises(InputError, match="histories are of height and dz"):
        cell_history(store, 0, 0, "sigma")  # type: ignore[arg-type]  # the mistake


def test_histories_over_folded_and_single_scans_and_several_chunks(tmp_path: Path) -> None:
    """A grid of more than one chunk of coarse cells, and more scans than one fold."""
    grid = Grid(16, 8 * 70, 0.01)
    store = create_store(tmp_path / "s", site="x", grid=grid)
    steps = np.arange(grid.columns, dtype=np.float32) // 8 * 0.001
    first = replace(surface(0, grid), height=np.full(grid.shape, 0.0, np.float32) + steps)
    for number in range(67):
        scan = replace(surface(number, grid), height=first.height + np.float32(0.01 * number))
        store.append(Tick(at(number), scan, change_of(scan, first) if number else None))
    store.close()
    binned = IcechunkStore(location_of(tmp_path / "s"), None).binned
    assert binned["height"].shape == (64, 2, 70)
    assert binned["height"].chunks == (64, 2, 64)
    assert binned["x"][0] == pytest.approx(grid.x_mm[:8].mean())
    ends = (grid.x_mm[0], grid.y_mm[0]), (grid.x_mm[-1], grid.y_mm[0])
    reader = open_store(tmp_path / "s")
    line, risen = line_history(reader, *ends), line_history(reader, *ends, "dz")
    columns = np.round((line["x"].values - grid.x0_mm - 0.035) / 0.08).astype(int)
    assert list(np.unique(columns)) == list(range(70)), "steps of no more than one of the 8x8 cells"
    expected = 0.01 * np.arange(67)[:, np.newaxis]
    np.testing.assert_allclose(line.values, expected + 0.001 * columns, rtol=0, atol=0.000251)
    assert np.isnan(risen.values[0]).all()
    np.testing.assert_allclose(risen.values[1:] - expected[1:], 0, atol=0.000251)
    # the same cells as whole maps: from the folded ones, and from the tail
    maps = dict(coarse_maps(reader, [0, 5, 63, 66], "dz"))
    assert list(maps) == [0, 5, 63, 66]
    assert {each.shape for each in maps.values()} == {(2, 70)}
    assert np.isnan(maps[0]).all()
    np.testing.assert_allclose([maps[n].mean() for n in (5, 63, 66)], [0.05, 0.63, 0.66], atol=0.0003)


def test_the_past(tmp_path: Path) -> None:
    writer = create_store(tmp_path / "s", site="x", grid=GRID, metrics=METRICS)
    known = [writer.about.snapshot]
    for each in (tick(0), failure(1), tick(2)):
        writer.append(each)
        known.append(writer.about.snapshot)
    writer.close()
    listed = list(snapshots(tmp_path / "s"))
    assert [each.id for each in listed] == known[::-1]
    assert [each.scan for each in listed] == [1, None, 0, None]
    assert listed[-1].message == "store created"
    for snapshot, scans in zip(listed, (2, 1, 1, 0), strict=True):
        written = snapshot.written
        moments: tuple[Moment, ...] = (written, as_datetime(written), format_instant(written))
        for past in (
            open_store(tmp_path / "s", snapshot=snapshot.id),
            *(open_store(tmp_path / "s", as_of=moment) for moment in moments),
        ):
            assert (len(past), past.about.snapshot) == (scans, snapshot.id)
            assert past.window().sizes["time"] == len(past.series()) == scans
    with pytest.raises(StoreError, match="open to read"):
        open_store(tmp_path / "s", snapshot=known[1]).append(tick(1))


def test_a_past_that_never_was(tmp_path: Path) -> None:
    create_store(tmp_path / "s", site="x", grid=GRID).close()
    path, newest = tmp_path / "s", next(snapshots(tmp_path / "s"))
    for wrong, message in (
        ({"snapshot": "0000000000"}, "there is no snapshot"),
        ({"as_of": "2001-01-01T00:00:00Z"}, "nothing was stored by 2001-01-01"),
    ):
        with pytest.raises(StoreError, match=message):
            open_store(path, **wrong)  # type: ignore[arg-type]  # a row of the table
    for mistake, message in (
        ({"as_of": "2026-01-01"}, "names? no .*zone|has no time zone"),
        ({"as_of": datetime(2026, 1, 1)}, "has no time zone"),  # noqa: DTZ001 - the mistake
        ({"snapshot": newest.id, "as_of": newest.written}, "exclude each other"),
        ({"snapshot": newest.id, "write": True}, "can only be read"),
    ):
        with pytest.raises(InputError, match=message):
            open_store(path, **mistake)


def test_the_example_in_the_documents_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every line of Python in docs/reading.md, in order, on a store like the demo's."""
    store = create_store(tmp_path / "demo.icechunk", site="x", grid=GRID, metrics=METRICS)
    for number in range(4):
        store.append(tick(number))
    store.close()
    text = (ROOT / "docs" / "reading.md").read_text(encoding="utf-8").replace("demo-out/demo.icechunk", "demo.icechunk")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) >= 5
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/reading.md", "exec"), names)
    assert names["scan"].number == 3  # type: ignore[attr-defined]  # the newest
    assert names["drop_mm"] == pytest.approx(-0.03, abs=0.003), "the surface of this store sinks by 10 um a scan"
