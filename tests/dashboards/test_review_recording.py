"""The recording of a review: what is in it, and that the viewer shows all of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import InputError, StoreError
from dashboards import record_review
from dashboards.metric_names import trend_groups
from pipelines import Acknowledgement, AlarmChange

from .drying import UNITS, DryingStore, drying_store


@pytest.fixture(scope="module")
def recording(drying: DryingStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("review") / "review.rrd"
    record_review(drying, file)
    return file


def test_every_scan_metric_state_and_event_is_recorded(recording: Path) -> None:
    from rerun.chunk import RrdReader

    kept = RrdReader(recording).store().schema().entity_paths()
    assert {f"/maps/{name}" for name in ("height", "change", "sigma", "level", "camera", "cracks", "plates")} <= set(
        kept
    )
    assert {"/surface/mesh", "/baseline/mesh", "/log", "/visits", "/registration", "/tables/scan"} <= set(kept)
    assert {f"/trends/{name}" for name in UNITS} | {"/alarm/crack_opening", "/cracks/1", "/plates/1"} <= set(kept)


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


def test_the_names_of_lines_stand_where_they_hide_none(drying: DryingStore) -> None:
    table = drying.series().copy()
    rising = np.linspace(0, 1, len(table))
    for values, corner in ((rising, "LeftTop"), (-rising, "LeftBottom"), (rising * (1 - rising), "LeftBottom")):
        table["crack_area"] = values
        (group,) = trend_groups(table, {"crack_area": "mm2"})
        assert group.corner == corner


def test_chosen_scans_come_alone_at_full_resolution_beside_their_baseline(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    store = drying_store(4, 600)  # an overview has 300 x 300 of its cells
    record_review(store, tmp_path / "r.rrd", scans=(-2, -1))
    seen: dict[str, list[int]] = {}
    shapes = set()
    for chunk in RrdReader(tmp_path / "r.rrd").store().stream():
        columns = chunk.to_record_batch().to_pydict()
        seen.setdefault(str(chunk.entity_path), []).extend(columns.get("scan", []))
        for (kind,) in columns.get("DepthImage:format", []):
            shapes.add((kind["height"], kind["width"]))
    assert seen["/surface/mesh"] == [2, 3]
    assert seen["/baseline/mesh"] == [2]
    assert shapes == {(600, 600)}


def test_scans_that_are_not_there_are_refused(drying: DryingStore, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no scans 4 to 9: they are 0 to 5"):
        record_review(drying, tmp_path / "r.rrd", scans=(4, 9))
