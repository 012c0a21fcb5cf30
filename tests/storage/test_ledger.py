"""One row for each planned slot, which ends in exactly one state."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest

from configs import StoreError
from storage import Ledger, create_store, ledger_beside
from storage.ledger import LedgerRow

from .ticks import GRID, METRICS, at, tick


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    made = Ledger(ledger_beside(tmp_path / "site.icechunk"))
    yield made
    made.close()


def test_lies_beside_the_store(ledger: Ledger, tmp_path: Path) -> None:
    assert (tmp_path / "ledger.sqlite").is_file()
    assert ledger.rows() == ()
    assert ledger.last() is None
    assert set(ledger.counts()) == {"planned", "taken", "missed", "rejected", "failed"}


def test_a_slot_is_planned_then_settled(ledger: Ledger) -> None:
    for number in (1, 0, 2):
        ledger.plan(at(number))
    ledger.plan(at(1))
    ledger.settle(at(0), "taken", scan=0)
    ledger.settle(at(1), "missed", "no power")
    expected = (LedgerRow(at(0), "taken", "", 0), LedgerRow(at(1), "missed", "no power"), LedgerRow(at(2), "planned"))
    assert ledger.rows() == expected
    assert ledger.rows(at(1), at(1)) == expected[1:2]
    assert ledger.last() == expected[2]
    assert ledger.counts() == {"planned": 1, "taken": 1, "missed": 1, "rejected": 0, "failed": 0}


def test_a_slot_ends_once(ledger: Ledger) -> None:
    ledger.plan(at(0))
    ledger.settle(at(0), "failed", "camera away")
    ledger.settle(at(0), "failed", "said again")
    assert ledger.rows() == (LedgerRow(at(0), "failed", "camera away"),)
    with pytest.raises(StoreError, match="has ended failed: it cannot be taken too"):
        ledger.settle(at(0), "taken")
    ledger.plan(at(0))
    assert ledger.rows()[0].state == "failed"


def test_only_ends_settle(ledger: Ledger) -> None:
    with pytest.raises(ValueError, match="not 'planned'"):
        ledger.settle(at(0), "planned")
    assert ledger.rows() == ()


def test_stores_of_one_folder_do_not_mix(ledger: Ledger, tmp_path: Path) -> None:
    other = Ledger(ledger_beside(tmp_path / "other.icechunk"))
    other.settle(at(0), "missed")
    ledger.settle(at(0), "taken", scan=0)
    assert [row.state for row in other.rows()] == ["missed"]
    assert [row.state for row in ledger.rows()] == ["taken"]
    other.close()


def test_is_there_after_reopening_and_can_be_read_while_written(ledger: Ledger, tmp_path: Path) -> None:
    ledger.settle(at(0), "taken", scan=0)
    reader = Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)
    ledger.settle(at(1), "taken", scan=1)
    assert [row.scan for row in reader.rows()] == [0, 1]
    with pytest.raises(StoreError, match="not written"):
        reader.settle(at(2), "taken")
    reader.close()


def test_syncs_every_row(ledger: Ledger) -> None:
    assert ledger._data.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL
    assert ledger._data.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_kill_between_commit_and_row_is_mended(ledger: Ledger, tmp_path: Path) -> None:
    store = create_store(tmp_path / "site.icechunk", site="x", grid=GRID, metrics=METRICS)
    for number in range(4):
        ledger.plan(at(number))
    ledger.settle(at(0), "taken", scan=store.append(tick(0)))
    ledger.settle(at(1), "failed", "camera away")
    store.append(tick(2))  # killed here
    assert ledger.reconcile(store) == (at(3),)
    assert [(row.state, row.scan) for row in ledger.rows()] == [
        ("taken", 0),
        ("failed", None),
        ("taken", 1),
        ("planned", None),
    ]
    assert ledger.reconcile(store) == (at(3),)
    store.close()


def test_errors_of_a_beginner(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no such ledger"):
        Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)
    with pytest.raises(StoreError, match="cannot be opened as a ledger"):
        Ledger(ledger_beside(tmp_path / "nowhere" / "site.icechunk"))
    (tmp_path / "ledger.sqlite").write_text("no database, a text that is long enough to be looked at " * 10)
    with pytest.raises(StoreError, match="cannot be opened as a ledger"):
        Ledger(ledger_beside(tmp_path / "site.icechunk"))


def test_plain_sqlite_reads_it(ledger: Ledger, tmp_path: Path) -> None:
    ledger.settle(at(0), "taken", scan=0)
    data = sqlite3.connect(tmp_path / "ledger.sqlite")
    assert data.execute("SELECT campaign, state FROM slots").fetchall() == [("site.icechunk", "taken")]
    with pytest.raises(sqlite3.IntegrityError):
        data.execute("INSERT INTO slots (campaign, planned) SELECT campaign, planned FROM slots")
    data.close()
