"""``microrelief report``: a store as one page for people."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import StoreError
from dashboards import gather, judge_findings, write_findings
from pipelines import format_instant
from storage import cite, open_store

from ..progress import progress

__all__ = ["report"]

_IN_ALARM = 3


def report(
    store: Path,
    *,
    out: Path,
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
    json_
        Print a summary as JSON.

    Examples
    --------
    microrelief report demo/demo.icechunk --out demo/report
    """
    opened = open_store(store)
    try:
        with progress("reading scans") as step:
            findings = gather(opened, progress=step)
    finally:
        opened.close()
    page = write_findings(findings, out)
    _keep(store, opened.about.snapshot)
    verdict = judge_findings(findings)
    if json_:
        print(
            json.dumps(
                {
                    "report": str(page),
                    "verdict": verdict.tone,
                    "reasons": list(verdict.reasons),
                    "scans": findings.scans,
                    "last": format_instant(findings.times[-1]) if len(findings.times) else None,
                    "alarms": dict(findings.alarms),
                }
            )
        )
    else:
        print(f"{verdict.headline}: {' '.join(verdict.reasons)}")
        print(f"wrote {page}; open it in any browser")
    return _IN_ALARM if verdict.tone == "red" else 0


def _keep(store: Path, snapshot: str) -> None:
    """Tag the snapshot that the report names, so that `microrelief store expire` leaves it."""
    try:
        cite(store, snapshot)
    except StoreError as error:  # a store that may only be read is reported on all the same
        print(f"microrelief: {error}; `microrelief store expire` may drop it", file=sys.stderr)
