"""One writer on S3: a lease, an object that names its holder, written only conditionally and renewed while held.

Nobody tells S3 that a process died. So a lease that is not renewed for `LEASE_S` ends; one whose process is known to be
gone (same machine, same boot, no such process) ends at once. Ages are by the server's clock, or by watching: no two
clocks are compared. A holder that was only asleep finds its lease taken, and its commits refused: whoever takes over
commits first (`IcechunkStore.open`), and a commit on an older snapshot than the newest fails by Icechunk's own
conditional write.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex
from threading import Event, Thread
from typing import Protocol

from configs import StoreError

from .objects import Found, PreconditionError

__all__ = ["BEAT_S", "LEASE_S", "Lease", "holder_in"]

LEASE_S = 30.0
BEAT_S = 8.0
LOOK_S = 1.0
MARGIN_S = 2.0
"""Ages by the server's clock are whole seconds."""

TRIES = 10


class LeaseObjects(Protocol):
    """What a lease needs of a bucket."""

    def get(self, key: str) -> Found | None:
        """Read an object; None where there is none."""
        ...

    def put(self, key: str, data: bytes, *, replacing: str | None) -> str:
        """Write an object conditionally."""
        ...


@dataclass(frozen=True, slots=True)
class _Record:
    """What the object says."""

    holder: str
    token: str
    machine: str
    pid: int
    started: str
    beat: int = 0
    released: bool = False

    def to_bytes(self) -> bytes:
        return json.dumps(asdict(self)).encode()


class Lease:
    """The lease at `key` among `objects`, held and renewed until it is let go.

    Parameters
    ----------
    objects : LeaseObjects
    key : str
        Of the object.
    where : str
        The store, for messages.
    pause : callable
        Waits so many seconds; a test's does not.
    clock : callable
        Seconds, monotonic.
    beats : bool
        Whether a thread renews it; without, `beat` is to be called.

    Raises
    ------
    StoreError
        If another writer holds it: one that is alive, or gave a sign of life while we looked.
    """

    def __init__(
        self,
        objects: LeaseObjects,
        key: str,
        where: str,
        *,
        pause: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
        beats: bool = True,
    ) -> None:
        self._objects, self._key, self._where = objects, key, where
        since = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        holder = f"pid {os.getpid()} on {socket.gethostname()} since {since}"
        self._record = _Record(holder, token_hex(8), _machine(), os.getpid(), _started(os.getpid()))
        self._lost_to, self._etag = "", ""
        self.taken_from = self._take(pause, clock)
        self._ended = Event()
        self._thread = Thread(target=self._renew, name="microrelief-lease", daemon=True) if beats else None
        if self._thread is not None:
            self._thread.start()

    def check(self) -> None:
        """Raise StoreError where another writer took the lease over."""
        if self._lost_to:
            raise StoreError(
                f"{self._where}: this writer was out of touch for over {LEASE_S:g} s and another took over "
                f"({self._lost_to}): nothing was stored; stop one of them"
            )

    def beat(self) -> None:
        """Renew once; notes where the lease is lost."""
        record = replace(self._record, beat=self._record.beat + 1)
        try:
            self._etag = self._objects.put(self._key, record.to_bytes(), replacing=self._etag)
        except PreconditionError:
            found = self._objects.get(self._key)
            theirs = _record_in(found)
            # our own write may have been answered by a broken line and sent again
            if found is not None and theirs is not None and theirs.token == self._record.token:
                self._etag = found.etag
            else:
                self._lost_to = theirs.holder if theirs is not None else "it left no name"
                return
        self._record = record

    def release(self) -> None:
        """Let go; a second call does nothing."""
        if self._ended.is_set():
            return
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        if not self._lost_to:
            with suppress(StoreError, PreconditionError):  # then it ends by itself
                self._objects.put(self._key, replace(self._record, released=True).to_bytes(), replacing=self._etag)

    def _take(self, pause: Callable[[float], None], clock: Callable[[], float]) -> str:
        """Take the lease; give the holder that it was taken from, empty where it was free."""
        seen, since = "", clock()
        for _ in range(TRIES + int(LEASE_S / LOOK_S)):
            found = self._objects.get(self._key)
            record = _record_in(found)
            if found is not None and (record is None or not record.released):
                holder = record.holder if record is not None else "a writer that gave no name"
                if seen and seen != found.etag:
                    raise self._held(holder)
                if not seen:
                    seen, since = found.etag, clock()
                alive = _alive(record)
                if alive:
                    raise self._held(holder)
                over = found.age_s > LEASE_S + MARGIN_S or clock() - since > LEASE_S
                if alive is None and not over:
                    pause(LOOK_S)
                    continue
            else:
                holder = ""
            try:
                replacing = None if found is None else found.etag
                self._etag = self._objects.put(self._key, self._record.to_bytes(), replacing=replacing)
            except PreconditionError:
                continue
            return holder
        raise self._held("several at once")

    def _held(self, holder: str) -> StoreError:
        return StoreError(
            f"{self._where}: another writer holds this store ({holder}): stop it first, or open the store to read"
        )

    def _renew(self) -> None:
        while not self._ended.wait(BEAT_S) and not self._lost_to:
            with suppress(StoreError):  # no network: the lease goes on if it is back before somebody takes over
                self.beat()


def holder_in(found: Found | None) -> str | None:
    """Say who holds a lease, as far as can be told without waiting; None where nobody does."""
    record = _record_in(found)
    if found is None or record is None or record.released:
        return None
    alive = _alive(record)
    return None if alive is False or (alive is None and found.age_s > LEASE_S + MARGIN_S) else record.holder


def _record_in(found: Found | None) -> _Record | None:
    """Read the object; None for one that is not ours to read."""
    if found is None:
        return None
    try:
        return _Record(**json.loads(found.data))
    except (ValueError, TypeError):
        return None


def _alive(record: _Record | None) -> bool | None:
    """Whether the process that wrote a record lives; None where that cannot be known from here."""
    if record is None or not record.machine or record.machine != _machine():
        return None
    return _started(record.pid) == record.started


def _machine() -> str:
    """Name this boot of this machine and its table of processes; empty where the system does not say."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {Path('/proc/self/ns/pid').readlink()}"
    except OSError:
        return ""


def _started(pid: int) -> str:
    """Give when a process started, in the kernel's ticks: a number that was used again is another process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""
