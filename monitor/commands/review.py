"""``microrelief review``: a store on the Rerun timeline."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Annotated

from cyclopts import Parameter

from configs import InputError, MicroreliefError
from dashboards import NO_SCREEN, check_ports, has_screen, open_command, open_viewer, record_review, serve_web
from storage import Store, open_store

from ..progress import progress

__all__ = ["review"]


def review(
    store: Path,
    *,
    web: Annotated[bool, Parameter(negative="")] = False,
    save: Path | None = None,
    port: int | None = None,
) -> int:
    """Look at every scan of a store on a timeline: surface, maps, trends, alarms, log.

    Opens the Rerun viewer. The store is only read, so this may be done while a campaign runs.

    Parameters
    ----------
    store
        The store's folder.
    web
        Serve the review to a browser on this machine (127.0.0.1 alone) and print the link.
    save
        Write the review to this .rrd file instead of showing it.
    port
        Port of the web page, 9090 if none is given, or of the viewer.

    Examples
    --------
    microrelief review demo/demo.icechunk --web
    """
    if web and save is not None:
        raise InputError("--web and --save exclude each other: choose one")
    if not web and save is None and not has_screen():
        raise MicroreliefError(NO_SCREEN)
    opened = open_store(store)
    try:
        if save is not None:
            _record(opened, save)
            size = save.stat().st_size / 1e6
            print(f"wrote {save} ({size:.1f} MB, {len(opened)} scans); open it with: {open_command(save)}")
            return 0
        with tempfile.TemporaryDirectory(prefix="microrelief-") as folder:
            rrd = Path(folder) / "review.rrd"
            if not web:
                _record(opened, rrd)
                open_viewer(rrd, port)
                return 0
            page = 9090 if port is None else port
            check_ports(page)  # before the work of recording
            _record(opened, rrd)
            with serve_web(rrd, page) as (link, server):
                print(f"review at {link} (Ctrl-C ends it)", flush=True)
                return _wait(server)
    finally:
        opened.close()


def _record(store: Store, file: Path) -> None:
    with progress("recording scans") as step:
        record_review(store, file, progress=step)


def _wait(server: subprocess.Popen[str]) -> int:
    """Wait for Ctrl-C or a stop by the system; both end the server with us."""
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        code = server.wait()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 0
    finally:
        signal.signal(signal.SIGTERM, before)
    raise MicroreliefError(f"the review server ended by itself with code {code}: start it again")


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
