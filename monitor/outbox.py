"""Outbox: messages that are to be sent, and what was told; SQLite beside the ledger. It holds no address."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines import Instant

from .conditions import Message, Standing

__all__ = ["Outbox", "Pending"]

RETRY_S = (60, 300, 900, 3600, 4 * 3600, 12 * 3600, 24 * 3600)
"""Waits before another try; after the last one a message is given up."""

_TABLES = """
CREATE TABLE IF NOT EXISTS messages (
    id INTEGER PRIMARY KEY, who TEXT NOT NULL, title TEXT NOT NULL, body TEXT NOT NULL,
    due INTEGER NOT NULL, tries INTEGER NOT NULL DEFAULT 0,
    state TEXT NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'sent', 'given up'))
);
CREATE TABLE IF NOT EXISTS standing (
    who TEXT NOT NULL, kind TEXT NOT NULL, what TEXT NOT NULL, detail TEXT NOT NULL,
    since INTEGER NOT NULL, told INTEGER NOT NULL, UNIQUE (who, kind, what)
);
"""


@dataclass(frozen=True, slots=True)
class Pending:
    """A message that is due to be tried."""

    id: int
    who: str
    message: Message
    tries: int


class Outbox:
    """The messages of one campaign, for each group of people. Safe to use from two threads.

    Parameters
    ----------
    file : Path

    Raises
    ------
    sqlite3.Error
        If the disk does not let it.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        with closing(self._open()) as data, data:
            data.execute("PRAGMA journal_mode = WAL")
            data.executescript(_TABLES)

    def standing(self, who: str) -> tuple[Standing, ...]:
        """Give what stands, as it was last told to a group."""
        with closing(self._open()) as data:
            rows = data.execute("SELECT kind, what, detail, since, told FROM standing WHERE who = ?", (who,)).fetchall()
        return tuple(
            Standing(kind, what, detail, _instant(since), _instant(told)) for kind, what, detail, since, told in rows
        )

    def put(self, who: str, messages: Iterable[Message], stands: Iterable[Standing], now: Instant) -> None:
        """Keep messages to send and what now stands, both or neither."""
        with closing(self._open()) as data, data:
            data.execute("DELETE FROM standing WHERE who = ?", (who,))
            data.executemany(
                "INSERT INTO standing VALUES (?, ?, ?, ?, ?, ?)",
                [(who, each.kind, each.what, each.detail, _ns(each.since), _ns(each.told)) for each in stands],
            )
            data.executemany(
                "INSERT INTO messages (who, title, body, due) VALUES (?, ?, ?, ?)",
                [(who, each.title, each.body, _ns(now)) for each in messages],
            )

    def due(self, now: Instant) -> tuple[Pending, ...]:
        """Give the messages to try now, oldest first."""
        with closing(self._open()) as data:
            rows = data.execute(
                "SELECT id, who, title, body, tries FROM messages WHERE state = 'waiting' AND due <= ? ORDER BY id",
                (_ns(now),),
            ).fetchall()
        return tuple(Pending(number, who, Message(title, body), tries) for number, who, title, body, tries in rows)

    def sent(self, pending: Pending) -> None:
        """Note that a message has arrived."""
        self._change("UPDATE messages SET state = 'sent', tries = tries + 1 WHERE id = ?", (pending.id,))

    def failed(self, pending: Pending, now: Instant) -> bool:
        """Note that a try failed; say whether there will be another."""
        again = pending.tries < len(RETRY_S)
        wait = RETRY_S[pending.tries] if again else 0
        self._change(
            "UPDATE messages SET tries = tries + 1, due = ?, state = ? WHERE id = ?",
            (_ns(now) + wait * 10**9, "waiting" if again else "given up", pending.id),
        )
        return again

    def counts(self) -> dict[str, int]:
        """Count the messages by state."""
        with closing(self._open()) as data:
            found = dict(data.execute("SELECT state, count(*) FROM messages GROUP BY state").fetchall())
        return {state: int(found.get(state, 0)) for state in ("waiting", "sent", "given up")}

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(self._file, timeout=10.0)

    def _change(self, statement: str, values: tuple[Any, ...]) -> None:
        with closing(self._open()) as data, data:
            data.execute(statement, values)


def _ns(moment: Instant) -> int:
    return int(moment.astype("datetime64[ns]").astype(np.int64))


def _instant(nanoseconds: int) -> Instant:
    return np.datetime64(nanoseconds, "ns")
