"""Live review: it stops sending before its viewer goes, and a viewer whose window was closed is no error."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from threading import Event

import pytest

from dashboards import Preset
from monitor import live_review
from monitor.live_review import Follower
from storage import Store

from ..dashboards.drying import drying_store

ADDRESS = "rerun+http://127.0.0.1:9/proxy"
ROOT = Path(__file__).resolve().parents[2]

CLOSED = """
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


def test_a_closed_window_prints_no_error(tmp_path: Path) -> None:
    command = [sys.executable, "-c", CLOSED, str(tmp_path / "live.rrd")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
