"""A campaign's polygons: read as they stand, cut at the map's edges, drawn by name; cracks are looked for inside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashboards import Region, gather, record_review
from dashboards.followed import Followed, follow
from dashboards.places import Places, cut_to, places_of
from dashboards.sections import maps
from pipelines import Grid
from pipelines.change import polygon_mask

from .drying import DryingStore, drying_store

SQUARE = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
RIM = ((4.0, -9.0), (9.0, -9.0), (9.0, 9.0), (4.0, 9.0))
CORNER = ((-5.0, 4.0), (-4.0, 5.0), (-5.0, 5.0))
NAMED = f"""
region_mm: {[list(corner) for corner in SQUARE]}
register: {{stable_mm: {[[list(corner) for corner in polygon] for polygon in (RIM, CORNER)]}}}
"""


@pytest.fixture(scope="module")
def crust() -> DryingStore:
    """Three scans of 10 x 10 mm, 20 x 20 cells, of a campaign with a region and two stable areas, one reaching out."""
    store = drying_store(3, 20)
    return replace(store, about=replace(store.about, campaign=store.about.campaign + NAMED))


def test_polygons_are_read_as_they_stand_and_what_is_none_is_left_out() -> None:
    assert places_of({}) == Places()
    found = places_of({"region_mm": [[0, 0], [1, 0], [1, 1]], "register": {"stable_mm": [[[0, 0], [2, 0], [2, 2]]]}})
    assert found == Places(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), (((0.0, 0.0), (2.0, 0.0), (2.0, 2.0)),))
    assert [name for name, _ in found.named] == ["region", "stable"]
    for broken in ("north", [[0, 0], [1, 1]], [[0, 0], [1, 0], [1, "x"]], [[0, 0], [1, 0], [1, float("nan")]], 3, None):
        assert places_of({"region_mm": broken, "register": {"stable_mm": [broken]}}) == Places()
    assert places_of({"register": ["stable_mm"]}) == Places()


def test_what_counts_is_the_region_less_what_holds_still() -> None:
    grid = Grid(20, 20, 0.5, -4.75, -4.75)
    assert Places().counted_cells(grid).all()
    assert not Places().stable_cells(grid).any()
    both = Places(SQUARE, (((1.0, -5.0), (5.0, -5.0), (5.0, 5.0), (1.0, 5.0)),))
    assert both.counted_cells(grid).sum() * grid.cell_mm2 == 3 * 4
    assert both.stable_cells(grid).sum() * grid.cell_mm2 == 4 * 10


@given(seed=st.integers(0, 2**32 - 1), corners=st.integers(3, 9))
def test_a_polygon_that_was_cut_marks_the_same_cells_and_stays_on_the_map(seed: int, corners: int) -> None:
    random = np.random.default_rng(seed)
    turns = np.sort(random.uniform(0, 2 * np.pi, corners))
    reach = random.uniform(0.5, 12, corners)
    polygon = tuple((float(r * np.cos(t)), float(r * np.sin(t))) for r, t in zip(reach, turns, strict=True))
    grid = Grid(15, 23, 0.4, -3.1, -4.2)
    cut = cut_to(polygon, grid)
    x_low, x_high, y_low, y_high = grid.extent_mm
    assert ((cut >= [x_low - 1e-9, y_low - 1e-9]) & (cut <= [x_high + 1e-9, y_high + 1e-9])).all()
    marked = polygon_mask([polygon], grid)
    if len(cut):
        np.testing.assert_array_equal(polygon_mask([cut.tolist()], grid), marked)
    else:
        assert not marked.any()


def test_a_polygon_beside_the_map_is_cut_to_nothing() -> None:
    assert cut_to(((7.0, 7.0), (8.0, 7.0), (8.0, 8.0)), Grid(20, 20, 0.5, -4.75, -4.75)).shape == (0, 2)


def test_a_review_draws_them_where_they_lie(crust: DryingStore, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    record_review(crust, tmp_path / "r.rrd")
    drawn: dict[str, Any] = {}
    for chunk in RrdReader(tmp_path / "r.rrd").store().stream():
        if (path := str(chunk.entity_path)).startswith("/maps/places/"):
            drawn |= {f"{path} {name}": value for name, value in chunk.to_record_batch().to_pydict().items()}
    (lines,) = drawn["/maps/places/line LineStrips2D:strips"]
    region, rim, corner = (np.array(line) for line in lines)
    # a cell is 0.5 mm wide, the map's upper left corner is at x = -5, y = 5
    assert sorted(map(tuple, region.tolist())) == sorted([(6, 14), (14, 14), (14, 6), (6, 6), (6, 14)])
    assert (rim[:, 0].min(), rim[:, 0].max(), rim[:, 1].min(), rim[:, 1].max()) == (18, 20, 0, 20)
    assert sorted(map(tuple, corner[:-1].tolist())) == [(0, 0), (0, 2), (2, 0)]
    assert all((line[0] == line[-1]).all() for line in (region, rim, corner))
    assert drawn["/maps/places/names Points2D:labels"] == [["region", "stable 1", "stable 2"]]


def test_cracks_are_looked_for_where_it_counts() -> None:
    last = drying_store(6, 80)[-1]
    everywhere, _ = follow(last, None, Followed(), Places(), plates=False)
    beside, _ = follow(last, None, Followed(), Places(((-5, -5), (-2, -5), (-2, 5), (-5, 5))), plates=False)
    assert everywhere.cracks
    assert all(abs(line.x_mm).max() < 3 for line in everywhere.lines[:1])
    assert not beside.cracks


def test_a_report_draws_them_on_its_maps_and_says_what_they_are(crust: DryingStore) -> None:
    section = maps(gather(crust))
    assert section is not None
    told = " ".join(section.text)
    assert "The outline is the campaign's region" in told
    assert "Dashed lines go around what holds still" in told
    drawings = [figure.svg for figure in section.figures if "camera" not in figure.caption]
    assert all(
        svg.count('class="outline region"') == 1 and svg.count('class="outline stable"') == 2 for svg in drawings
    )
    # 420 px for 10 mm; y is downwards from 5 mm
    assert 'class="outline region" fill="none" points="126.0,294.0 294.0,294.0 294.0,126.0 126.0,126.0"' in drawings[0]
    asked = maps(gather(crust, region=Region.parse("0,0,1,1")))
    assert asked is not None
    assert "The outline is the region that this report is about." in asked.text
    assert 'class="outline region" fill="none" points="210.0,210.0 252.0,210.0 252.0,168.0 210.0,168.0"' in (
        asked.figures[0].svg
    )
