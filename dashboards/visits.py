"""Planned visits and what became of each: the ledger beside a store, or what the store itself remembers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipelines import Instant
from storage import Ledger, Store, ledger_beside, scan_table

__all__ = ["Visit", "visits"]

_FAILURES = ("failed", "missed", "rejected")


@dataclass(frozen=True, slots=True)
class Visit:
    """One slot of the schedule.

    `state` is ``taken``, ``missed``, ``rejected`` or ``failed``; `cause` says why where it is not taken.
    """

    planned: Instant
    state: str
    cause: str = ""


def visits(store: Store, planned: Sequence[Instant] | None = None) -> tuple[Visit, ...]:
    """Give every settled visit, oldest first.

    Read from the ledger where there is one beside the store; else from the scans' planned times and the failures
    among the events.

    Parameters
    ----------
    store : Store
    planned : sequence of Instant, optional
        The planned times of all scans, where the caller has read them already.
    """
    kept = _from_ledger(store)
    if kept is not None:
        return kept
    found = [Visit(moment, "taken") for moment in (planned if planned is not None else _planned(store))]
    found += [Visit(event.time, event.kind, event.text) for event in store.events if event.kind in _FAILURES]
    return tuple(sorted(found, key=lambda visit: visit.planned))


def _planned(store: Store) -> list[Instant]:
    return list(scan_table(store).planned)


def _from_ledger(store: Store) -> tuple[Visit, ...] | None:
    """Read the ledger, or give None where there is none: a store in a bucket, in memory, or copied without it."""
    address = ledger_beside(store.about.location)
    if not address.exists():
        return None
    ledger = Ledger(address, write=False)
    try:
        rows = ledger.rows()
    finally:
        ledger.close()
    return tuple(Visit(row.planned, row.state, row.cause) for row in rows if row.state != "planned") or None
