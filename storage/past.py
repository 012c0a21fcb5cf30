"""The past of a store: every commit is a snapshot, and each can be read as it was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from configs import InputError, StoreError
from pipelines import Instant, format_instant, instant, parse_instant

from .location import BRANCH, Location, location_of
from .repository import open_repository, short, unfinished
from .store import Store

__all__ = ["Moment", "Snapshot", "only_grown", "snapshot_at", "snapshots"]

Moment = Instant | datetime | str
"""An instant, an aware datetime, or text such as 2026-11-22T21:00:00Z."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One commit: its id, when it was written (by the writer's clock), what it was, and the scan that came with it."""

    id: str
    written: Instant
    message: str
    scan: int | None


def snapshots(path: str | Path) -> Iterator[Snapshot]:
    """Give the snapshots of a store, newest first, each read when it is asked for.

    ``open_store(path, snapshot=each.id)`` reads the store as it was then. Those that were expired are not there.

    Raises
    ------
    StoreError
        If there is no store at `path`.
    """
    repository = open_repository(location_of(path))
    return (_snapshot(info) for info in _ancestry(repository))


def only_grown(store: Store, since: str) -> bool:
    """Whether a store still holds what it held in the snapshot `since`, and what came after was appended.

    False where scans were written again in between (`Rework`), where the store went back to an older snapshot, and
    where `since` has expired. Reads the commits since then alone.
    """
    if store.about.snapshot == since:
        return True
    repository = getattr(store, "repository", None)
    if repository is None:
        return False
    for info in repository.ancestry(snapshot_id=store.about.snapshot):
        if info.id == since:
            return True
        if "process" in dict(info.metadata):
            return False
    return False


def snapshot_at(repository: Any, location: Location, snapshot: str | None, as_of: Moment | None) -> str:
    """Give the id of a past snapshot: one that exists, or the newest that was written by a time.

    Raises
    ------
    InputError
        If both are asked for, or `as_of` is no time.
    StoreError
        If there is none.
    """
    import icechunk

    if snapshot is not None and as_of is not None:
        raise InputError("snapshot and as_of exclude each other: give one")
    if snapshot is not None:
        try:
            repository.lookup_snapshot(snapshot)
        except (icechunk.IcechunkError, ValueError):
            raise StoreError(f"{location}: there is no snapshot {snapshot!r}: `storage.snapshots` lists them") from None
        return snapshot
    assert as_of is not None
    when = _instant(as_of)
    try:
        for info in _ancestry(repository):
            if instant(info.written_at) <= when:
                return str(info.id)
    except icechunk.IcechunkError as error:
        raise StoreError(f"{location}: its past cannot be read: {short(error)}") from None
    raise StoreError(f"{location}: nothing was stored by {format_instant(when)}")


def _ancestry(repository: Any) -> Iterator[Any]:
    """Give the commits, newest first, but the empty one that Icechunk begins with and the steps of a `Rework`."""
    commits = repository.ancestry(branch=BRANCH)
    return (info for info in commits if info.parent_id is not None and not unfinished(info))


def _snapshot(info: Any) -> Snapshot:
    scan = info.metadata.get("scan")
    return Snapshot(str(info.id), instant(info.written_at), str(info.message), int(scan) if scan is not None else None)


def _instant(moment: Moment) -> Instant:
    try:
        if isinstance(moment, str):
            return parse_instant(moment)
        if isinstance(moment, np.datetime64):
            whole: Instant = moment.astype("datetime64[ns]")
            return whole
        return instant(moment)
    except ValueError as error:
        raise InputError(f"as_of: {error}") from None
