"""One writer: a lock that dies with the process that holds it, and names it to others."""

from __future__ import annotations

import fcntl
import os
import socket
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from configs import StoreError

__all__ = ["WriterLock", "holder_of"]

NO_NAME = "a writer that gave no name"
TRIES, PAUSE_S = 3, 0.05


def holder_of(file: Path) -> str | None:
    """Say which process holds a lock file: pid, host and since when; None where nobody does, or there is no file."""
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return _holder(descriptor)
    finally:
        os.close(descriptor)
    return None


class WriterLock:
    """``flock`` on a file of the store's folder, with pid, host and time inside for people to read.

    The kernel lets go of it when the process ends, however it ends: what a dead writer left in the file means nothing.

    Raises
    ------
    StoreError
        If another writer holds it; the message names the holder.
    """

    taken_from = ""

    def __init__(self, file: Path) -> None:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StoreError(f"{file.parent}: cannot be opened for writing: {error.strerror}") from None
        if not _take(descriptor):
            holder = _holder(descriptor)
            os.close(descriptor)
            raise StoreError(
                f"{file.parent}: another writer holds this store ({holder}): stop it first, or open the store to read"
            )
        self._descriptor: int | None = descriptor
        since = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        with suppress(OSError):  # a full disk: the lock holds without its label
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"pid {os.getpid()} on {socket.gethostname()} since {since}\n".encode(), 0)

    def check(self) -> None:
        """Do nothing: the kernel takes a lock from nobody."""

    def release(self) -> None:
        """Let go; a second call does nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def _take(descriptor: int) -> bool:
    """Take the lock; a few tries, for whoever looks with `holder_of` holds it for a moment."""
    for attempt in range(TRIES):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if attempt < TRIES - 1:
                time.sleep(PAUSE_S)
        else:
            return True
    return False


def _holder(descriptor: int) -> str:
    return os.pread(descriptor, 200, 0).decode(errors="replace").strip() or NO_NAME
