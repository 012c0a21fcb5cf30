"""Live review: it stops sending before its viewer goes, and a viewer whose window was closed is no error."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from dashboards import Preset
from monitor import live_review
from monitor.live_review import Follower
from pipelines import Event as Remark
from pipelines import Tick
from storage import About, Inbox, Store, open_store

from ..dashboards.drying import drying_store
from ..dashboards.filled_store import fill_store

ADDRESS = "rerun+http://127.0.0.1:9/proxy"
ROOT = Path(__file__).resolve().parents[2]

CLOSED = """
import os
import sys
from dashboards import LiveReview
from dashboards.viewer import LOCAL, end, free_port, start, viewer_program, wait_until_listening
from tests.dashboards.drying import drying_store

port = free_port()
viewer = start([str(viewer_program()), "--save", sys.argv[1], "--bind", LOCAL, "--port", str(port)])
wait_until_listening(viewer, port)
store = drying_store(2, 10)
live = LiveReview(f"rerun+http://{LOCAL}:{port}/proxy", store.about)
live.attach(store)
end(viewer)
live.close()
assert "RUST_LOG" not in os.environ
"""


def test_it_stops_sending_before_the_viewer_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    order = []

    def follow(opened: Store, path: str, address: str, preset: Preset, ended: Event) -> None:
        ended.wait()
        order.append(f"all is sent to {address}")

    monkeypatch.setattr(live_review, "follow_store", follow)
    with Follower(drying_store(1, 10), "site.icechunk", "overview").at(ADDRESS):
        order.append("asked to end")
    order.append("the viewer goes")
    assert order == ["asked to end", f"all is sent to {ADDRESS}", "the viewer goes"]


@pytest.mark.parametrize("early", [True, False])
def test_what_fails_is_told_unless_the_viewer_is_gone(monkeypatch: pytest.MonkeyPatch, *, early: bool) -> None:
    def follow(opened: Store, path: str, address: str, preset: Preset, ended: Event) -> None:
        if not early:
            ended.wait()
        raise OSError("the connection is severed")

    monkeypatch.setattr(live_review, "follow_store", follow)
    follower = Follower(drying_store(1, 10), "site.icechunk", "overview")

    def look() -> None:
        with follower.at(ADDRESS):
            for thread in threading.enumerate() if early else ():
                if thread.name == "follow":
                    thread.join()

    if early:
        with pytest.raises(OSError, match="severed"):
            look()
    else:
        look()


class Shown:
    """A live review that remembers what it was told."""

    def __init__(self, address: str, about: About, **options: object) -> None:
        self.remarks: list[str] = []
        SHOWN.append(self)

    def attach(self, store: Store) -> int:
        return len(store)

    def show(self, tick: Tick, number: int) -> None:
        self.remarks += [event.text for event in tick.events]

    def wait_until_shown(self) -> None:
        pass

    def close(self) -> None:
        pass


SHOWN: list[Shown] = []


class Steps(Event):
    """Something happens each time that the follower waits; then it is to end."""

    def __init__(self, *steps: Callable[[], None]) -> None:
        super().__init__()
        self.steps = list(steps)

    def wait(self, timeout: float | None = None) -> bool:
        if self.steps:
            self.steps.pop(0)()
            return False
        return True


def test_a_remark_that_waits_is_shown_at_once_and_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = fill_store(drying_store(2, 10), tmp_path / "plot.icechunk")
    inbox = Inbox(path)
    moment = np.datetime64("2026-05-04T13:00:00", "ns")
    early, late = (Remark(moment + np.timedelta64(hour, "h"), "annotation", f"rain {hour}") for hour in range(2))

    def take_in() -> None:
        files, events = zip(*inbox.waiting(), strict=True)
        store = open_store(path, write=True)
        store.append(Tick(moment, events=events))
        store.close()
        inbox.taken(files)

    monkeypatch.setattr(live_review, "LiveReview", Shown)
    inbox.put(early)  # drawn by what attaches
    steps = Steps(take_in, lambda: inbox.put(late), lambda: None, take_in, lambda: None)
    live_review.follow_store(open_store(path), path, ADDRESS, "overview", steps)
    assert SHOWN.pop().remarks == ["rain 1"]


def test_a_closed_window_prints_no_error(tmp_path: Path) -> None:
    command = [sys.executable, "-c", CLOSED, str(tmp_path / "live.rrd")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
