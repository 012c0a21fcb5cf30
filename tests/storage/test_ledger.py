"""One row for each planned slot, which ends in exactly one state."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import StoreError
from pipelines import Event, Tick, format_instant
from storage import Ledger, create_store, ledger_beside
from storage.ledger import INTERRUPTED, LedgerRow

from .ticks import GRID, METRICS, at, tick

SECOND = np.timedelta64(1, "s")


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


def test_a_day_of_missed_slots_is_one_transaction(ledger: Ledger, tmp_path: Path) -> None:
    slots = [at(0) + np.timedelta64(second, "s") for second in range(86_400)]
    began, cost = time.process_time(), ledger._data.total_changes
    ledger.settle_all(slots, "missed", "microrelief was not running")
    assert time.process_time() - began < 5
    assert ledger._data.total_changes - cost == 86_400
    assert ledger.counts()["missed"] == 86_400
    assert ledger.rows(slots[-1])[0] == LedgerRow(slots[-1], "missed", "microrelief was not running")
    ledger.settle_all(slots[:2], "missed", "said again")
    assert ledger.rows(last=slots[1])[1].cause == "microrelief was not running"


def test_of_many_slots_all_end_or_none(ledger: Ledger) -> None:
    ledger.settle(at(2), "taken", scan=0)
    with pytest.raises(StoreError, match="has ended taken: it cannot be missed too"):
        ledger.settle_all([at(1), at(2), at(3)], "missed", "off")
    assert [row.planned for row in ledger.rows()] == [at(2)]
    with pytest.raises(ValueError, match="not 'planned'"):
        ledger.settle_all([at(4)], "planned")
    ledger.settle_all([], "missed")
    assert len(ledger.rows()) == 1


def test_a_kill_between_commit_and_row_is_mended(ledger: Ledger, tmp_path: Path) -> None:
    """Each open slot ends as its tick in the store says; one without a tick was missed, and the store is told."""
    store = create_store(tmp_path / "site.icechunk", site="x", grid=GRID, metrics=METRICS)
    for number in range(7):
        ledger.plan(at(number))
    ledger.settle(at(0), "taken", scan=store.append(tick(0)))
    ledger.settle(at(1), "failed", "camera away")
    store.append(tick(2))  # and killed here, each time
    lost = tick(3)
    assert lost.scan is not None
    store.append(replace(lost, events=(Event(lost.scan.time, "rejected", "registration failed: too flat"),)))
    store.append(Tick(at(4), events=(Event(at(4) + SECOND, "failed", "camera away again"),)))
    store.append(Tick(at(5), events=(Event(at(5) + SECOND, "rejected", "no cell was measured"),)))
    settled = ledger.reconcile(store)
    assert settled == (
        LedgerRow(at(2), "taken", "", 1),
        LedgerRow(at(3), "rejected", "registration failed: too flat", 2),
        LedgerRow(at(4), "failed", "camera away again"),
        LedgerRow(at(5), "rejected", "no cell was measured"),
        LedgerRow(at(6), "missed", INTERRUPTED),
    )
    assert ledger.rows()[2:] == settled
    assert store.events[-1].kind == "missed"
    assert store.events[-1].text == f"missed {format_instant(at(6))}: {INTERRUPTED}"
    count = len(store.events)
    assert ledger.reconcile(store) == ()
    assert len(store.events) == count
    store.close()


def test_a_reader_may_come_while_the_file_is_made(tmp_path: Path) -> None:
    """The writer makes the file first and the table then."""
    file = tmp_path / "ledger.sqlite"
    file.touch()
    reader = Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)
    assert (reader.rows(), reader.last(), reader.counts()["taken"]) == ((), None, 0)
    writer = Ledger(ledger_beside(tmp_path / "site.icechunk"))
    writer.settle(at(0), "taken", scan=0)
    assert [row.scan for row in reader.rows()] == [0]
    reader.close()
    writer.close()


def test_another_programs_database_is_no_ledger(tmp_path: Path) -> None:
    data = sqlite3.connect(tmp_path / "ledger.sqlite")
    data.execute("CREATE TABLE invoices (number INTEGER)")
    data.close()
    with pytest.raises(StoreError, match="cannot be opened as a ledger: it has a table invoices, and no slots"):
        Ledger(ledger_beside(tmp_path / "site.icechunk"), write=False)


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
