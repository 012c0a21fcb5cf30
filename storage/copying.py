"""Copies a store: its newest snapshot laid out anew in the present schema, or all of it with its history."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from configs import StoreError

from .folder import Folder
from .icechunk_store import IcechunkStore
from .layout import (
    FRAMES,
    NOISE,
    grid_of,
    lay_out,
    metrics_of,
    root_attributes,
    split_sizes,
)
from .ledger import Ledger, ledger_beside
from .location import BRANCH, Location, location_of
from .packing import Packing
from .raw_frames import LET_GO, lay_out_frames
from .repository import create_repository, open_repository, reason, root_of, short
from .stores import open_store
from .wholeness import faults

__all__ = ["copy_store"]

BLOCK_BYTES = 64e6
MAKING = "copying"
Progress = Callable[[int, int], None]


def copy_store(
    source: str | Path, target: str | Path, *, history: bool = False, progress: Progress = lambda done, total: None
) -> int:
    """Copy a store to a new place, while a writer may go on with it; return how many scans the copy holds.

    Without `history`: what the newest snapshot holds, read (checksums are checked) and written anew; this also brings
    a store of an older schema to the present one. With it: every snapshot and tag, file by file, as they are. The
    rows of the ledger go along. The copy appears whole and durable, or not at all.

    Parameters
    ----------
    source, target : str or Path
        Folders, or ``s3://bucket/prefix``; of `target` with history a folder. `target` must not exist, or be empty.
    history : bool
    progress : callable
        Called with (arrays or files done, in all).

    Raises
    ------
    StoreError
        If there is no store, it is damaged, or `target` cannot be made or has not room for it.
    """
    reader, place = open_store(source), location_of(target)
    assert isinstance(reader, IcechunkStore)
    if history and not isinstance(place, Folder):
        raise StoreError(f"{place}: a copy with its history goes to a folder: give one, or copy without it")

    def fill(making: Location) -> None:
        if isinstance(making, Folder) and history:
            _copy_files(reader.location, making.path, progress)
        else:
            _copy_newest(reader, making, progress)
        making.sync()

    try:
        place.make(fill).release()
    except StoreError:
        raise
    except faults() as error:
        raise StoreError(f"{target}: not copied: {reason(error)}") from None
    place.sync()
    copied = open_store(target)
    if not history and len(copied) != len(reader):
        raise StoreError(f"{target}: holds {len(copied)} scans of {len(reader)}: remove it and copy again")
    _copy_ledger(source, target, len(copied))
    return len(copied)


def _copy_files(source: Location, target: Path, progress: Progress) -> None:
    """Copy objects, which never change, after the references, which do, were read: these then name what is there."""
    references = {name: source.read(name) for name, _ in source.sizes() if name.endswith("ref.json")}
    kinds = ("chunks/", "manifests/", "snapshots/", "transactions/", "config.yaml")
    names = [name for name, _ in source.sizes() if name.startswith(kinds)]
    for done, name in enumerate(names):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(source.read(name))
        progress(done + 1, len(names))
    for name, content in references.items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(content)
    open_repository(Folder(target)).lookup_branch(BRANCH)


def _copy_newest(reader: IcechunkStore, target: Location, progress: Progress) -> None:
    """Write on a branch, which becomes the store at the end: what was left half done is no store."""
    old, about = root_of(reader.session), reader.about
    grid = grid_of(old.attrs)
    repository = create_repository(target, split_sizes(grid))
    empty = repository.lookup_branch(BRANCH)
    if MAKING in repository.list_branches():
        repository.delete_branch(MAKING)
    repository.create_branch(MAKING, empty)
    session = repository.writable_session(MAKING)
    created = str(old.attrs["created"])
    import zarr

    attributes = root_attributes(about.site, grid, about.campaign, about.campaign_hash, about.software, created)
    if about.noise is not None:
        attributes[NOISE] = about.noise.to_json()
    new = zarr.create_group(session.store, attributes=attributes)
    lay_out(new, grid, Packing.of(old["scans/height"]), metrics_of(old["metrics"]))
    for kind, group in old["raw"].groups() if "raw" in old else ():
        name = next(name for name in FRAMES if name in group)
        frames, raw = group[name], new.require_group("raw")
        made = lay_out_frames(raw, kind, name, frames.shape[1:], frames.dtype, dict(group.attrs["patterns"]))
        made.attrs[LET_GO] = int(group.attrs.get(LET_GO, 0))
    session.commit(f"laid out as a copy of {about.location} at {about.snapshot}")
    names = sorted(name for name, each in old.members(max_depth=None) if hasattr(each, "chunks"))
    for done, name in enumerate(names):
        if not name.endswith(("/x", "/y")):
            _copy_rows(repository, old[name], name, about.location)
        progress(done + 1, len(names))
    tip = repository.lookup_branch(MAKING)
    target.advance(repository, empty, tip)
    repository.delete_branch(MAKING)
    # the half-filled ones on the way are nobody's history
    repository.expire_snapshots(repository.lookup_snapshot(tip).written_at)
    repository.garbage_collect(datetime.now(UTC))


def _copy_rows(repository: Any, old: Any, name: str, about: str) -> None:
    """Copy an array's rows as they are packed, a commit for so many as are held at once."""
    row = max(int(np.prod(old.shape[1:])) * max(old.dtype.itemsize, 1), 1)
    chunk = int(old.chunks[0])
    step = max(int(BLOCK_BYTES // row) // chunk, 1) * chunk
    for first in range(0, old.shape[0], step):
        last = min(first + step, old.shape[0])
        try:
            values = old[first:last]
        except faults() as error:
            what = f"{name}, rows {first} to {last - 1}, cannot be read: {short(error)}"
            raise StoreError(f"{about}: {what}; `microrelief verify` says more") from None
        session = repository.writable_session(MAKING)
        new: Any = root_of(session, "r+")[name]
        if new.shape[0] < last:
            new.resize((last, *new.shape[1:]))
        new[first:last] = values
        if session.has_uncommitted_changes:
            session.commit(f"{name}, rows {first} to {last - 1}")


def _copy_ledger(source: str | Path, target: str | Path, scans: int) -> None:
    """Copy how slots ended, up to the copy's newest scan."""
    if not ledger_beside(source).exists():
        return
    rows = Ledger(ledger_beside(source), write=False)
    copy = Ledger(ledger_beside(target))
    try:
        for row in rows.rows():
            if row.state != "planned" and (row.scan is None or row.scan < scans):
                copy.settle(row.planned, row.state, row.cause, row.scan)
    finally:
        rows.close()
        copy.close()
