"""STORES: every kind of store there is, and how one is made and opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from configs import InputError
from pipelines import Grid, Instant, instant

from .location import location_of
from .packing import Packing, usual_packing
from .past import Moment, snapshot_at
from .store import Store

__all__ = ["STORES", "create_store", "open_store"]


def _icechunk(path: str | Path, **facts: Any) -> Store:
    from .icechunk_store import IcechunkStore

    return IcechunkStore.create(location_of(path), **facts)


def _memory(path: str | Path, **facts: Any) -> Store:
    from .memory_store import MemoryStore

    return MemoryStore(path, **facts)


STORES: dict[str, Callable[..., Store]] = {"icechunk": _icechunk, "memory": _memory}
"""How to make a store of each kind."""


def create_store(
    path: str | Path,
    *,
    site: str,
    grid: Grid,
    campaign: str = "",
    campaign_hash: str = "",
    metrics: Mapping[str, str] | None = None,
    software: str = "",
    kind: str = "icechunk",
    created: Instant | None = None,
    packing: Packing | None = None,
) -> Store:
    """Make a store and hold its writer's lock.

    Parameters
    ----------
    path : str or Path
        A folder that does not exist yet or is empty, or ``s3://bucket/prefix`` with nothing below it.
    site : str
    grid : Grid
        The grid of every scan of this store.
    campaign, campaign_hash, software : str
        Provenance: the campaign file's text, the hash of its settings, what made the store.
    metrics : mapping of str to str
        Unit of each metric by name.
    kind : str
        A name of `STORES`.
    created : Instant, optional
        Now, unless given.
    packing : Packing, optional
        How heights are packed. Unless given, in steps of 0.5 um: in int16, which reaches 16 mm, where the grid is no
        wider and no longer than that reach, else in int32, which reaches 1 km.

    Raises
    ------
    InputError
        If there is no such kind.
    StoreError
        If there is something at `path`, or it cannot be made.
    """
    if kind not in STORES:
        raise InputError(f"there is no store of kind {kind!r}: choose one of {', '.join(STORES)}")
    return STORES[kind](
        path,
        site=site,
        grid=grid,
        campaign=campaign,
        campaign_hash=campaign_hash,
        metrics=dict(metrics or {}),
        software=software,
        created=instant(datetime.now(UTC)) if created is None else created,
        packing=usual_packing(grid) if packing is None else packing,
    )


def open_store(
    path: str | Path,
    *,
    write: bool = False,
    metrics: Mapping[str, str] | None = None,
    snapshot: str | None = None,
    as_of: Moment | None = None,
) -> Store:
    """Open a store: to read (any number of readers) or to write (one, which holds the lock).

    Parameters
    ----------
    path : str or Path
        A folder, or ``s3://bucket/prefix``.
    write : bool
    metrics : mapping of str to str
        Units of metrics that a writer adds where the store does not have them yet.
    snapshot : str, optional
        Read the store as it was at this snapshot (`snapshots` lists them); only to read.
    as_of : Instant, aware datetime or str, optional
        Read the store as it was at this time: at the newest snapshot written by then.

    Raises
    ------
    InputError
        If the past is asked for to write, or in two ways.
    StoreError
        If there is no store at `path` or no such snapshot, it was made by a newer microrelief, or another writer
        holds it.
    """
    from .icechunk_store import IcechunkStore

    if snapshot is None and as_of is None:
        return IcechunkStore.open(location_of(path), write=write, metrics=dict(metrics or {}))
    if write:
        raise InputError("the past of a store can only be read: open it without write=True")
    past = partial(snapshot_at, snapshot=snapshot, as_of=as_of)
    return IcechunkStore.open(location_of(path), write=False, metrics={}, past=past)
