"""Ledger: one row for each planned slot of a campaign, which ends in exactly one state. SQLite beside the store."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from configs import StoreError
from pipelines import Instant, format_instant

from .store import Store

__all__ = ["Ledger", "LedgerAddress", "LedgerRow", "SlotState", "ledger_beside"]

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


def ledger_beside(store: str | Path) -> LedgerAddress:
    """Give the address of a store's ledger: ``ledger.sqlite`` in the folder that holds the store."""
    path = Path(store)
    return LedgerAddress(path.parent / "ledger.sqlite", path.name)


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
            self._data = sqlite3.connect(self._file, timeout=10.0, isolation_level=None, check_same_thread=False)
            if write:
                self._data.execute("PRAGMA journal_mode = WAL")
                self._data.execute("PRAGMA synchronous = FULL")
                self._data.execute(_TABLE)
            else:
                self._data.execute("PRAGMA query_only = ON")
                self._data.execute("SELECT count(*) FROM slots")
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
        key = (self._campaign, _ns(planned))
        changed = self._change(
            "INSERT INTO slots (campaign, planned, state, cause, scan) VALUES (?, ?, ?, ?, ?) "
            "ON CONFLICT (campaign, planned) DO UPDATE SET state = excluded.state, cause = excluded.cause, "
            "scan = excluded.scan WHERE state = 'planned'",
            (*key, state, cause, scan),
        )
        if changed:
            return
        (ended,) = self._data.execute("SELECT state FROM slots WHERE campaign = ? AND planned = ?", key).fetchone()
        if ended != state:
            raise StoreError(
                f"{self._file}: slot {format_instant(planned)} has ended {ended}: it cannot be {state} too"
            )

    def rows(self, first: Instant | None = None, last: Instant | None = None) -> tuple[LedgerRow, ...]:
        """Give the slots between two instants (both included), oldest first."""
        bounds = np.iinfo(np.int64)
        low = bounds.min if first is None else _ns(first)
        high = bounds.max if last is None else _ns(last)
        found = self._data.execute(
            f"SELECT {_COLUMNS} FROM slots WHERE campaign = ? AND planned BETWEEN ? AND ? ORDER BY planned",  # noqa: S608 - a constant
            (self._campaign, int(low), int(high)),
        )
        return tuple(_row(*row) for row in found)

    def counts(self) -> dict[str, int]:
        """Count the slots by state; a state that none is in counts 0."""
        found = self._data.execute(
            "SELECT state, count(*) FROM slots WHERE campaign = ? GROUP BY state", (self._campaign,)
        )
        return dict.fromkeys(get_args(SlotState), 0) | dict(found)

    def last(self) -> LedgerRow | None:
        """Give the newest slot."""
        found = self._data.execute(
            f"SELECT {_COLUMNS} FROM slots WHERE campaign = ? ORDER BY planned DESC LIMIT 1",  # noqa: S608 - a constant
            (self._campaign,),
        ).fetchone()
        return None if found is None else _row(*found)

    def reconcile(self, store: Store) -> tuple[Instant, ...]:
        """Settle as taken the open slots whose scan is in the store: a kill came between the commit and the row.

        Returns
        -------
        tuple of Instant
            The slots that stay open: nothing of them was committed.
        """
        pending = [row.planned for row in self.rows() if row.state == "planned"]
        if not pending:
            return ()
        window = store.window()
        committed: Mapping[int, int] = dict(
            zip(window["planned"].values.astype(np.int64).tolist(), window["scan"].values.tolist(), strict=True)
        )
        left = []
        for planned in pending:
            number = committed.get(_ns(planned))
            if number is None:
                left.append(planned)
            else:
                self.settle(planned, "taken", scan=number)
        return tuple(left)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._data.close()

    def _change(self, statement: str, values: tuple[object, ...]) -> int:
        try:
            return self._data.execute(statement, values).rowcount
        except sqlite3.Error as error:
            raise StoreError(f"{self._file}: the ledger was not written: {error}") from None


def _ns(moment: Instant) -> int:
    return int(moment.astype("datetime64[ns]").astype(np.int64))


def _row(planned: int, state: SlotState, cause: str, scan: int | None) -> LedgerRow:
    return LedgerRow(np.datetime64(planned, "ns"), state, cause, scan)
