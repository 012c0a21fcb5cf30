"""What a person says of a store, handed in: written into it at once, or left for whoever is writing it."""

from __future__ import annotations

from pathlib import Path

from pipelines import Event, Tick
from storage import Inbox, open_store, store_exists, writer_of

from .check import load_checked
from .clock import RealClock
from .standing import is_store, no_store

__all__ = ["addressed", "hand_in"]


def addressed(path: Path) -> tuple[str | Path, Inbox]:
    """Give the store that a path names, itself or by its campaign file, and the inbox beside it.

    Raises
    ------
    StoreError
        If a campaign has no store yet.
    """
    if is_store(path):
        return path, Inbox(path)
    campaign = load_checked(path).campaign
    if not store_exists(campaign.store.path):
        raise no_store(campaign.store.path)
    return campaign.store.path, Inbox(campaign.store.path, campaign.store.beside)


def hand_in(store: str | Path, event: Event, inbox: Inbox) -> str:
    """Keep an event in a store; give what to add to the answer: nothing, or that its writer has yet to take it in."""
    if writer_of(store) is None:
        opened = open_store(store, write=True)
        try:
            opened.append(Tick(max(event.time, RealClock().now()), events=(event,)))
        finally:
            opened.close()
        return ""
    inbox.put(event)
    return "; the running monitoring takes it into the store with its next visit"
