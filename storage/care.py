"""Care of a store: old snapshots dropped, files that nobody needs collected, cited snapshots kept, its size told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import Any

from configs import StoreError
from pipelines import Instant

from .icechunk_store import IcechunkStore
from .location import BRANCH, Location, location_of
from .repository import open_repository, root_of, short, unfinished
from .room import full_at
from .stores import open_store

__all__ = ["SAFE_AGE", "Collected", "Statistics", "cite", "collect", "compact", "expire", "statistics"]

SAFE_AGE = timedelta(hours=1)
"""A younger file may belong to a commit under way, or to a snapshot that somebody still reads."""

KEPT = 3
"""So many of the newest snapshots never expire: what a store goes back to if the newest is damaged."""

CITED = "cited-"
_DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Collected:
    """How many files were removed, and their bytes."""

    files: int
    bytes: int


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a store takes.

    Parameters
    ----------
    scans, snapshots, tags : int
    bytes : int
        In all its files.
    by_group : mapping of str to int
        Bytes of the newest snapshot's chunks by group.
    kinds : mapping of str to int
        Bytes of files by kind: chunks, manifests, snapshots, transactions.
    bytes_per_scan, bytes_per_day : float or None
        None where there are too few scans.
    free : int or None
        Bytes free on its disk; None on S3.
    disk_full : Instant or None
        When the disk will be full at this pace.
    """

    scans: int
    snapshots: int
    tags: int
    bytes: int
    by_group: dict[str, int] = field(default_factory=dict)
    kinds: dict[str, int] = field(default_factory=dict)
    bytes_per_scan: float | None = None
    bytes_per_day: float | None = None
    free: int | None = None
    disk_full: Instant | None = None


def expire(path: str | Path, older_than: datetime) -> int:
    """Drop snapshots older than a time from the history; what only they need is left to `collect`.

    The newest `KEPT` snapshots stay, and those that a report cites, for these are tagged. No writer may be at work.

    Returns
    -------
    int
        How many were dropped.

    Raises
    ------
    StoreError
        If a writer holds the store, there is none, or its history cannot be followed.
    """
    location = location_of(path)
    with _held(location) as repository:
        newest = list(islice((each for each in repository.ancestry(branch=BRANCH) if not unfinished(each)), KEPT))
        dropped: set[str] = repository.expire_snapshots(min(older_than, newest[-1].written_at))
        location.sync()
    return len(dropped)


def collect(path: str | Path, older_than: datetime, *, dry_run: bool = False) -> Collected:
    """Remove the files that no snapshot of the history or of a tag needs, and that are older than a time.

    A writer may be at work: what its commit has written and not yet published is younger than `SAFE_AGE`.

    Raises
    ------
    StoreError
        If files younger than `SAFE_AGE` are asked for while a writer is at work; if the history cannot be followed.
    """
    import icechunk

    location = location_of(path)
    repository = open_repository(location)
    holder = location.writer()
    if holder is not None and older_than > datetime.now(UTC) - SAFE_AGE and not dry_run:
        raise StoreError(
            f"{location}: a writer is at work ({holder}): files younger than an hour may be its own; stop it first, or "
            "give a greater age"
        )
    try:
        summary = repository.garbage_collect(older_than, dry_run=dry_run)
    except icechunk.IcechunkError as error:
        raise StoreError(f"{location}: files cannot be collected: {short(error)}; try `microrelief verify`") from None
    kinds = ("chunks", "manifests", "snapshots", "attributes", "transaction_logs")
    return Collected(sum(getattr(summary, f"{kind}_deleted") for kind in kinds), summary.bytes_deleted)


def compact(path: str | Path, age: timedelta = SAFE_AGE) -> Collected:
    """Drop all history but the newest and the cited snapshots, then collect: `expire` and `collect` in one.

    Nothing else makes a store smaller: its arrays are chunked for reading, coarse histories are folded as they grow,
    and manifests are split as they are meant to be: writing them anew made a store of ten small scans larger by
    half.

    Parameters
    ----------
    path : str or Path
    age : timedelta
        Leave files younger than this to those who still read them.
    """
    now = datetime.now(UTC)
    expire(path, now)
    return collect(path, now - age)


def cite(path: str | Path, snapshot: str) -> str:
    """Tag a snapshot that a report cites, so that it survives `expire`; return the tag's name.

    The same snapshot is tagged once.

    Raises
    ------
    StoreError
        If the store cannot be written, or holds no such snapshot.
    """
    import icechunk

    location, name = location_of(path), f"{CITED}{snapshot}"
    repository = open_repository(location)
    try:
        if name not in repository.list_tags():
            repository.create_tag(name, snapshot)
            location.sync()
    except (icechunk.IcechunkError, OSError) as error:
        raise StoreError(f"{location}: snapshot {snapshot} cannot be tagged: {short(error)}") from None
    return name


def statistics(path: str | Path, now: Instant) -> Statistics:
    """Say what a store takes, and how fast it grows.

    Raises
    ------
    StoreError
        If there is no store.
    """
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    repository, sizes = store.repository, dict(store.location.sizes())
    count, used, free = len(store), sum(sizes.values()), store.location.free()
    per_day = full = None
    if count > 1:
        first, last = store[0].scan.time, store[-1].scan.time
        span = float((last - first).astype("timedelta64[ns]").astype(int)) * 1e-9 * count / (count - 1)
        per_day = used / span * _DAY_S
        full = full_at(now, free, used, first, last, count) if free is not None else None
    return Statistics(
        scans=count,
        snapshots=sum(1 for _ in repository.ancestry(branch=BRANCH)),
        tags=len(repository.list_tags()),
        bytes=used,
        by_group=_by_group(root_of(store.session)),
        kinds={
            kind: sum(size for name, size in sizes.items() if name.startswith(f"{kind}/"))
            for kind in ("chunks", "manifests", "snapshots", "transactions")
        },
        bytes_per_scan=used / count if count else None,
        bytes_per_day=per_day,
        free=free,
        disk_full=full,
    )


def _by_group(root: Any) -> dict[str, int]:
    return {
        name: sum(int(array.nbytes_stored()) for _, array in group.members(max_depth=None) if hasattr(array, "chunks"))
        for name, group in sorted(root.groups())
    }


@contextmanager
def _held(location: Location) -> Iterator[Any]:
    """Open a repository whose history is changed: with the writer's lock, and one line for what goes wrong."""
    import icechunk

    repository = open_repository(location)
    lock = location.lock()
    try:
        yield repository
    except icechunk.IcechunkError as error:
        raise StoreError(
            f"{location}: its history cannot be followed: {short(error)}; try `microrelief verify`"
        ) from None
    finally:
        lock.release()
