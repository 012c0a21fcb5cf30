"""The command `status`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pipelines import Instant, format_instant
from storage import store_exists

from ..check import load_checked
from ..clock import RealClock
from ..forecast import format_bytes
from ..standing import Standing, is_store, look, no_store

__all__ = ["status"]


def status(path: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative="")] = False) -> int:
    """Say how a campaign stands: scans, last, next, missed, alarms, disk.

    Exit code 3: in alarm, or an alarm has no data; 4: degraded, which means that of the newest slots some were missed,
    rejected or failed, or that a slot is overdue.

    Parameters
    ----------
    path
        Store (a folder or s3://bucket/prefix), or campaign file.
    as_json
        Print JSON: scans, last, next, missed, state and more; times are ISO 8601 in UTC.

    Examples
    --------
    microrelief status soil.yaml
    microrelief status soil.icechunk --json
    """
    now = RealClock().now()
    if is_store(path):
        standing = look(path, now)
    else:
        campaign = load_checked(path).campaign
        if not store_exists(campaign.store.path):
            raise no_store(campaign.store.path)
        standing = look(campaign.store.path, now, campaign)
    print(json.dumps(standing.as_mapping(), indent=1) if as_json else "\n".join(_lines(standing)))
    return standing.exit_code


def _lines(standing: Standing) -> list[str]:
    def told(moment: Instant | None) -> str:
        return format_instant(moment) if moment is not None else "-"

    unhappy = [f"{getattr(standing, name)} {name}" for name in ("missed", "rejected", "failed")]
    lines = [
        f"{standing.site}: {standing.state}" + (f" ({standing.why})" if standing.why else ""),
        f"  scans    {standing.scans}, {', '.join(unhappy)}",
        f"  last     {told(standing.last)}",
        f"  next     {told(standing.next)}" + ("" if standing.running else " (not running)"),
    ]
    if standing.prompt is not None:
        lines.append(f"  slots    {standing.prompt.told}")
    for name, state in standing.alarms.items():
        lines.append(f"  alarm    {name}: {state}")
        lines += [f"           {part}" for part in standing.alarm_words.get(name, "").split("; ") if part]
    if standing.store.startswith("s3://"):
        return lines
    disk = f"  disk     {format_bytes(standing.disk_bytes)}, {format_bytes(standing.free_bytes)} free"
    return [*lines, disk + (f", full on {told(standing.disk_full)[:10]}" if standing.disk_full is not None else "")]
