"""What happened: the events that a store keeps, and those that its writer has yet to take in."""

from __future__ import annotations

from pipelines import Event
from storage import Inbox, Store

__all__ = ["known_events"]


def known_events(store: Store) -> tuple[Event, ...]:
    """Give every event that is known, oldest first."""
    kept = store.events
    # one that is being taken in is in both for a moment
    waiting = [event for _, event in Inbox(store.about.location).waiting() if event not in kept]
    return tuple(sorted((*kept, *waiting), key=lambda event: event.time))
