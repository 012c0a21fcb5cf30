"""Ledger: one row for each planned slot of a campaign, which ends in exactly one state. SQLite beside the store."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from configs import StoreError
from pipelines import Event, Instant, Tick, format_instant

from .folder import Folder
from .location import location_of
from .store import Store

__all__ = ["INTERRUPTED", "Ledger", "LedgerAddress", "LedgerRow", "LedgerWriteError", "SlotState", "ledger_beside"]

LEDGER = "ledger.sqlite"
INTERRUPTED = "the process ended before this scan was stored"

SlotState = Literal["planned", "taken", "missed", "rejected", "failed"]
FINAL = tuple(state for state in get_args(SlotState) if state != "planned")

_TABLE = """
CREATE TABLE IF NOT EXISTS slots (
    campaign TEXT NOT NULL,
    planned INTEGER NOT NULL,  -- nanoseconds since 1970-01-01 UTC
    state TEXT NOT NULL DEFAULT 'planned' CHECK (state IN ('planned', 'taken', 'missed', 'rejected', 'failed')),
    cause TEXT NOT NULL DEFAULT '',
    scan INTEGER,
    UNIQUE (campaign, planned)
)
"""
_COLUMNS = "planned, state, cause, scan"
_SETTLE = """
INSERT INTO slots (campaign, planned, state, cause, scan) VALUES (?, ?, ?, ?, ?)
ON CONFLICT (campaign, planned) DO UPDATE SET state = excluded.state, cause = excluded.cause, scan = excluded.scan
WHERE state = 'planned'
"""


class LedgerWriteError(StoreError):
    """The disk did not take a row; a later try may succeed."""


@dataclass(frozen=True, slots=True)
class LedgerRow:
    """A slot of the schedule: "planned" until it is settled; `cause` says why it is not taken; `scan` its number."""

    planned: Instant
    state: SlotState
    cause: str = ""
    scan: int | None = None


@dataclass(frozen=True, slots=True)
class LedgerAddress:
    """Where a store's ledger is, and which of its rows are the store's: stores of one folder share the file."""

    file: Path
    campaign: str

    def exists(self) -> bool:
        """Whether there is such a file."""
        return self.file.exists()

    def __fspath__(self) -> str:
        return str(self.file)

    def __str__(self) -> str:
        return str(self.file)


def ledger_beside(store: str | Path, folder: Path | None = None) -> LedgerAddress:
    """Give the address of a store's ledger: ``ledger.sqlite`` in the folder that holds the store.

    That of a store on S3 is in `folder`, the campaign's; in the current folder where none is given.
    """
    location = location_of(store)
    if isinstance(location, Folder):
        return LedgerAddress(location.path.parent / LEDGER, location.path.name)
    return LedgerAddress((folder or Path()) / LEDGER, str(location))


class Ledger:
    """The rows of one campaign; every change is on the disk when it returns.

    Parameters
    ----------
    where : LedgerAddress or path
        As `ledger_beside` gives it.
    campaign : str, optional
        Whose rows, where `where` does not say.
    write : bool
        False to read only; then the file must exist.

    Raises
    ------
    StoreError
        If the file cannot be opened, or is no ledger.
    """

    def __init__(
        self, where: LedgerAddress | str | os.PathLike[str], campaign: str | None = None, *, write: bool = True
    ) -> None:
        self._file = Path(where)
        self._campaign = campaign or (where.campaign if isinstance(where, LedgerAddress) else "")
        if not write and not self._file.exists():
            raise StoreError(f"{self._file}: no such ledger: it is made by `microrelief run`")
        try:
            # the status page reads from another thread; sqlite3 serialises calls itself
            address = _address(self._file, write=write)
            self._data = sqlite3.connect(
                address, timeout=10.0, isolation_level=None, check_same_thread=False, uri=address.startswith("file:")
            )
            if write:
                self._data.execute("PRAGMA journal_mode = WAL")
                self._data.execute("PRAGMA synchronous = FULL")
                self._data.execute(_TABLE)
            else:
                self._data.execute("PRAGMA query_only = ON")
                self._check_tables()
        except sqlite3.Error as error:
            if hasattr(self, "_data"):
                self._data.close()
            raise StoreError(f"{self._file}: cannot be opened as a ledger: {error}") from None

    def plan(self, planned: Instant) -> None:
        """Note that a slot is to be answered; a slot that is there already stays as it is."""
        self._change("INSERT OR IGNORE INTO slots (campaign, planned) VALUES (?, ?)", (self._campaign, _ns(planned)))

    def settle(self, planned: Instant, state: SlotState, cause: str = "", scan: int | None = None) -> None:
        """Note how a slot ended. The same end twice is one end; a slot that was never planned is planned first.

        Raises
        ------
        ValueError
            If `state` is none of the four ends.
        StoreError
            If the slot has ended in another state.
        """
        if state not in FINAL:
            raise ValueError(f"a slot ends {', '.join(FINAL)}, not {state!r}")
        if not self._change(_SETTLE, (self._campaign, _ns(planned), state, cause, scan)):
            self._ended_so(planned, state)

    def settle_all(self, planned: Sequence[Instant], state: SlotState, cause: str = "") -> None:
        """Note that slots ended alike, in one transaction: all of them or none; else as `settle`.

        Raises
        ------
        ValueError
            If `state` is none of the four ends.
        StoreError
            If one of the slots has ended in another state; then none is changed.
        """
        if state not in FINAL:
            raise ValueError(f"a slot ends {', '.join(FINAL)}, not {state!r}")
        with self._transaction():
            for slot in planned:
                if not self._change(_SETTLE, (self._campaign, _ns(slot), state, cause, None)):
                    self._ended_so(slot, state)

    def rows(self, first: Instant | None = None, last: Instant | None = None) -> tuple[LedgerRow, ...]:
        """Give the slots between two instants (both included), oldest first."""
        bounds = np.iinfo(np.int64)
        low = bounds.min if first is None else _ns(first)
        high = bounds.max if last is None else _ns(last)
        found = self._found(
            f"SELECT {_COLUMNS} FROM slots WHERE campaign = ? AND planned BETWEEN ? AND ? ORDER BY planned",  # noqa: S608 - a constant
            (self._campaign, int(low), int(high)),
        )
        return tuple(_row(*row) for row in found)

    def counts(self) -> dict[str, int]:
        """Count the slots by state; a state that none is in counts 0."""
        found = self._found("SELECT state, count(*) FROM slots WHERE campaign = ? GROUP BY state", (self._campaign,))
        return dict.fromkeys(get_args(SlotState), 0) | dict(found)

    def last(self) -> LedgerRow | None:
        """Give the newest slot."""
        found = self._found(
            f"SELECT {_COLUMNS} FROM slots WHERE campaign = ? ORDER BY planned DESC LIMIT 1",  # noqa: S608 - a constant
            (self._campaign,),
        )
        return _row(*found[0]) if found else None

    def reconcile(self, store: Store) -> tuple[LedgerRow, ...]:
        """Settle what a killed process left open, each as the store tells that it ended; a writer does this first.

        A slot whose scan is in the store was taken, or rejected where its tick says so; one without a scan failed or
        was rejected where a tick says that; any other was missed, and the store is told.

        Parameters
        ----------
        store : Store
            Open to write.

        Returns
        -------
        tuple of LedgerRow
            The slots that were open, as they are settled now.
        """
        pending = [row.planned for row in self.rows() if row.state == "planned"]
        if not pending:
            return ()
        window = store.window()
        moments = zip(window["planned"].values, window["scan"].values, window["time"].values, strict=True)
        scans = {_ns(planned): (int(number), _ns(time)) for planned, number, time in moments}
        ends = [event for event in store.events if event.kind in ("failed", "rejected")]
        settled = []
        for planned, following in zip(pending, (*pending[1:], None), strict=True):
            row = _as_stored(planned, following, scans.get(_ns(planned)), ends)
            if row.state == "missed":
                text = f"missed {format_instant(planned)}: {row.cause}"
                store.append(Tick(planned, events=(Event(planned, "missed", text),)))
            self.settle(planned, row.state, row.cause, row.scan)
            settled.append(row)
        return tuple(settled)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._data.close()

    def _change(self, statement: str, values: tuple[object, ...]) -> int:
        try:
            return self._data.execute(statement, values).rowcount
        except sqlite3.Error as error:
            raise self._unwritten(error) from None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._change("BEGIN IMMEDIATE", ())
        try:
            yield
            self._change("COMMIT", ())
        except BaseException:
            if self._data.in_transaction:
                self._data.execute("ROLLBACK")
            raise

    def _unwritten(self, error: sqlite3.Error) -> LedgerWriteError:
        return LedgerWriteError(f"{self._file}: the ledger was not written: {error}")

    def _ended_so(self, planned: Instant, state: SlotState) -> None:
        """Refuse a second end that is another one."""
        ((ended,),) = self._found(
            "SELECT state FROM slots WHERE campaign = ? AND planned = ?", (self._campaign, _ns(planned))
        )
        if ended != state:
            raise StoreError(
                f"{self._file}: slot {format_instant(planned)} has ended {ended}: it cannot be {state} too"
            )

    def _found(self, query: str, values: tuple[object, ...]) -> list[Any]:
        """Ask; a ledger whose writer has made the file and not yet the table is empty."""
        try:
            return self._data.execute(query, values).fetchall()
        except sqlite3.Error as error:
            if "no such table" in str(error):
                return []
            raise StoreError(f"{self._file}: the ledger cannot be read: {error}") from None

    def _check_tables(self) -> None:
        """Refuse another program's database; one without any table is a ledger that is being made."""
        names = [name for (name,) in self._data.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        if names and "slots" not in names:
            raise sqlite3.DatabaseError(f"it has a table {names[0]}, and no slots")


def _address(file: Path, *, write: bool) -> str:
    """Give what SQLite is to open. To read a ledger it makes two files beside it, unless told that nobody writes."""
    if write or os.access(file.parent, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
        return str(file)
    return f"file:{quote(str(file))}?immutable=1"


def _as_stored(
    planned: Instant, following: Instant | None, scan: tuple[int, int] | None, ends: Sequence[Event]
) -> LedgerRow:
    """Say how a slot ended by what its tick left in the store: its scan (number; time, ns) and why it is not taken.

    Visits are one at a time, so what ended since `planned`, and before the next open slot, ended this one.
    """
    if scan is not None:
        number, time = scan
        why = [event for event in ends if event.kind == "rejected" and _ns(event.time) == time]
        return LedgerRow(planned, "rejected", why[0].text, number) if why else LedgerRow(planned, "taken", "", number)
    since = [event for event in ends if event.time >= planned and (following is None or event.time < following)]
    if since:
        return LedgerRow(planned, "rejected" if since[0].kind == "rejected" else "failed", since[0].text)
    return LedgerRow(planned, "missed", INTERRUPTED)


def _ns(moment: Instant) -> int:
    return int(moment.astype("datetime64[ns]").astype(np.int64))


def _row(planned: int, state: SlotState, cause: str, scan: int | None) -> LedgerRow:
    return LedgerRow(np.datetime64(planned, "ns"), state, cause, scan)
