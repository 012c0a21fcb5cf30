"""``microrelief annotate``: a person's remark, kept in the store beside what the machine saw."""

from __future__ import annotations

import getpass
from contextlib import closing
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

from cyclopts import Parameter

from configs import InputError
from dashboards import Region, site_zone
from pipelines import Event, Instant, format_instant, parse_instant
from storage import Store, open_store

from ..clock import RealClock
from ..hand_in import addressed, hand_in
from .export import nearest_scan

__all__ = ["annotate"]


def annotate(
    path: Path,
    text: str,
    *,
    scan: Annotated[str | None, Parameter(negative="")] = None,
    time: Annotated[str | None, Parameter(negative="")] = None,
    region: Annotated[str | None, Parameter(negative="")] = None,
    by: Annotated[str | None, Parameter(negative="")] = None,
) -> int:
    """Keep a remark in a store: what somebody saw or did, at a scan or a time, at a place of the surface.

    `review` shows it in its log and `report` among the events. While `microrelief run` writes the store, it takes the
    remark in with its next visit; `review` and `report` show it at once.

    Parameters
    ----------
    path
        Store (a folder or s3://bucket/prefix), or campaign file.
    text
        The remark, one line.
    scan
        The scan that it is about: its number (-1 is the newest), or a time: the scan nearest to it. Without --scan and
        --time the newest.
    time
        A time between scans, such as 2026-11-22T14:30 in the site's zone.
    region
        Part of the surface in mm: two corners x0,y0,x1,y1, or a polygon x0,y0,x1,y1,x2,y2,...
    by
        Who; without it the name of this computer's user.

    Examples
    --------
    microrelief annotate soil.icechunk "watered, 200 ml" --time 2026-11-22T14:30 --by Ann
    microrelief annotate soil.icechunk "root breaks through" --scan -1 --region 1,1,2,2
    """
    words = " ".join(text.split())
    if not words:
        raise InputError("TEXT is empty: say what there is to remark")
    if scan is not None and time is not None:
        raise InputError("--scan and --time exclude each other: choose one")
    store, inbox = addressed(path)
    part = Region.parse(region) if region is not None else None
    with closing(open_store(store)) as opened:
        if part is not None and opened.about.grid is not None:
            part.cells(opened.about.grid)  # refuses one that lies beside the map
        moment, at = _moment(opened, scan, time)
    who = by if by is not None else getpass.getuser()
    about = [who, at, f"region {part}" if part is not None else ""]
    event = Event(moment, "annotation", f"{words} ({', '.join(each for each in about if each)})")
    print(f"kept, {format_instant(moment)}: {event.text}{hand_in(store, event, inbox)}")
    return 0


def _moment(store: Store, scan: str | None, time: str | None) -> tuple[Instant, str]:
    """Give when a remark is about, and the words for its scan."""
    if time is not None:
        try:
            moment = parse_instant(time, ZoneInfo(site_zone(store.about.campaign)))
        except ValueError as error:
            raise InputError(f"--time {time}: {error}") from None
        now = RealClock().now()
        latest = max(now, store[-1].scan.time) if len(store) else now  # a simulated rig's clock may be ahead
        if moment > latest:  # a wrong year would stretch every timeline for good
            raise InputError(f"--time {time}: is still to come: a remark is about what was seen or done")
        return moment, ""
    if not len(store):
        if scan is not None:
            raise InputError(f"--scan {scan}: {store.about.location} holds no scan yet")
        return RealClock().now(), ""
    number = nearest_scan(store, scan or "-1", f"--scan {scan}")
    return store[number].scan.time, f"scan {number}"
