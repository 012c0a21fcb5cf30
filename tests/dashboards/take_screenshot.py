"""Looks at a recording with the headless viewer: pictures of the window and of each view.

``python -m tests.dashboards.take_screenshot STORE_OR_RRD OUT.png [--scan N]`` makes the picture in the README.
"""

from __future__ import annotations

import argparse
import ctypes.util
import io
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import psutil
from PIL import Image

from dashboards.viewer import free_port, viewer_program

if TYPE_CHECKING:
    from rerun.experimental._viewer_client import View

PACKAGES = ("libegl1", "libgl1-mesa-dri", "libvulkan1", "mesa-vulkan-drivers")
"""Debian packages of the software renderer that the viewer needs where there is no screen."""

_TOASTS_S = 8.0
"""How long the viewer's own start-up messages cover a corner of the window."""

Picture = npt.NDArray[np.uint8]


def missing_libraries() -> str:
    """Say what a headless viewer lacks on this machine; empty where nothing is."""
    vulkan = ctypes.util.find_library("vulkan")
    drivers = [file for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d") for file in Path(folder).glob("*")]
    if vulkan and drivers and ctypes.util.find_library("EGL"):
        return ""
    return f"the headless viewer needs system libraries: apt-get install {' '.join(PACKAGES)}"


class Looker:
    """A headless viewer that shows one recording at a time."""

    def __init__(self, address: str, pid: int, patience_s: float = 60.0) -> None:
        from rerun.experimental import ViewerClient

        self.address = address
        self._client = ViewerClient(address)
        self._pid = pid
        self._patience_s = patience_s

    def open(self, source: Path | str) -> None:
        """Show a recording, an .rrd file or an address, instead of what is shown."""
        if self._client.get_state().recordings:
            self._client.close("all")
        self._client.open(str(source))
        self._wait_until_loaded()

    def _wait_until_loaded(self) -> None:
        deadline = time.monotonic() + self._patience_s
        while time.monotonic() < deadline:
            state = self._client.get_state()
            if not state.loading and state.active_recording and state.views:
                return
            time.sleep(0.1)
        raise TimeoutError(f"the viewer had not loaded the recording after {self._patience_s:g} s")

    def show(self, *, scan: int) -> None:
        """Move the time cursor to a scan."""
        self._client.set_time("scan", sequence=scan, play_state="paused")

    def show_end(self) -> None:
        """Move the time cursor to the end of the timeline `time`."""
        ends = [t.end for r in self._client.get_state().recordings for t in r.timelines if t.name == "time"]
        last = np.datetime64(max(end for end in ends if end is not None), "ns")
        self._client.set_time("time", timestamp=last, play_state="paused")

    @property
    def views(self) -> dict[str, View]:
        """All views of the layout by name; of those in several tabs, any."""
        return {view.name: view for view in self._client.get_state().views if view.visible}

    def pictures(self, but: Collection[str] = ()) -> dict[str, Picture]:
        """Give each view of the tab in front as it is now, (row, column, 3), by name; for after `picture`."""
        found = {}
        for view in self._client.get_state().views:
            if view.name in but:
                continue
            try:
                found[view.name] = pixels(self._client.take_screenshot(view.view_id))
            except ConnectionError as error:  # of another tab
                if "NotFound" not in str(error):
                    raise
        return found

    def memory(self) -> int:
        """Bytes that the viewer's process holds."""
        return int(psutil.Process(self._pid).memory_info().rss)

    def complaints(self) -> list[str]:
        """What views and viewer reported as wrong."""
        reports = [f"{v.name}: {report.summary}" for v in self._client.get_state().views for report in v.reports]
        logs = [entry.message for entry in self._client.get_logs() if entry.level == "ERROR"]
        return reports + logs

    def picture(self, view: str | None = None) -> Picture:
        """Give one view, or the whole window, as (row, column, 3), once two pictures in a row agree."""
        deadline = time.monotonic() + self._patience_s
        last = self._shot(view, deadline)
        while time.monotonic() < deadline:
            time.sleep(0.6)
            now = self._shot(view, deadline)
            if now.shape == last.shape and np.array_equal(now, last):
                return now
            last = now
        raise TimeoutError(f"the view {view or 'window'} was still changing after {self._patience_s:g} s")

    def _shot(self, view: str | None, deadline: float) -> Picture:
        while True:
            # looked up each time: while the layout is still being laid out, a view may come again under another id
            try:
                png = self._client.take_screenshot(self.views[view].view_id if view is not None else None)
            except (ConnectionError, KeyError, TimeoutError) as error:  # the last: a viewer that has much to do
                gone = not isinstance(error, ConnectionError) or "NotFound" in str(error)
                if not gone or time.monotonic() > deadline:
                    raise
                time.sleep(0.1)
                continue
            return pixels(png)


def pixels(png: bytes) -> Picture:
    """Read a picture, (row, column, 3)."""
    return np.array(Image.open(io.BytesIO(png)).convert("RGB"))


def coloured(picture: Picture) -> float:
    """Share of pixels that are neither grey nor black."""
    spread = picture.max(axis=-1).astype(int) - picture.min(axis=-1)
    return float((spread > 40).mean())


def moved(one: Picture, other: Picture) -> float:
    """Share of pixels that differ between two pictures."""
    return float((np.abs(one.astype(int) - other).max(axis=-1) > 30).mean())


@contextmanager
def looker(
    source: Path | str | None = None, size: str = "1920x1080", limits: Sequence[str] = ("--memory-limit", "75%")
) -> Iterator[Looker]:
    """Start a headless viewer on a free port, open a recording in it if one is given, and end it afterwards."""
    with tempfile.TemporaryDirectory() as runtime:
        before = os.environ.get("XDG_RUNTIME_DIR")
        os.environ["XDG_RUNTIME_DIR"] = before or runtime
        try:
            port = free_port()
            # not ViewerClient.spawn, whose viewer listens on every interface
            viewer = subprocess.Popen(
                [
                    *(viewer_program(), "--headless", "--bind", "127.0.0.1", "--port", str(port)),
                    *("--hide-welcome-screen", "--window-size", size, *limits),
                ],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                _wait_for(port, viewer)
                look = Looker(f"rerun+http://127.0.0.1:{port}/proxy", viewer.pid)
                if source is not None:
                    look.open(source)
                yield look
            finally:
                viewer.terminate()
                viewer.wait()
        finally:
            if before is None:
                del os.environ["XDG_RUNTIME_DIR"]


def _wait_for(port: int, viewer: subprocess.Popen[bytes], patience_s: float = 60.0) -> None:
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline and viewer.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError(f"the headless viewer did not start within {patience_s:g} s (exit code {viewer.poll()})")


def main() -> None:
    """Make a picture of the whole window."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="a store or an .rrd file")
    parser.add_argument("out", type=Path)
    parser.add_argument("--scan", type=int, default=None, help="scan number; the newest without it")
    parser.add_argument("--preset", default="overview", help="what is in front, of a store")
    parser.add_argument("--size", default="1920x1080", help="of the window")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rrd: Path = given.source
        if rrd.suffix != ".rrd":
            from dashboards.record import record_review
            from storage import open_store

            rrd = Path(folder) / "review.rrd"
            record_review(open_store(given.source), rrd, preset=given.preset)
        with looker(rrd, given.size) as look:
            if given.scan is None:
                look.show_end()
            else:
                look.show(scan=given.scan)
            time.sleep(_TOASTS_S)
            given.out.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(look.picture()).save(given.out, optimize=True)
            for complaint in look.complaints():
                print("viewer:", complaint)
    print(given.out)


if __name__ == "__main__":
    main()
