"""The Icechunk repository beneath a store: made whole, opened at its newest whole snapshot, moved on durably."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from configs import StoreError

from .durable import sync_file, sync_file_system

__all__ = ["advance", "create_repository", "newest_whole", "open_repository", "publish", "root_of", "short"]

BRANCH = "main"
INLINE_BYTES = 1100
"""A table's newest chunk (128 numbers) lives in the manifest that every commit rewrites anyway: half the files."""


def _quiet() -> None:
    """Icechunk warns on stderr, at each opening, that local folders are unsafe for two writers: we hold a lock."""
    import icechunk

    if "ICECHUNK_LOG" not in os.environ:
        icechunk.set_logs_filter("error")


def create_repository(folder: Path, splits: tuple[int, int], cells: tuple[str, ...]) -> Any:
    """Make an empty repository, format 1, whose manifests hold `splits` chunks along time: of `cells`, of the rest."""
    import icechunk

    _quiet()
    condition, along = icechunk.ManifestSplitCondition, icechunk.ManifestSplitDimCondition
    of_cells, of_tables = splits
    sizes = {condition.name_matches(f"^({'|'.join(cells)})$"): {along.DimensionName("time"): of_cells}}
    sizes[condition.AnyArray()] = {along.Any(): of_tables}
    config = icechunk.RepositoryConfig.default()
    config.inline_chunk_threshold_bytes = INLINE_BYTES
    config.manifest = icechunk.ManifestConfig(splitting=icechunk.ManifestSplittingConfig.from_dict(sizes))
    options = {"spec_version": 1} if int(icechunk.__version__.split(".")[0]) >= 2 else {}
    repository = icechunk.Repository.create(icechunk.local_filesystem_storage(str(folder)), config=config, **options)
    repository.save_config()
    return repository


def open_repository(folder: Path) -> Any:
    """Open what `create_repository` made.

    Raises
    ------
    StoreError
        If there is nothing at `folder`, or something else.
    """
    if not folder.exists():
        raise StoreError(f"{folder}: no such store: check the path, or make one with `microrelief run`")
    if not folder.is_dir():
        raise StoreError(f"{folder}: is a file, not a store: a store is a folder")
    if not (folder / "snapshots").is_dir() or not (folder / "refs").is_dir():
        raise StoreError(f"{folder}: is no store: it has no snapshots; give the folder that `microrelief run` made")
    import icechunk

    _quiet()
    storage = icechunk.local_filesystem_storage(str(folder))
    try:
        return icechunk.Repository.open(storage)
    except icechunk.IcechunkError as error:
        if _mend_reference(folder):
            return icechunk.Repository.open(storage)
        raise StoreError(f"{folder}: cannot be opened: {short(error)}") from None


def root_of(session: Any, mode: Literal["r", "r+"] = "r") -> Any:
    """Open a session's root group; Any, because zarr's own type of ``group[name][index]`` is a union of ten."""
    import zarr

    return zarr.open_group(session.store, mode=mode, use_consolidated=False)


def newest_whole(repository: Any, folder: Path, probe: Callable[[Any], None]) -> tuple[str, str]:
    """Find the newest snapshot that `probe` can read, and say what is wrong with a newer one.

    `publish` never points at a snapshot before all of it is on the disk, so only a disk that lies, a copy cut short or
    a fault of the file system leads past the first try.

    Returns
    -------
    snapshot, lost : str
        `lost` is empty where nothing was lost.

    Raises
    ------
    StoreError
        If no snapshot is whole.
    """
    import icechunk

    tip = repository.lookup_branch(BRANCH)
    first = _fault(repository, tip, probe)
    if not first:
        return tip, ""
    candidates = []
    for name in sorted(path.name for path in (folder / "snapshots").iterdir() if path.stat().st_size > 0):
        try:
            candidates.append((repository.lookup_snapshot(name).written_at, name))
        except (icechunk.IcechunkError, ValueError):
            continue
    for _, name in sorted(candidates, reverse=True):
        if name != tip and not _fault(repository, name, probe):
            return name, f"snapshot {tip} cannot be read ({first}); went back to {name}"
    raise StoreError(f"{folder}: no snapshot holds a whole store ({first}): check the path, or restore it from a copy")


def publish(repository: Any, folder: Path, session: Any, message: str, metadata: dict[str, Any]) -> str:
    """Commit a session durably: first everything it wrote, then the reference that makes it the newest.

    Icechunk never syncs a local folder: its own ``commit`` moves the reference at once, and after a power cut it can
    name a snapshot that is an empty file. ``flush`` writes the snapshot without the reference.
    """
    before = session.snapshot_id
    snapshot: str = session.flush(message, metadata=metadata)
    advance(repository, folder, before, snapshot)
    return snapshot


def advance(repository: Any, folder: Path, before: str, snapshot: str) -> None:
    """Make a snapshot the newest one after `before`, durably: all of it first, then the reference."""
    sync_file_system(folder)
    repository.reset_branch(BRANCH, snapshot, from_snapshot_id=before)
    try:
        sync_file(folder / "refs" / f"branch.{BRANCH}" / "ref.json")
    except OSError:
        repository.reset_branch(BRANCH, before)  # what is not acknowledged is not there
        raise


def _fault(repository: Any, snapshot: str, probe: Callable[[Any], None]) -> str:
    """Give what is wrong with a snapshot; empty where it is whole."""
    import icechunk

    try:
        probe(repository.readonly_session(snapshot_id=snapshot))
    except StoreError:
        raise
    # a damaged file shows as whatever the codec above it makes of the bytes
    except (icechunk.IcechunkError, OSError, ValueError, RuntimeError, KeyError, IndexError, TypeError) as error:
        return short(error)
    return ""


def _mend_reference(folder: Path) -> bool:
    """Point a torn ``ref.json`` (a file of zeros or of nothing after a power cut) at the newest written snapshot."""
    file = folder / "refs" / f"branch.{BRANCH}" / "ref.json"
    if not file.is_file() or file.read_bytes().strip(b"\0 \n"):
        return False
    written = [path for path in (folder / "snapshots").iterdir() if path.stat().st_size > 0]
    if not written:
        return False
    newest = max(written, key=lambda path: path.stat().st_mtime_ns)
    temporary = file.with_name("ref.json.mended")
    temporary.write_text(f'{{"snapshot":"{newest.name}"}}')
    sync_file(temporary)
    temporary.replace(file)
    sync_file(file)
    return True


def short(error: BaseException) -> str:
    """Give the first line of an Icechunk or Zarr error."""
    lines = [line.strip(" |x-`>") for line in str(error).splitlines()]
    line = next((line for line in lines if line), type(error).__name__)
    return line.split(" in store <")[0]  # the address of an object helps nobody
