"""The live preview: the newest scan takes the place of the one before, in a viewer on this machine alone."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from configs import MicroreliefError
from dashboards import Preview, open_preview
from pipelines import Grid, Scan, parse_instant

T0 = parse_instant("2026-01-01T00:00:00Z")
GRID = Grid(30, 40, 0.1)


def scan(height: float) -> Scan:
    cells = np.full(GRID.shape, height, np.float32)
    cells[0] = np.nan
    cells[1] = 0.0
    nothing = np.zeros(GRID.shape, np.uint8)
    return Scan(GRID, T0, cells, np.full_like(cells, 0.01), nothing, nothing)


def free_port() -> int:
    """Give a port that is free, and whose next one is."""
    for _ in range(50):
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port
    raise AssertionError("no two free ports beside each other")


def test_a_scan_takes_the_place_of_the_one_before_and_a_closed_viewer_is_noticed(tmp_path: Path) -> None:
    viewer = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, text=True)
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "shown.rrd")
    preview = Preview(stream, "", viewer)
    assert preview.show(scan(0.2))
    assert preview.show(scan(0.7))
    blank = Scan(GRID, T0, *(np.full(GRID.shape, np.nan, np.float32),) * 2, *(np.zeros(GRID.shape, np.uint8),) * 2)
    assert preview.show(blank), "nothing to see, and nothing wrong"
    viewer.communicate("\n")
    assert not preview.show(scan(0.9))
    stream.flush()
    stream.disconnect()
    tallest = [
        max(z for _, _, z in vertices if np.isfinite(z))
        for chunk in RrdReader(tmp_path / "shown.rrd").store().stream()
        for vertices in chunk.to_record_batch().to_pydict().get("Mesh3D:vertex_positions", ())
    ]
    assert tallest[-1] == pytest.approx(0.7), "what a viewer holds of several is the last"


def test_it_opens_for_a_browser_of_this_machine_and_ends(tmp_path: Path) -> None:
    port = free_port()
    with open_preview(web=True, port=port) as preview:
        assert preview.link.startswith(f"http://127.0.0.1:{port}/")
        assert preview.show(scan(0.2))
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0, "the viewer is gone"


def test_without_a_screen_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(MicroreliefError, match="--web"), open_preview():
        pass
