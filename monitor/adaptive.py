"""Adaptive rate: an alarm makes the visits dense, calm makes them rare, between bounds and on one grid of times."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from configs import Adaptive, Campaign, format_duration
from pipelines import AlarmState, Instant
from storage import Store

from .scheduler import Slots, make_slots
from .settled import Settled

__all__ = ["Pace", "PacedSlots", "exciting", "level_of", "pace_of", "paced_slots", "quiet_scans"]

NANOSECOND = np.timedelta64(1, "ns")


def exciting(alarms: Mapping[str, AlarmState], rule: Adaptive) -> bool:
    """Whether a scan with these alarms asks for a higher rate. No data does not: it excites people, not the soil."""
    raised = ("alarm",) if rule.raise_on == "alarm" else ("warning", "alarm")
    return any(state in raised for name, state in alarms.items() if not rule.alarms or name in rule.alarms)


def level_of(quiet: int, rule: Adaptive) -> int:
    """Give the rate's level, 0 burst, 1 usual, 2 calm, after so many scans in a row without cause.

    Each level holds for `calm_after` scans: an exciting scan leads to a burst at once, calm down a step at a time.
    """
    return min(quiet // rule.calm_after, 2 if rule.calm is not None else 1)


def quiet_scans(store: Store, rule: Adaptive) -> int:
    """Count the scans since the last exciting one. A store that never had one begins at the usual rate."""
    count = len(store)
    for quiet in range(min(count, 2 * rule.calm_after)):  # calm for longer is no calmer
        if exciting(store[count - 1 - quiet].alarms, rule):
            return quiet
    return count + rule.calm_after


@dataclass(slots=True)
class Pace:
    """Where the rate of a campaign stands; goes along with its run.

    Parameters
    ----------
    rule : Adaptive
    every : timedelta
        The usual interval.
    quiet : int
        Scans in a row without cause, as `quiet_scans` counts them.
    """

    rule: Adaptive
    every: timedelta
    quiet: int

    @property
    def level(self) -> int:
        """0 burst, 1 usual, 2 calm."""
        return level_of(self.quiet, self.rule)

    @property
    def interval(self) -> timedelta:
        """The present interval."""
        return (self.rule.burst, self.every, self.rule.calm or self.every)[self.level]

    def settled(self, settled: Settled) -> Sequence[str]:
        """Take a visit into account; say how the rate changed. A visit without a stored scan changes nothing."""
        tick = settled.tick
        if settled.number is None or tick is None or tick.scan is None:
            return ()
        before, self.quiet = self.level, 0 if exciting(tick.alarms, self.rule) else self.quiet + 1
        if self.level == before:
            return ()
        if self.level < before:
            raised = [f"{name}: {state}" for name, state in tick.alarms.items() if exciting({name: state}, self.rule)]
            return (f"rate raised to a scan every {format_duration(self.interval)}: {', '.join(raised)}",)
        calm = f"{self.rule.calm_after} scans in a row without cause"
        return (f"rate lowered to a scan every {format_duration(self.interval)}: {calm}",)

    def close(self) -> None:
        """Nothing is held."""


def pace_of(campaign: Campaign, store: Store) -> Pace | None:
    """Give where a campaign's rate stands by its store; None where it does not follow the alarms."""
    rule, every = campaign.schedule.adaptive, campaign.schedule.every
    if rule is None or every is None:
        return None
    return Pace(rule, every, quiet_scans(store, rule))


@dataclass(frozen=True, slots=True)
class PacedSlots:
    """Slots at the rate that `pace` says now; those of each level are among those of the faster one."""

    levels: tuple[Slots, ...]
    pace: Callable[[], int]

    def after(self, moment: Instant) -> Instant | None:
        """Give the first slot of the present rate later than `moment`; None when the schedule is over."""
        return self.levels[min(self.pace(), len(self.levels) - 1)].after(moment)

    def holds(self, moment: Instant) -> bool:
        """Whether a moment is a slot at some rate."""
        return self.levels[0].after(moment - NANOSECOND) == moment


def paced_slots(campaign: Campaign, anchor: Instant, pace: Pace | None) -> Slots:
    """Give a campaign's slots; with an adaptive rate at the level of `pace`, the usual one without it."""
    rule = campaign.schedule.adaptive
    if rule is None:
        return make_slots(campaign, anchor)
    every = campaign.schedule.every
    levels = tuple(
        make_slots(
            campaign.model_copy(update={"schedule": campaign.schedule.model_copy(update={"every": length})}), anchor
        )
        for length in (rule.burst, every, rule.calm)
        if length is not None
    )
    return PacedSlots(levels, lambda: pace.level if pace is not None else 1)
