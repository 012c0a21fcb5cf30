"""The Icechunk repository beneath a store: made, opened at its newest whole snapshot."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping
from typing import Any, Literal

from configs import StoreError

from .location import BRANCH, Location

__all__ = [
    "check_whole",
    "create_repository",
    "newest_whole",
    "open_repository",
    "reason",
    "root_of",
    "short",
    "unfinished",
]

INLINE_BYTES = 1000
"""A table's newest chunk (up to 128 numbers) lies in the manifest that every commit rewrites anyway: half the files. A
full one of numbers that do not compress is a little larger: it leaves the manifest, which so stays small."""

CACHED_NODES, CACHED_CHUNKS = 1000, 20_000
"""Groups and arrays of snapshots, and chunks of manifests, that Icechunk keeps in memory: of a dozen snapshots, and of
as many scans as a window takes. Its own bounds are so wide that a writer grew by 0.2 MB with every commit."""


def _quiet() -> None:
    """Icechunk warns on stderr, at each opening, that local folders are unsafe for two writers: we hold a lock.

    And it logs a torn file before it raises, in twenty lines.
    """
    import icechunk

    if "ICECHUNK_LOG" not in os.environ:
        icechunk.set_logs_filter("off")


def create_repository(location: Location, splits: Mapping[str, Mapping[str, int]]) -> Any:
    """Make an empty repository, format 1, with manifests split as `layout.split_sizes` says.

    An empty one that is there (in a bucket a killed process may have left it) is taken.
    """
    import icechunk

    _quiet()
    condition, along = icechunk.ManifestSplitCondition, icechunk.ManifestSplitDimCondition
    sizes = {
        condition.name_matches(names): {along.DimensionName(f"^{name}$"): size for name, size in by_dimension.items()}
        for names, by_dimension in splits.items()
    }
    config = icechunk.RepositoryConfig.default()
    config.inline_chunk_threshold_bytes = INLINE_BYTES
    config.manifest = icechunk.ManifestConfig(
        preload=_no_preload(), splitting=icechunk.ManifestSplittingConfig.from_dict(sizes)
    )
    storage = location.storage()
    if icechunk.Repository.exists(storage):
        repository = icechunk.Repository.open(storage, config=config)
    else:
        options = {"spec_version": 1} if int(icechunk.__version__.split(".")[0]) >= 2 else {}
        repository = icechunk.Repository.create(storage, config=config, **options)
    repository.save_config()
    return repository


def open_repository(location: Location) -> Any:
    """Open what `create_repository` made.

    Raises
    ------
    StoreError
        If there is nothing at `location`, or something else.
    """
    location.check()
    import icechunk

    _quiet()
    caching = icechunk.CachingConfig(num_snapshot_nodes=CACHED_NODES, num_chunk_refs=CACHED_CHUNKS)
    config = icechunk.RepositoryConfig(caching=caching, manifest=icechunk.ManifestConfig(preload=_no_preload()))
    storage = location.storage()
    try:
        return icechunk.Repository.open(storage, config=config)
    except icechunk.IcechunkError as error:
        if location.mend():
            return icechunk.Repository.open(storage, config=config)
        raise StoreError(f"{location}: cannot be opened: {short(error)}") from None


def _no_preload() -> Any:
    """Read manifests when they are asked for: Icechunk else reads all of arrays named time with every session."""
    import icechunk

    return icechunk.ManifestPreloadConfig(max_total_refs=0)


def root_of(session: Any, mode: Literal["r", "r+"] = "r") -> Any:
    """Open a session's root group; Any, because zarr's own type of ``group[name][index]`` is a union of ten."""
    import zarr

    return zarr.open_group(session.store, mode=mode, use_consolidated=False)


def newest_whole(repository: Any, location: Location, probe: Callable[[Any], None]) -> tuple[str, str]:
    """Find the newest snapshot that `probe` can read, and say what is wrong with a newer one.

    `Location.publish` never points at a snapshot before all of it is kept, so only a disk that lies, a copy cut short,
    a fault of the file system or a hand in the bucket leads past the first try.

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
    if not first and unfinished(repository.lookup_snapshot(tip)):
        first = "its scans were being processed again"  # named by a reference that was torn and mended
    if not first:
        return tip, ""
    candidates = []
    for name in location.snapshots():
        try:
            info = repository.lookup_snapshot(name)
        except (icechunk.IcechunkError, ValueError):
            continue
        if not unfinished(info):
            candidates.append((info.written_at, name))
    for _, name in sorted(candidates, reverse=True):
        if name != tip and not _fault(repository, name, probe):
            return name, f"snapshot {tip} cannot be read ({first}); went back to {name}"
    raise StoreError(
        f"{location}: no snapshot holds a whole store ({first}): check the path, or restore it from a copy"
    )


def unfinished(info: Any) -> bool:
    """Whether a snapshot is a step of `rework.Rework`: new and old results side by side, shown to nobody."""
    return "process" in info.metadata and "processed" not in info.metadata


def check_whole(repository: Any, location: Location, snapshot: str, probe: Callable[[Any], None]) -> None:
    """Raise StoreError where a snapshot cannot be read."""
    fault = _fault(repository, snapshot, probe)
    if fault:
        raise StoreError(f"{location}: snapshot {snapshot} cannot be read: {fault}")


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


def short(error: BaseException) -> str:
    """Give the first line of an Icechunk or Zarr error, and of a checksum's no bytes."""
    lines = [line.strip(" |x-`>") for line in str(error).splitlines()]
    line = next((line for line in lines if line), type(error).__name__)
    if "checksum" in line.lower():
        return "its checksum does not match"
    return line.split(" in store <")[0]  # the address of an object helps nobody


def reason(error: BaseException) -> str:
    """Say in a line why the disk did not take or give something."""
    if f"os error {errno.ENOSPC}" in str(error) or getattr(error, "errno", None) == errno.ENOSPC:
        return "the disk is full: free some space"
    return getattr(error, "strerror", None) or short(error)
