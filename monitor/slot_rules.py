"""Slot rules: of the slots that are due, which one is answered, and why each of the others is missed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, groupby, islice
from typing import Literal

import numpy as np

from configs import Campaign
from pipelines import Instant

from .clock import seconds_between
from .scheduler import Slots, last_slot, slots_between

__all__ = ["ASLEEP", "MOST_LISTED", "NOT_RUNNING", "RUNNING", "Answer", "Gap", "SlotRules", "answer", "slot_rules_of"]

RUNNING = "previous scan still running"
NOT_RUNNING = "microrelief was not running"
ASLEEP = "the machine slept, or its clock was set forward"

NANOSECOND = np.timedelta64(1, "ns")
MOST_LISTED = 5000
"""A gap of more slots is told as a span: a clock that was set forward by a year passed millions of short slots."""


@dataclass(frozen=True, slots=True)
class SlotRules:
    """A campaign's rules for slots that cannot all be kept.

    Parameters
    ----------
    catch_up : {"newest", "none"}
        After a start or a gap: take the newest due slot within its grace, or wait for the next.
    overlap : {"wait", "skip"}
        A slot that came due while a visit ran, or in video while too many scans were under way: taken after it, within
        its grace, or missed.
    overrun_s : float or None
        A visit that takes longer is noted.
    """

    catch_up: Literal["newest", "none"] = "newest"
    overlap: Literal["wait", "skip"] = "wait"
    overrun_s: float | None = None


@dataclass(frozen=True, slots=True)
class Gap:
    """Slots in a row that were missed for one cause; where they are too many to list, `last` is the end of the span."""

    cause: str
    slots: tuple[Instant, ...]
    last: Instant
    more: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """The slot to take, if any, and the gaps before it."""

    take: Instant | None
    gaps: tuple[Gap, ...] = ()


def answer(
    slots: Slots,
    slot: Instant,
    now: Instant,
    *,
    started: Instant,
    busy_until: Instant,
    grace: Callable[[Instant], float],
    rules: SlotRules,
    busy: str = RUNNING,
) -> Answer:
    """Of all slots that are due, take the newest where the rules allow it; the others are missed.

    Parameters
    ----------
    slots, slot, now
        All slots, the oldest that is due, and the time.
    started, busy_until : Instant
        When this run began, and until when no visit could begin.
    grace : callable
        How late a slot's visit may begin, s.
    rules : SlotRules
    busy : str
        Why none could begin until then: the cause of slots that came due before.
    """

    def cause(missed: Instant) -> str:
        if missed < started:
            return NOT_RUNNING
        return busy if missed <= busy_until else ASLEEP

    due = list(islice(chain([slot], slots_between(slots, slot, now)), MOST_LISTED + 1))
    newest = due[-1]
    more = len(due) > MOST_LISTED
    if more:
        newest = last_slot(slots, due[-1], now) or due[-1]
        due = [*due[:MOST_LISTED], newest]
    why, alone = cause(newest), len(due) == 1
    take = seconds_between(newest, now) <= grace(newest)
    if why == busy:
        take = take and rules.overlap == "wait"
    elif why == NOT_RUNNING or not alone:
        take = take and rules.catch_up == "newest"
    missed = due[:-1] if take else due
    gaps = []
    for each, group in groupby(missed, cause):
        members = tuple(group)
        gaps.append(Gap(each, members, members[-1]))
    if more:
        end = (last_slot(slots, due[-2], newest - NANOSECOND) or due[-2]) if take else newest
        gaps[-1] = Gap(gaps[-1].cause, gaps[-1].slots, end, more=True)
    return Answer(newest if take else None, tuple(gaps))


def slot_rules_of(campaign: Campaign) -> SlotRules:
    """Give a campaign's rules."""
    schedule = campaign.schedule
    overrun_s = schedule.overrun.total_seconds() if schedule.overrun is not None else None
    return SlotRules(schedule.catch_up, schedule.overlap, overrun_s)
