"""AlarmChange and Acknowledgement: what is told of an alarm, as a value and as the event that a store keeps of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .instant import Instant
from .tick import Event
from .trends import ALARM_STATES, AlarmState

__all__ = ["Acknowledgement", "AlarmChange", "StandingAlarm", "acknowledgements", "alarm_changes", "standing_alarms"]

_STATE = "|".join(ALARM_STATES)
_CHANGE = re.compile(rf"(?P<name>.+?): (?P<before>{_STATE}) -> (?P<after>{_STATE})(?:, (?P<why>.*))?", re.DOTALL)
_ACKNOWLEDGED = re.compile(r"(?P<name>.+?): acknowledged(?: by (?P<by>[^:]*))?(?:: (?P<note>.*))?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """An alarm that has changed its state.

    Parameters
    ----------
    time : Instant
    name : str
        The campaign's name of the alarm.
    before, after : {"ok", "warning", "alarm", "no data"}
    why : str
        Value, standard uncertainty, limit and the words of the rule.
    """

    time: Instant
    name: str
    before: AlarmState
    after: AlarmState
    why: str = ""

    @property
    def event(self) -> Event:
        """What the store keeps."""
        told = f", {self.why}" if self.why else ""
        return Event(self.time, "alarm", f"{self.name}: {self.before} -> {self.after}{told}")


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Somebody has seen an alarm and says so; `by` and `note` may be empty."""

    time: Instant
    name: str
    by: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        if ":" in self.by:
            raise ValueError(f"a name has no colon: {self.by!r}")

    @property
    def event(self) -> Event:
        """What the store keeps."""
        by = f" by {self.by}" if self.by else ""
        note = f": {self.note}" if self.note else ""
        return Event(self.time, "acknowledged", f"{self.name}: acknowledged{by}{note}")

    @property
    def told(self) -> str:
        """Who and what, without the alarm's name."""
        return self.event.text.removeprefix(f"{self.name}: ")


@dataclass(frozen=True, slots=True)
class StandingAlarm:
    """Where an alarm stands now.

    Parameters
    ----------
    name : str
    state : {"ok", "warning", "alarm", "no data"}
    since : Instant or None
        When it came to that; None where it has never been anything else.
    why : str
        The words of that change.
    acknowledged : Acknowledgement or None
        Of the present exceedance, as grave as it is now: one that has cleared since, or has become graver, needs a new
        acknowledgement.
    """

    name: str
    state: AlarmState
    since: Instant | None = None
    why: str = ""
    acknowledged: Acknowledgement | None = None


def alarm_changes(events: Iterable[Event]) -> tuple[AlarmChange, ...]:
    """Find the changes of alarms among events, such as a tick's or a store's, in their order."""
    found = []
    for event in events:
        match = _CHANGE.fullmatch(event.text) if event.kind == "alarm" else None
        if match is not None:
            found.append(AlarmChange(event.time, **_texts(match)))  # type: ignore[arg-type] # the states matched
    return tuple(found)


def acknowledgements(events: Iterable[Event]) -> tuple[Acknowledgement, ...]:
    """Find the acknowledgements among events, in their order."""
    found = []
    for event in events:
        match = _ACKNOWLEDGED.fullmatch(event.text) if event.kind == "acknowledged" else None
        if match is not None:
            found.append(Acknowledgement(event.time, **_texts(match)))
    return tuple(found)


def _texts(match: re.Match[str]) -> dict[str, str]:
    return {name: text or "" for name, text in match.groupdict().items()}


def standing_alarms(
    newest: Mapping[str, AlarmState], newest_time: Instant | None, events: Iterable[Event]
) -> dict[str, StandingAlarm]:
    """Tell where the alarms of a store stand.

    Parameters
    ----------
    newest : mapping of str to AlarmState
        As the newest scan has them.
    newest_time : Instant or None
        Of the newest scan: what changed after it, such as to "no data", goes beyond it.
    events : iterable of Event
        The store's, oldest first.

    Returns
    -------
    dict of str to StandingAlarm
        Alarms of the newest scan, in their order, and such as were only told of since.
    """
    events = tuple(events)
    told: list[AlarmChange | Acknowledgement] = [*alarm_changes(events), *acknowledgements(events)]
    told.sort(key=lambda each: each.time)
    standing = {name: StandingAlarm(name, "ok") for name in newest}
    for each in told:
        known = standing.get(each.name)
        if isinstance(each, Acknowledgement):
            if known is not None and known.state != "ok":
                standing[each.name] = StandingAlarm(known.name, known.state, known.since, known.why, each)
        elif known is not None or newest_time is None or each.time > newest_time:
            seen = known.acknowledged if known is not None and _covered(known.state, each.after) else None
            standing[each.name] = StandingAlarm(each.name, each.after, each.time, each.why, seen)
    for (
        name,
        state,
    ) in newest.items():  # the scan's own word counts, where its events were lost or are of an old version
        known = standing[name]
        if known.state != state and not (
            known.since is not None and newest_time is not None and known.since > newest_time
        ):
            standing[name] = StandingAlarm(name, state)
    return standing


def _covered(before: AlarmState, after: AlarmState) -> bool:
    """Whether who has seen the state before has seen the one after too."""
    return after != "ok" and ALARM_STATES.index(after) <= ALARM_STATES.index(before)
