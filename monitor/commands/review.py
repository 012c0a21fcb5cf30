"""``microrelief review``: a store on the Rerun timeline."""

from __future__ import annotations

import re
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from configs import InputError, MicroreliefError
from dashboards import (
    NO_SCREEN,
    Preset,
    behind_proxy,
    check_not_empty,
    check_ports,
    has_screen,
    open_command,
    open_viewer,
    read_tracks,
    record_review,
    serve_web,
)
from storage import Store, open_store

from ..live_review import Follower
from ..outputs import check_recording
from ..progress import progress
from ..reviewing import served_review

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["review"]


def review(
    store: str,
    *,
    preset: Preset = "overview",
    follow: Annotated[bool, Parameter(negative="")] = False,
    scans: str | None = None,
    tracks: Annotated[Path | None, Parameter(name="--paths", negative="")] = None,
    web: Annotated[bool, Parameter(negative="")] = False,
    save: Path | None = None,
    port: int | None = None,
    origin: str = "",
    data_origin: str = "",
) -> int:
    """Look at every scan of a store on a timeline: surface, maps, trends, alarms, log.

    Opens the Rerun viewer. The store is only read, so this may be done while a campaign runs. What was drawn is kept in
    a folder NAME.review beside the store, a file for each day, and only what is new is drawn the next time; the folder
    may be deleted.

    Parameters
    ----------
    store
        The store: a folder or s3://bucket/prefix.
    preset
        What is in front; the others are tabs of the same window.
    follow
        Go along with a campaign or video that is running: the last hour first, then each scan as it comes.
    scans
        Only these scans, at full resolution: FIRST:LAST, both included; negative numbers count from the newest.
    tracks
        Table of what moves on the surface, as `microrelief track` wrote it: paths and numbers in the preset video.
    web
        Serve the review to a browser on this machine (127.0.0.1 alone) and print the link.
    save
        Write the review to this .rrd file instead of showing it.
    port
        Port of the web page, 9090 if none is given, or of the viewer.
    origin
        With --web behind a reverse proxy: the address that the page has there, such as https://review.example.org.
    data_origin
        Likewise that of the data, such as https://review-data.example.org: the link from elsewhere is printed too.

    Examples
    --------
    microrelief review demo/demo.icechunk --web
    microrelief review site.icechunk --preset cracks --scans -10:-1
    microrelief review video.icechunk --preset video --paths paths.csv
    """
    if web and save is not None:
        raise InputError("--web and --save exclude each other: choose one")
    alone = {"--save": save, "--scans": scans, "--paths": tracks}
    if follow and (other := next((name for name, given in alone.items() if given is not None), "")):
        raise InputError(f"--follow and {other} exclude each other: choose one")
    origin, data_origin = origin.rstrip("/"), data_origin.rstrip("/")
    behind = _proxied(origin, data_origin, web=web and not follow and scans is None)
    if save is not None:
        check_recording(save)
    if not web and save is None and not has_screen():
        raise MicroreliefError(NO_SCREEN)
    chosen = None if scans is None else _range(scans)
    page = 9090 if port is None else port
    if web:
        check_ports(page)  # before the work of drawing
    opened = open_store(store)
    try:
        moving = None if tracks is None else read_tracks(tracks, opened)
        with _ended_by_sigterm():
            if save is not None:
                _record(opened, save, preset, chosen, moving)
                size = save.stat().st_size / 1e6
                told = f"{len(opened)} scans" if chosen is None else f"scans {scans}"
                print(f"wrote {save} ({size:.1f} MB, {told}); open it with: {open_command(save)}")
            elif follow:
                _follow(opened, store, preset, page if web else port, web=web)
            else:
                with _source(opened, preset, chosen, moving, page + 1 if web else None, origin) as source:
                    _show(source, page if web else port, behind, web=web)
    except KeyboardInterrupt as told:
        if not isinstance(told, _Terminated):
            print("stopped", file=sys.stderr)
    finally:
        opened.close()
    return 0


@contextmanager
def _source(
    opened: Store,
    preset: Preset,
    chosen: tuple[int, int] | None,
    tracks: pd.DataFrame | None,
    port: int | None,
    origin: str,
) -> Iterator[str | Path]:
    """Give what a viewer opens: the shards of the whole store, or a file of the chosen scans."""
    if chosen is not None:
        with tempfile.TemporaryDirectory(prefix="microrelief-") as folder:
            rrd = Path(folder) / "review.rrd"
            _record(opened, rrd, preset, chosen, tracks)
            yield rrd
        return
    with (
        progress("recording scans") as step,
        served_review(opened, preset, port, step, origin=origin, tracks=tracks) as address,
    ):
        yield address


def _record(
    store: Store, file: Path, preset: Preset, chosen: tuple[int, int] | None, tracks: pd.DataFrame | None
) -> None:
    with progress("recording scans") as step:
        record_review(store, file, preset=preset, scans=chosen, tracks=tracks, progress=step)


def _show(source: str | Path, port: int | None, behind: tuple[str, str] | None, *, web: bool) -> None:
    if not web:
        open_viewer(source, port)
        return
    assert port is not None
    with serve_web(source, port) as (link, server):
        print(f"review at {link} (Ctrl-C ends it)", flush=True)
        if behind is not None:
            print(f"from elsewhere at {behind_proxy(link, *behind)}", flush=True)
        code = server.wait()
    raise MicroreliefError(f"the review server ended by itself with code {code}: start it again")


def _proxied(page: str, data: str, *, web: bool) -> tuple[str, str] | None:
    """Read where a reverse proxy shows page and data; None where the link is not asked for."""
    for option, given in (("--origin", page), ("--data-origin", data)):
        if given and not web:
            raise InputError(f"{option} is for --web, without --follow and --scans")
        if given and not re.fullmatch(r"https?://[^/\s]+", given):
            raise InputError(f"{option} {given}: give an address without a path, such as https://review.example.org")
    if data and not page:
        raise InputError("--data-origin needs --origin, the address of the page, which may then read the data")
    return (page, data) if data else None


def _follow(opened: Store, path: str, preset: Preset, port: int | None, *, web: bool) -> None:
    check_not_empty(opened)
    follower = Follower(opened, path, preset)
    if not web:
        open_viewer("", port, along=follower.at)
        return
    assert port is not None
    with serve_web("", port) as (link, server):
        print(f"review at {link} (Ctrl-C ends it)", flush=True)
        with follower.at(f"rerun+http://127.0.0.1:{port + 1}/proxy"):
            code = server.wait()
    raise MicroreliefError(f"the review server ended by itself with code {code}: start it again")


def _range(text: str) -> tuple[int, int]:
    first, _, last = text.partition(":")
    try:
        return int(first), int(last or first)
    except ValueError:
        raise InputError(f"--scans {text}: give two numbers, FIRST:LAST, such as 12:20 or -10:-1") from None


class _Terminated(KeyboardInterrupt):
    """A stop by the system, or by the recording that we went along with."""


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Let a stop by the system do what Ctrl-C does: the viewer and its file must not outlive us."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
