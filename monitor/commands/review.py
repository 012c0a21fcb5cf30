"""``microrelief review``: a store on the Rerun timeline."""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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
        The store: a folder or s3://bucket/prefix.
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
        else:
            with _ended_by_sigterm(), tempfile.TemporaryDirectory(prefix="microrelief-") as folder:
                rrd = Path(folder) / "review.rrd"
                if web:
                    _show_in_browser(opened, rrd, 9090 if port is None else port)
                else:
                    _record(opened, rrd)
                    open_viewer(rrd, port)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
    finally:
        opened.close()
    return 0


def _record(store: Store, file: Path) -> None:
    with progress("recording scans") as step:
        record_review(store, file, progress=step)


def _show_in_browser(store: Store, rrd: Path, port: int) -> None:
    check_ports(port)  # before the work of recording
    _record(store, rrd)
    with serve_web(rrd, port) as (link, server):
        print(f"review at {link} (Ctrl-C ends it)", flush=True)
        code = server.wait()
    raise MicroreliefError(f"the review server ended by itself with code {code}: start it again")


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Let a stop by the system do what Ctrl-C does: the viewer and its file must not outlive us."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
