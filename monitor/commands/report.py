"""``microrelief report``: a store as one page for people."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import numpy as np
from cyclopts import Parameter

from configs import InputError, StoreError
from dashboards import (
    Findings,
    Layout,
    Period,
    Region,
    fill_templates,
    gather,
    gather_comparison,
    judge_findings,
    site_zone,
    write_comparison,
    write_findings,
)
from pipelines import Instant, format_instant, parse_instant
from storage import Store, cite, open_store

from ..outputs import check_folder
from ..progress import progress
from .export import nearest_scan

__all__ = ["period_of", "report"]

_IN_ALARM = 3


def report(
    store: Path,
    *,
    out: Path,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    to: str | None = None,
    region: str | None = None,
    compare: Annotated[tuple[str, str] | None, Parameter(negative="")] = None,
    pdf: Annotated[bool, Parameter(negative="")] = False,
    templates: Path | None = None,
    json_: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Write the report of a store: verdict, trends, maps and tables in one HTML file, and the series beside it.

    The page needs no network and no other file. The exit code is 3 where the verdict is red.

    Parameters
    ----------
    store
        The store: a folder or s3://bucket/prefix.
    out
        Folder for report.html, series.csv and series.parquet.
    from_
        Begin with this scan: its number, or a time or day such as 2026-11-22. Without it the first there is.
    to
        End with this scan, likewise; a day counts whole. Without it the newest.
    region
        Part of the surface in mm: two corners x0,y0,x1,y1, or a polygon x0,y0,x1,y1,x2,y2,... Metrics are measured
        anew inside it.
    compare
        Two scans, by number or time, to report on what changed between them.
    pdf
        Write report.pdf too: PDF/A-3b and PDF/UA-1, with the series inside (pip install 'microrelief[pdf]').
    templates
        Folder of your own templates; one that is empty or not there is filled with ours to start from.
    json_
        Print a summary as JSON.

    Examples
    --------
    microrelief report demo/demo.icechunk --out demo/report
    microrelief report site.icechunk --out may --from 2026-05-01 --to 2026-05-31 --pdf
    microrelief report site.icechunk --out change --compare 0 -1
    """
    if compare is not None and (from_ is not None or to is not None):
        raise InputError("--compare and --from or --to exclude each other: it names both scans")
    check_folder(out)
    part = Region.parse(region) if region is not None else None
    if templates is not None and fill_templates(templates):
        print(f"{templates}: filled with our templates; change them and write the report again", file=sys.stderr)
    opened = open_store(store)
    try:
        if compare is not None:
            before, after = (nearest_scan(opened, text, f"--compare {text}") for text in _two(opened, compare))
            findings = gather_comparison(opened, before, after, part)
        else:
            period = period_of(opened, from_, to)
            with progress("reading scans") as step:
                findings = gather(opened, period=period, region=part, progress=step)
    finally:
        opened.close()
    layout = Layout(pdf, templates)
    page = (write_comparison if compare is not None else write_findings)(findings, out, layout)
    _keep(store, opened.about.snapshot)
    return _say(findings, page, as_json=json_, compared=compare is not None, pdf=pdf)


def _say(findings: Findings, page: Path, *, as_json: bool, compared: bool, pdf: bool) -> int:
    verdict = judge_findings(findings)
    if as_json:
        told = {
            "report": str(page),
            "scans": findings.scans,
            "last": format_instant(findings.times[-1]) if len(findings.times) else None,
        }
        if not compared:
            told |= {"verdict": verdict.tone, "reasons": list(verdict.reasons), "alarms": dict(findings.alarms)}
        print(json.dumps(told))
    else:
        if not compared:
            print(f"{verdict.headline}: {' '.join(verdict.reasons)}")
        print(f"wrote {page}; open it in any browser")
        if pdf:
            print(f"wrote {page.with_suffix('.pdf')}, to print and to keep")
    return _IN_ALARM if verdict.tone == "red" and not compared else 0


def _two(store: Store, compare: tuple[str, str]) -> tuple[str, str]:
    if not len(store):
        raise InputError(f"{store.about.location}: holds no scan yet, so there is nothing to compare")
    return compare


def period_of(store: Store, first: str | None, last: str | None) -> Period:
    """Read --from and --to: a scan's number, a time, or a day (whole); without zone, in the site's."""
    return Period(_end(store, first, "--from"), _end(store, last, "--to"))


def _end(store: Store, text: str | None, option: str) -> Instant | None:
    if text is None:
        return None
    if text.removeprefix("-").isdecimal():
        return store[nearest_scan(store, text, f"{option} {text}")].scan.time
    try:
        moment = parse_instant(text, ZoneInfo(site_zone(store.about.campaign)))
    except ValueError as error:
        raise InputError(f"{option}: {error}, or a day like 2026-11-22, or a scan's number") from None
    whole_day = option == "--to" and len(text.strip()) == len("2026-11-22")
    return moment + np.timedelta64(1, "D") - np.timedelta64(1, "ns") if whole_day else moment


def _keep(store: Path, snapshot: str) -> None:
    """Tag the snapshot that the report names, so that `microrelief store expire` leaves it."""
    try:
        cite(store, snapshot)
    except StoreError as error:  # a store that may only be read is reported on all the same
        print(f"microrelief: {error}; `microrelief store expire` may drop it", file=sys.stderr)
