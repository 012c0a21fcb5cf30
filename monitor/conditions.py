"""Conditions: what people are to be told of a campaign, when it begins and when it is over; pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from configs import Condition, Notify, format_duration
from pipelines import Instant, format_instant

from .settled import Settled

__all__ = ["Message", "Standing", "changes", "observed"]


@dataclass(frozen=True, slots=True)
class Standing:
    """A condition that stands.

    Parameters
    ----------
    kind : Condition
    what : str
        Which one of its kind: an alarm's name; empty where there is one only.
    detail : str
        In words.
    since, told : Instant
        When it began, and when people were last told of it.
    """

    kind: Condition
    what: str
    detail: str
    since: Instant
    told: Instant

    @property
    def key(self) -> str:
        """What tells it from others."""
        return f"{self.kind}: {self.what}" if self.what else self.kind


@dataclass(frozen=True, slots=True)
class Message:
    """What is sent: a title and a text."""

    title: str
    body: str


def observed(
    standing: Iterable[Standing], settled: Settled, now: Instant, *, row: int, rule: Notify, disk: str
) -> tuple[Standing, ...]:
    """Say which conditions stand after a slot, of those before it and of new ones.

    Parameters
    ----------
    standing : iterable of Standing
    settled : Settled
    now : Instant
    row : int
        How many slots in a row gave no scan, this one among them.
    rule : Notify
    disk : str
        Why the disk is filling; empty where it is not.
    """
    before = {each.key: each for each in standing}
    found: list[tuple[Condition, str, str]] = []
    tick = settled.tick
    if tick is not None and tick.scan is not None and settled.number is not None:
        told = {event.text.partition(":")[0]: event.text for event in tick.events if event.kind == "alarm"}
        for name, state in tick.alarms.items():
            if state in ("alarm", "no data"):
                kind: Condition = "alarm" if state == "alarm" else "no data"
                old = before.get(f"{kind}: {name}")
                found.append((kind, name, told.get(name) or (old.detail if old is not None else f"{name}: {state}")))
    else:  # no scan says nothing of the surface: what stood of it stands
        found += [(each.kind, each.what, each.detail) for each in before.values() if each.kind in ("alarm", "no data")]
    if settled.unavailable or (settled.state == "missed" and "device gone" in before):
        cause = settled.cause if settled.unavailable else before["device gone"].detail
        found.append(("device gone", "", cause))
    if disk:
        found.append(("disk filling", "", disk))
    if row >= rule.after:
        found.append(
            ("not taken", "", f"{row} slots in a row gave no scan; the last: {settled.state}, {settled.cause}")
        )
    stands = []
    for kind, what, detail in found:
        if kind in rule.on:
            fresh = Standing(kind, what, detail, now, now)
            old = before.get(fresh.key)
            stands.append(fresh if old is None else Standing(kind, what, detail, old.since, old.told))
    return tuple(stands)


def changes(
    before: Iterable[Standing], after: Iterable[Standing], now: Instant, site: str, remind: timedelta | None
) -> tuple[tuple[Message, ...], tuple[Standing, ...]]:
    """Say what to tell: each beginning and each end once, and again after `remind`; and what then stands."""
    old: Mapping[str, Standing] = {each.key: each for each in before}
    new: Mapping[str, Standing] = {each.key: each for each in after}
    messages, stands = [], []
    for key, each in new.items():
        due = remind is not None and now - each.told >= np.timedelta64(remind)
        if key not in old:
            messages.append(Message(f"{site}: {key}", f"{each.detail}\nsince {format_instant(each.since)}"))
            each = Standing(each.kind, each.what, each.detail, each.since, now)
        elif due:
            messages.append(Message(f"{site}: still {key}", f"{each.detail}\nsince {format_instant(each.since)}"))
            each = Standing(each.kind, each.what, each.detail, each.since, now)
        stands.append(each)
    for key, each in old.items():
        if key not in new:
            lasted = timedelta(seconds=max(1, round(float((now - each.since) / np.timedelta64(1, "s")))))
            body = f"over since {format_instant(now)}, it lasted {format_duration(lasted)}"
            messages.append(Message(f"{site}: back to normal, {key}", body))
    return tuple(messages), tuple(stands)
