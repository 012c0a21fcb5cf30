"""The command `store`: care of a store."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from configs import InputError, parse_duration
from pipelines import format_instant
from storage import Statistics, collect, compact, copy_store, expire, statistics

from ..clock import RealClock
from ..forecast import format_bytes
from ..progress import progress

__all__ = ["store"]

Action = Literal["stat", "gc", "expire", "compact", "copy"]
AGES = {"gc": timedelta(days=1), "expire": timedelta(days=30), "compact": timedelta(hours=1)}


def store(
    action: Action,
    path: str,
    target: str | None = None,
    *,
    older_than: str | None = None,
    history: bool = False,
    dry_run: bool = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Take care of a store.

    stat: scans, bytes by group and kind, bytes per scan and day, the day the disk is full.

    gc: remove files that no snapshot needs: an interrupted commit leaves some, and `expire`. A campaign may be running.

    expire: drop old snapshots from the history, each of which holds the store as it was after one commit. The newest
    three stay, and those that a report cites. The space is given back by `gc`.

    compact: drop all history but these, and remove what it leaves.

    copy: write what the newest snapshot holds to another folder or to S3, or all history to a folder. A campaign may be
    running. A store of an older layout gets the present one.

    Parameters
    ----------
    action
        What to do.
    path
        The store's folder or address.
    target
        Where the copy goes, a folder or an address; only for `copy`.
    older_than
        Age from which on files (gc: 1 d, compact: 1 h) or snapshots (expire: 30 d) go.
    history
        Copy every snapshot.
    dry_run
        Only say what gc would remove.
    as_json
        Print JSON (stat).

    Examples
    --------
    microrelief store stat soil.icechunk
    microrelief store expire soil.icechunk --older-than "90 d" && microrelief store gc soil.icechunk
    microrelief store copy soil.icechunk /backup/soil.icechunk
    """
    _check(action, target, older_than, history=history, dry_run=dry_run, as_json=as_json)
    if action == "copy":
        assert target is not None
        with progress("copying") as show:
            count = copy_store(path, target, history=history, progress=show)
        print(f"{target}: {count} scans copied; `microrelief verify {target}` reads them all")
    elif action == "stat":
        told = statistics(path, RealClock().now())
        print(json.dumps(_mapping(told), indent=1) if as_json else "\n".join(_lines(path, told)))
    else:
        age = AGES[action] if older_than is None else _age(older_than)
        print(f"{path}: {_thin_out(action, path, age, dry_run=dry_run)}")
    return 0


def _check(action: str, target: str | None, older_than: str | None, **flags: bool) -> None:
    if (action == "copy") != (target is not None):
        raise InputError(
            "name where the copy goes: microrelief store copy STORE TARGET"
            if target is None
            else f"{action} takes one store, not {target} too"
        )
    fitting = {"history": ("copy",), "dry_run": ("gc",), "as_json": ("stat",)}
    for name, given in flags.items():
        if given and action not in fitting[name]:
            option = "json" if name == "as_json" else name.replace("_", "-")
            raise InputError(f"--{option} goes with {fitting[name][0]}, not with {action}")
    if older_than is not None and action not in AGES:
        raise InputError(f"--older-than goes with {', '.join(AGES)}, not with {action}")


def _age(text: str) -> timedelta:
    try:
        return parse_duration(text)
    except ValueError as error:
        raise InputError(f"--older-than: {error}") from None


def _thin_out(action: str, path: str, age: timedelta, *, dry_run: bool) -> str:
    before = datetime.now(UTC) - age
    if action == "expire":
        count = expire(path, before)
        return f"{count} snapshots dropped; `microrelief store gc` gives their space back"
    gone = compact(path, age) if action == "compact" else collect(path, before, dry_run=dry_run)
    return f"{gone.files} files, {format_bytes(gone.bytes)}, {'would be ' if dry_run else ''}removed"


def _mapping(told: Statistics) -> dict[str, object]:
    return {
        name: format_instant(value) if isinstance(value, np.datetime64) else value
        for name, value in asdict(told).items()
    }


def _lines(path: str, told: Statistics) -> list[str]:
    groups = ", ".join(f"{name} {format_bytes(size)}" for name, size in told.by_group.items())
    kinds = ", ".join(f"{name} {format_bytes(size)}" for name, size in told.kinds.items())
    newest = sum(told.by_group.values())
    lines = [
        f"{path}: {told.scans} scans, {told.snapshots} snapshots, {told.tags} cited",
        f"  files      {format_bytes(told.bytes)}: {kinds}",
        f"  newest     {format_bytes(newest)}: {groups}",
    ]
    if told.bytes_per_scan is not None:
        day = f", {format_bytes(told.bytes_per_day)} a day" if told.bytes_per_day is not None else ""
        lines.append(f"  growth     {format_bytes(told.bytes_per_scan)} a scan{day}")
    full = f", full on {format_instant(told.disk_full)[:10]}" if told.disk_full is not None else ""
    return lines if told.free is None else [*lines, f"  disk       {format_bytes(told.free)} free{full}"]
