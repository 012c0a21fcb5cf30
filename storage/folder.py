"""A store in a local folder: one writer by `flock`, every commit synced before its reference moves."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from configs import StoreError

from .durable import sync_file, sync_file_system
from .location import BRANCH, LOCK, Location
from .lock import WriterLock, holder_of

__all__ = ["Folder"]


@dataclass(frozen=True, slots=True)
class Folder:
    """A `Location` on a disk of this machine."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @property
    def writes_whole(self) -> bool:
        """No: a power cut can leave a file empty or cut."""
        return False

    def exists(self) -> bool:
        """Whether there is anything."""
        return self.path.exists()

    def check(self) -> None:
        """Raise StoreError, saying what is wrong, where this can be no store."""
        try:
            self._look()
        except PermissionError as error:
            raise StoreError(f"{self}: cannot be read: {error.strerror}: whose is it?") from None

    def _look(self) -> None:
        if not self.path.exists():
            raise StoreError(f"{self}: no such store: check the path, or make one with `microrelief run`")
        if not self.path.is_dir():
            raise StoreError(f"{self}: is a file, not a store: a store is a folder")
        if not (self.path / "snapshots").is_dir() or not (self.path / "refs").is_dir():
            raise StoreError(f"{self}: is no store: it has no snapshots; give the folder that `microrelief run` made")

    def make(self, fill: Callable[[Location], None]) -> WriterLock:
        """Fill a folder beside this one and rename it: a store is there with all its groups, or not at all."""
        if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise StoreError(f"{self}: exists already: open it, or choose another path")
        making = self.path.with_name(f".{self.path.name}.making-{os.getpid()}")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(making, ignore_errors=True)
            making.mkdir()
        except OSError as error:
            raise StoreError(f"{self}: cannot be made: {error.strerror}") from None
        lock = None
        try:
            fill(Folder(making))
            lock = WriterLock(making / LOCK)
            making.rename(self.path)
        except BaseException:
            if lock is not None:
                lock.release()
            shutil.rmtree(making, ignore_errors=True)
            raise
        return lock

    def lock(self) -> WriterLock:
        """Hold the writer's lock, or raise StoreError that names its holder."""
        return WriterLock(self.path / LOCK)

    def writer(self) -> str | None:
        """Say who writes; None where nobody does, or where there is no store."""
        return holder_of(self.path / LOCK)

    def storage(self) -> Any:
        """Give Icechunk's way here."""
        import icechunk

        return icechunk.local_filesystem_storage(str(self.path))

    def snapshots(self) -> list[str]:
        """Give the ids of all snapshots that are there and not empty."""
        return sorted(path.name for path in (self.path / "snapshots").iterdir() if path.stat().st_size > 0)

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Give the name and the bytes of every file, while others may write here."""
        for where, _, names in os.walk(self.path):
            for name in names:
                file = Path(where) / name
                with suppress(OSError):  # renamed or removed a moment ago
                    yield file.relative_to(self.path).as_posix(), file.stat().st_size

    def read(self, name: str) -> bytes:
        """Give what is in a file."""
        return (self.path / name).read_bytes()

    def free(self) -> int | None:
        """Give the bytes free on its disk."""
        return shutil.disk_usage(self.path).free

    def sync(self) -> None:
        """Put everything that was written on the disk."""
        sync_file_system(self.path)

    def mend(self) -> bool:
        """Point a torn ``ref.json`` (empty, zeros or cut short after a power cut) at the newest written snapshot."""
        file = self._reference
        if not file.is_file() or b"}" in file.read_bytes():
            return False
        written = [path for path in (self.path / "snapshots").iterdir() if path.stat().st_size > 0]
        if not written:
            return False
        newest = max(written, key=lambda path: path.stat().st_mtime_ns)
        temporary = file.with_name("ref.json.mended")
        try:
            temporary.write_text(f'{{"snapshot":"{newest.name}"}}')
            sync_file(temporary)
            temporary.replace(file)
            sync_file(file)
        except OSError as error:
            raise StoreError(
                f"{self}: {file.relative_to(self.path)} was torn by a power cut and cannot be mended here: "
                f"{error.strerror}; open the store once where it can be written, or open a copy of it"
            ) from None
        return True

    def advance(self, repository: Any, before: str, snapshot: str) -> None:
        """Make a snapshot the newest one after `before`: all of it on the disk first, then the reference."""
        sync_file_system(self.path)
        repository.reset_branch(BRANCH, snapshot, from_snapshot_id=before)
        try:
            sync_file(self._reference)
        except OSError:
            repository.reset_branch(BRANCH, before)  # what is not acknowledged is not there
            raise

    def publish(self, repository: Any, session: Any, message: str, metadata: dict[str, Any]) -> str:
        """Commit a session durably: first everything it wrote, then the reference that makes it the newest.

        Icechunk never syncs a local folder: its own ``commit`` moves the reference at once, and after a power cut it
        can name a snapshot that is an empty file. ``flush`` writes the snapshot without the reference.
        """
        before = session.snapshot_id
        snapshot: str = session.flush(message, metadata=metadata)
        self.advance(repository, before, snapshot)
        return snapshot

    @property
    def _reference(self) -> Path:
        return self.path / "refs" / f"branch.{BRANCH}" / "ref.json"
