"""A store on S3: one writer by a lease, commits by conditional writes, kept when the server says so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from secrets import token_hex
from typing import Any

from configs import StoreError

from .lease import Lease, holder_in
from .location import BRANCH, Location
from .objects import Found, Objects

__all__ = ["Bucket"]

UNFILLED = b"1CECHNKREP0F1RSTCMT0"
"""The snapshot that format 1 of Icechunk begins every repository with."""


class Bucket:
    """A `Location` below a prefix of a bucket.

    The lease lies beside the prefix, at ``PREFIX.lock``: Icechunk makes a repository only where there is nothing.
    """

    def __init__(self, bucket: str, prefix: str) -> None:
        self._bucket, self._prefix = bucket, prefix

    def __str__(self) -> str:
        return f"s3://{self._bucket}/{self._prefix}"

    @property
    def writes_whole(self) -> bool:
        """Yes: S3 knows no half objects."""
        return True

    def exists(self) -> bool:
        """Whether there is anything; a repository that nobody filled does not count."""
        reference = self._reference()
        return self._holds_something() if reference is None else UNFILLED not in reference.data

    def check(self) -> None:
        """Raise StoreError, saying what is wrong, where this can be no store."""
        reference = self._reference()
        if reference is None and self._holds_something():
            raise StoreError(f"{self}: is no store: it has no snapshots; give the URL that `microrelief run` took")
        if reference is None:
            raise StoreError(f"{self}: no such store: check the URL, or make one with `microrelief run`")
        if UNFILLED in reference.data:
            raise StoreError(f"{self}: no store yet: whoever made it did not finish; `microrelief run` will")

    def make(self, fill: Callable[[Location], None]) -> Lease:
        """Fill a prefix that is empty, or was left by somebody who did not get that far."""
        if self.exists():
            raise StoreError(f"{self}: exists already: open it, or choose another prefix")
        lease = self.lock()
        try:
            fill(self)
        except BaseException:
            lease.release()
            raise
        return lease

    def lock(self) -> Lease:
        """Prove that conditional writes hold here, then hold the lease; StoreError names another holder."""
        self._objects.prove_conditions(f"{self._lock}-probe-")
        return Lease(self._objects, self._lock, str(self))

    def writer(self) -> str | None:
        """Say who writes; None where nobody does, or where there is no store."""
        return holder_in(self._objects.get(self._lock))

    def storage(self) -> Any:
        """Give Icechunk's way here."""
        return self._objects.storage(self._prefix)

    def snapshots(self) -> list[str]:
        """Give the ids of all snapshots that are there and not empty."""
        return [name for name, size in self._objects.below(f"{self._prefix}/snapshots/") if size > 0]

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Give the name and the bytes of every object."""
        return self._objects.below(f"{self._prefix}/")

    def read(self, name: str) -> bytes:
        """Give what is in an object."""
        found = self._objects.get(f"{self._prefix}/{name}")
        if found is None:
            raise FileNotFoundError(f"{self}/{name}: there is no such object")
        return found.data

    def free(self) -> int | None:
        """None: as much as is paid for."""
        return None

    def sync(self) -> None:
        """Nothing is left to do: an object is kept once the server says so."""

    def mend(self) -> bool:
        """Mend nothing: an object is written whole or not at all."""
        return False

    def advance(self, repository: Any, before: str, snapshot: str) -> None:
        """Make a snapshot the newest one after `before`, by a conditional write whose answer may have been lost."""
        import icechunk

        try:
            repository.reset_branch(BRANCH, snapshot, from_snapshot_id=before)
        except (icechunk.IcechunkError, icechunk.ConflictError):
            tip: str = repository.lookup_branch(BRANCH)
            if tip == snapshot:
                return
            if tip != before:
                raise StoreError(f"{self}: another writer wrote here meanwhile: nothing was changed") from None
            raise

    def publish(self, repository: Any, session: Any, message: str, metadata: dict[str, Any]) -> str:
        """Commit a session: the reference moves by a conditional write, which fails if another writer moved it.

        A broken line can hide that it moved: the commit is looked for by a token of its own before it counts as failed.
        """
        import icechunk

        token = token_hex(8)
        try:
            snapshot: str = session.commit(message, metadata={**metadata, "commit": token})
        except (icechunk.IcechunkError, icechunk.ConflictError) as error:
            tip: str = repository.lookup_branch(BRANCH)
            if repository.lookup_snapshot(tip).metadata.get("commit") == token:
                return tip
            if isinstance(error, icechunk.ConflictError):
                raise StoreError(f"{self}: another writer wrote here meanwhile: {message} was not stored") from None
            raise
        return snapshot

    @cached_property
    def _objects(self) -> Objects:
        return Objects(self._bucket, str(self))

    @property
    def _lock(self) -> str:
        return f"{self._prefix}.lock"

    def _reference(self) -> Found | None:
        return self._objects.get(f"{self._prefix}/refs/branch.{BRANCH}/ref.json")

    def _holds_something(self) -> bool:
        return any(True for _ in self._objects.below(f"{self._prefix}/"))
