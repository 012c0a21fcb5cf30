"""Where a store lies: what differs between a local folder and a bucket, and nothing else."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from configs import StoreError

__all__ = ["BRANCH", "LOCK", "Location", "Lock", "location_of", "store_exists", "writer_of"]

BRANCH = "main"
LOCK = "writer.lock"


class Lock(Protocol):
    """The one writer's hold on a store."""

    taken_from: str
    """The writer that ended without letting go, where that may matter; else empty."""

    def check(self) -> None:
        """Raise StoreError where the hold is lost."""
        ...

    def release(self) -> None:
        """Let go; a second call does nothing."""
        ...


class Location(Protocol):
    """A place for an Icechunk repository. ``str()`` names it as the user does."""

    @property
    def writes_whole(self) -> bool:
        """Whether a write is there whole or not at all, whatever happens to power and network."""
        ...

    def exists(self) -> bool:
        """Whether there is anything; a store that nobody finished making does not count."""
        ...

    def check(self) -> None:
        """Raise StoreError, saying what is wrong, where this can be no store."""
        ...

    def make(self, fill: Callable[[Location], None]) -> Lock:
        """Let `fill` put a repository here, whole or not at all, and hold its lock; refuse where there is something."""
        ...

    def lock(self) -> Lock:
        """Hold the writer's lock, or raise StoreError that names its holder."""
        ...

    def writer(self) -> str | None:
        """Say who writes; None where nobody does, or where there is no store."""
        ...

    def storage(self) -> Any:
        """Give Icechunk's way here."""
        ...

    def snapshots(self) -> list[str]:
        """Give the ids of all snapshots that are there and not empty."""
        ...

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Give the name below here and the bytes of every file or object."""
        ...

    def read(self, name: str) -> bytes:
        """Give what is in a file or object, by its name below here. Raises OSError where there is none."""
        ...

    def free(self) -> int | None:
        """Give the bytes that are free here; None where nothing limits them."""
        ...

    def sync(self) -> None:
        """Make durable what was written."""
        ...

    def mend(self) -> bool:
        """Mend a reference that a power cut tore; say whether there was one."""
        ...

    def advance(self, repository: Any, before: str, snapshot: str) -> None:
        """Make a snapshot the newest one after `before`, durably; refuse where another is the newest."""
        ...

    def publish(self, repository: Any, session: Any, message: str, metadata: dict[str, Any]) -> str:
        """Commit a session, durable when it returns; give the snapshot's id."""
        ...


def location_of(store: str | Path) -> Location:
    """Tell a folder from ``s3://bucket/prefix``; a `Path` folds the two slashes into one.

    Raises
    ------
    StoreError
        If it is a URL of another kind, or names no bucket.
    """
    text = str(store)
    scheme = re.match(r"(\w[\w+.-]+):/", text)
    if scheme is None:
        from .folder import Folder

        return Folder(Path(store))
    bucket, _, prefix = text[scheme.end() :].strip("/").partition("/")
    if scheme[1] != "s3" or not bucket or not prefix:
        raise StoreError(f"{text}: is no place for a store: give a folder, or s3://BUCKET/PREFIX")
    from .bucket import Bucket

    return Bucket(bucket, prefix)


def store_exists(store: str | Path) -> bool:
    """Whether there is anything where a store is to be.

    Raises
    ------
    StoreError
        If that cannot be found out (no such bucket, no credentials, no network).
    """
    return location_of(store).exists()


def writer_of(store: str | Path) -> str | None:
    """Say which process writes a store: pid, host and since when; None where nobody does, or where there is no store.

    Parameters
    ----------
    store : str or Path
        The store's folder or ``s3://bucket/prefix``.
    """
    return location_of(store).writer()
