"""The recording of a review: what is in it, and that the viewer shows all of it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import StoreError
from dashboards import record_review
from dashboards.metric_names import trend_groups
from pipelines import Acknowledgement, AlarmChange

from .drying import UNITS, DryingStore, drying_store
from .take_screenshot import Looker, looker, missing_libraries


@pytest.fixture(scope="module")
def recording(drying: DryingStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("review") / "review.rrd"
    record_review(drying, file)
    return file


def test_every_scan_metric_state_and_event_is_recorded(recording: Path) -> None:
    from rerun.chunk import RrdReader

    kept = RrdReader(recording).store().schema().entity_paths()
    assert {"/surface/mesh", "/maps/height", "/maps/change", "/camera", "/log", "/visits", "/registration"} <= set(kept)
    assert {f"/trends/{name}" for name in UNITS} | {"/alarm/crack_opening"} <= set(kept)


def test_the_lane_of_an_alarm_shows_silence_and_who_has_seen_it(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    crust = drying_store(4, 20)
    last, hour = crust.scans[-1].scan.time, np.timedelta64(1, "h")
    silence = AlarmChange(last + hour, "crack opening", "alarm", "no data")
    seen = Acknowledgement(last + 2 * hour, "crack opening", "Ann")
    record_review(replace(crust, events=(*crust.events, silence.event, seen.event)), tmp_path / "r.rrd")
    lane: dict[object, str] = {}
    for chunk in RrdReader(tmp_path / "r.rrd").store().stream():
        columns = chunk.to_record_batch().to_pydict()
        if str(chunk.entity_path) == "/alarm/crack_opening" and "StateChange:state" in columns:
            states = [state for (state,) in columns["StateChange:state"]]
            lane |= dict(zip(columns["time"], states, strict=True))
    assert [state for _, state in sorted(lane.items(), key=lambda each: str(each[0]))] == [
        "ok",
        "warning",
        "alarm",
        "no data",
        "acknowledged",
    ]


def test_an_empty_store_is_refused_with_one_line(empty: DryingStore, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="holds no scan yet"):
        record_review(empty, tmp_path / "review.rrd")
    assert not (tmp_path / "review.rrd").exists()


def test_progress_counts_the_scans(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    record_review(drying_store(3, 20), tmp_path / "r.rrd", progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_one_scan_and_no_change_can_be_reviewed(tmp_path: Path) -> None:
    record_review(drying_store(1, 30), tmp_path / "one.rrd")
    assert (tmp_path / "one.rrd").stat().st_size > 1000


def test_metrics_share_a_plot_only_where_both_can_be_seen(drying: DryingStore) -> None:
    groups = trend_groups(drying.series(), UNITS)
    assert [tuple(metric.name for metric in group.metrics) for group in groups] == [
        ("net_volume", "gained_volume", "lost_volume"),
        ("crack_area",),
        ("crack_opening", "edge_lift"),
    ]
    table = drying.series().copy()
    table["edge_lift"] /= 100
    assert [len(group.metrics) for group in trend_groups(table, UNITS)] == [3, 1, 1, 1]


@pytest.fixture(scope="module")
def look(recording: Path) -> Iterator[Looker]:
    lacking = missing_libraries()
    if lacking and not os.environ.get("MICRORELIEF_REQUIRE_SCREENSHOTS"):
        pytest.skip(lacking)
    with looker(recording) as opened:
        yield opened


def coloured(picture: np.ndarray) -> float:
    """Share of pixels that are neither grey nor black."""
    spread = picture.max(axis=-1).astype(int) - picture.min(axis=-1)
    return float((spread > 40).mean())


def test_every_view_of_the_review_shows_something(look: Looker) -> None:
    look.show(scan=5)
    names = set(look.views)
    assert {"Camera", "Log", "Visits and alarms"} <= names
    assert len([name for name in names if name.startswith(("Surface", "Change", "Height"))]) == 3
    assert len(names) == 6 + 3  # and three plots of trends
    least = {"Surface": 0.1, "Change": 0.02, "Height": 0.3, "Visits": 0.1, "Log": 0.001, "Camera": 0.0}
    for name in names:
        picture = look.picture(name)
        wanted = next((share for start, share in least.items() if name.startswith(start)), 0.003)
        assert coloured(picture) >= wanted, f"{name} shows nothing"
        assert picture.std() > 8, f"{name} is blank"
    assert look.complaints() == []


def test_scans_differ_where_the_surface_differs(look: Looker) -> None:
    for name in [name for name in look.views if name.startswith(("Surface", "Change", "Height"))]:
        look.show(scan=1)
        before = look.picture(name).astype(int)
        look.show(scan=5)
        after = look.picture(name).astype(int)
        assert (np.abs(after - before).max(axis=-1) > 30).mean() > 0.005, f"{name} stands still"


def test_cells_that_were_not_measured_are_holes_in_the_surface(look: Looker, drying: DryingStore) -> None:
    """The round hole of the synthetic crust shows the view's background inside the surface."""
    look.show(scan=0)
    picture = look.picture(next(name for name in look.views if name.startswith("Surface"))).astype(int)
    surface = picture.max(axis=-1) - picture.min(axis=-1) > 40
    inside = np.logical_and.reduce(
        [
            np.maximum.accumulate(surface, axis=0),
            np.maximum.accumulate(surface[::-1], axis=0)[::-1],
            np.maximum.accumulate(surface, axis=1),
            np.maximum.accumulate(surface[:, ::-1], axis=1)[:, ::-1],
        ]
    )
    background = np.abs(picture - np.array([24, 26, 30])).max(axis=-1) <= 2
    share = (inside & background).sum() / inside.sum()
    # the disc has 1.1 % of the area, the lone holes 0.1 % (each opens the triangles around it)
    assert 0.005 < share < 0.03
