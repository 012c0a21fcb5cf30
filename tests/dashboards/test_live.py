"""Live: what is handed over arrives, the last hour first, and who hands it over never waits."""

from __future__ import annotations

import signal
import time
import warnings
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from dashboards import LiveReview
from dashboards.live import WAITING
from dashboards.viewer import LOCAL, end, free_port, start, viewer_program, wait_until_listening
from monitor.live_review import ticks_since
from pipelines import Acknowledgement, Event, Measurement, Tick

from .drying import UNITS, DryingStore, drying_store


@contextmanager
def receiver(file: Path) -> Iterator[str]:
    """A program of Rerun's that writes to a file what is sent to it."""
    port = free_port()
    program = start([str(viewer_program()), "--save", str(file), "--bind", LOCAL, "--port", str(port)])
    try:
        wait_until_listening(program, port)
        yield f"rerun+http://{LOCAL}:{port}/proxy"
        wait_until_written(file)
    finally:
        program.send_signal(signal.SIGINT)
        try:
            program.wait(10)
        finally:
            end(program)


def wait_until_written(file: Path) -> None:
    """Until the file no longer grows: what was received is dropped by a program that is told to end."""
    sizes: deque[int] = deque(maxlen=8)
    for _ in range(100):
        sizes.append(file.stat().st_size if file.exists() else 0)
        if len(sizes) == sizes.maxlen and len(set(sizes)) == 1:
            return
        time.sleep(0.1)


def logged(file: Path) -> dict[str, list[int]]:
    """Scan numbers by entity."""
    from rerun.chunk import RrdReader

    found: dict[str, list[int]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a file which was written as it came has no table of contents
        chunks = list(RrdReader(file).stream())
    for chunk in chunks:
        found.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pydict().get("scan", []))
    return found


def states(file: Path, lane: str) -> list[str]:
    """What a lane says, by time."""
    from rerun.chunk import RrdReader

    told: list[tuple[str, str]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for chunk in RrdReader(file).stream():
            columns = chunk.to_record_batch().to_pydict()
            if str(chunk.entity_path) == lane and "StateChange:state" in columns:
                told += zip(
                    map(str, columns["time"]), (state for (state,) in columns["StateChange:state"]), strict=True
                )
    return [state for _, state in sorted(told)]


def ticks(store: DryingStore) -> list[tuple[Tick, int]]:
    """The visits of a store as they were handed over."""
    return list(ticks_since(store, 0, store.events))


def test_a_late_review_begins_with_what_is_there_and_goes_on(tmp_path: Path) -> None:
    whole = drying_store(6, 40)
    with receiver(tmp_path / "live.rrd") as address:
        live = LiveReview(address, whole.about, interval_s=6 * 3600)
        early = DryingStore(whole.about, whole.scans[:4], whole.events[:2], whole.table.iloc[:4])
        assert live.attach(early) == 4
        for tick, number in ticks(whole)[4:]:
            live.show(tick, number)
        later = [whole.scans[-1].planned + np.timedelta64(hour, "h") for hour in (1, 2, 3)]
        seen_by = Acknowledgement(later[1], "crack opening", "Ann").event
        for event in (Event(later[0], "failed", "no light"), seen_by, Event(later[2], "annotation", "watered")):
            live.show(Tick(event.time, events=(event,)), 5)
            live.wait_until_shown()
        live.close()
        assert (live.left_out, live.trouble) == (0, "")
    seen = logged(tmp_path / "live.rrd")
    # of the first four only the last lies in the last hour; all are in the trends
    assert sorted(seen["/surface/mesh"]) == [3, 4, 5]
    assert sorted(set(seen["/trends/net_volume"])) == [0, 1, 2, 3, 4, 5]
    assert seen["/baseline/mesh"] == [0]
    assert sorted(set(seen["/cracks/1"])) == [3, 4, 5]
    assert states(tmp_path / "live.rrd", "/visits")[-2:] == ["taken", "failed"], "a remark is no visit"
    assert states(tmp_path / "live.rrd", "/alarm/crack_opening")[-2:] == ["alarm", "acknowledged"]


def test_a_video_is_shown_from_its_first_scan_without_cracks(tmp_path: Path) -> None:
    whole = drying_store(3, 40)
    with receiver(tmp_path / "live.rrd") as address:
        live = LiveReview(address, whole.about, preset="video", interval_s=1.0)
        for tick, number in ticks(whole):
            live.show(tick, number)
            live.wait_until_shown()
        live.close()
    seen = logged(tmp_path / "live.rrd")
    assert seen["/surface/mesh"] == [0, 1, 2]
    assert seen["/maps/change"][-2:] == [1, 2]
    assert "/cracks/1" not in seen


def test_who_hands_over_never_waits_and_what_was_left_out_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import threading

    gate = threading.Event()
    monkeypatch.setattr(LiveReview, "_send", lambda self, tick, number: gate.wait(10))
    whole = drying_store(1, 20)
    with receiver(tmp_path / "live.rrd") as address:
        live = LiveReview(address, whole.about)
        for number in range(WAITING + 4):
            live.show(Tick(whole.scans[0].planned), number)
        assert live.left_out in (3, 4)  # one is being drawn or still waits
        gate.set()
        live.close()


def test_visits_since_are_told_with_their_events_and_measurements() -> None:
    whole = drying_store(6, 20)
    assert len(whole.events) > 2
    found = list(ticks_since(whole, 4, (whole.events[0], whole.events[2])))
    assert [number for _, number in found] == [4, 5]
    tick = found[-1][0]
    assert isinstance(tick.metrics["crack_opening"], Measurement)
    assert set(tick.metrics) == set(UNITS)
    assert [event.kind for each, _ in found for event in each.events] == [
        whole.events[1].kind,
        *(event.kind for event in whole.events[3:]),
    ]
