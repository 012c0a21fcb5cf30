"""How a campaign stands, from its store and ledger alone: what was taken and missed, what is due, what is in alarm."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from configs import Campaign, ConfigError, StoreError, parse_campaign
from pipelines import AlarmState, Instant, StandingAlarm, format_instant, standing_alarms
from pipelines.trends import worst_state
from storage import (
    Inbox,
    Ledger,
    LedgerAddress,
    LedgerRow,
    Store,
    full_at,
    ledger_beside,
    open_store,
    room_of,
    used_bytes,
    writer_of,
)

from .adaptive import Pace, pace_of
from .clock import seconds_between
from .health_log import HealthLog, Promptness, health_file, promptness
from .loop import ENDED
from .resume import resume_slots
from .scheduler import Slots, grace_of, slots_between

__all__ = ["Standing", "look", "standing_of"]

RECENT = 28
"""So many of the newest slots decide whether a campaign is degraded: a week of visits every six hours."""

PROMPT = 100
"""Over so many of the newest visits is counted what was dropped beside them."""

MANY = 100_000
"""Overdue slots are counted up to here."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How a campaign stands.

    Parameters
    ----------
    site, store : str
    state : str
        ``alarm`` (no data is one too), ``degraded`` (of the newest slots some were missed, rejected or failed, a slot
        is overdue, the disk is almost full, or scans were lost), ``warning``, ``empty`` (no scan yet) or ``ok``.
    running : bool
        Whether a process holds the store for writing.
    scans, missed, rejected, failed : int
        Scans in the store; slots that ended so.
    last, next : Instant or None
        Time of the newest scan; the next slot, None where the schedule is over or not known.
    overdue : int
        Slots whose grace is over and that nobody answered or recorded, since monitoring last ended unexpectedly.
    alarms : mapping of str to str
        Where each stands: after the newest scan, or after the slots since that gave none.
    alarm_words : mapping of str to str
        Of those that are not ok: since when, by which value and rule, and who has acknowledged it.
    disk_bytes, free_bytes : int
    disk_full : Instant or None
        When the disk will be full at this pace; None where that is not known.
    why : str
        What is wrong, in words; empty where nothing is.
    prompt : Promptness or None
        How the newest visits kept their slots; None where nothing is known of them.
    """

    site: str
    store: str
    state: str
    running: bool
    scans: int
    missed: int
    rejected: int
    failed: int
    last: Instant | None
    next: Instant | None
    overdue: int
    alarms: Mapping[str, AlarmState] = field(default_factory=dict)
    alarm_words: Mapping[str, str] = field(default_factory=dict)
    disk_bytes: int = 0
    free_bytes: int = 0
    disk_full: Instant | None = None
    why: str = ""
    prompt: Promptness | None = None

    @property
    def exit_code(self) -> int:
        """3 in alarm, 4 degraded, else 0."""
        return {"alarm": 3, "degraded": 4}.get(self.state, 0)

    def as_mapping(self) -> dict[str, object]:
        """Give it as JSON has it: times as ISO 8601 text, null where there is none."""
        mapping: dict[str, object] = {}
        for name in self.__dataclass_fields__:
            value: object = getattr(self, name)
            mapping[name] = format_instant(value) if isinstance(value, np.datetime64) else value
        if self.prompt is not None:
            told = asdict(self.prompt)
            mapping["prompt"] = {name: None if value != value else value for name, value in told.items()}
        return mapping


def look(path: str | Path, now: Instant, campaign: Campaign | None = None) -> Standing:
    """Look how a store's campaign stands.

    Parameters
    ----------
    path : str or Path
        The store: a folder or ``s3://bucket/prefix``.
    now : Instant
    campaign : Campaign, optional
        Its campaign as it is now; without it, as the store keeps it.

    Raises
    ------
    StoreError
        If there is no store.
    """
    store = open_store(path)
    beside = campaign.store.beside if campaign is not None else None
    if campaign is None:
        campaign = _kept_campaign(store, path)
    rows = _rows(ledger_beside(path, beside))
    counts = {state: sum(row.state == state for row in rows) for state in ("missed", "rejected", "failed")}
    newest = store[-1] if len(store) else None
    running = writer_of(path) is not None
    pace = pace_of(campaign, store) if campaign is not None else None
    coming, overdue = _due(campaign, rows, now, pace, running=running, ended=_ended(store))
    standing = standing_of(store, Inbox(path, beside))
    if campaign is not None:
        standing = _unheard(standing, campaign, rows, overdue, now)
    alarms = {name: alarm.state for name, alarm in standing.items()}
    words = {name: _words(alarm) for name, alarm in standing.items() if alarm.state != "ok"}
    reserve = campaign.store.reserve_mb if campaign is not None else None
    crowded = room_of(path, store.about.grid, len(store), reserve).shortage()
    state, why = _judge(rows, alarms, overdue, crowded or _lost(store, rows), empty=newest is None)
    disk, free, full = _disk(path, store, now)
    return Standing(
        store.about.site, store.about.location, state, running, len(store),
        counts["missed"], counts["rejected"], counts["failed"],
        newest.scan.time if newest is not None else None, coming, overdue, alarms, words, disk, free, full,
        why, promptness(HealthLog(health_file(campaign)).newest(PROMPT)) if campaign is not None else None,
    )  # fmt: skip


def standing_of(store: Store, inbox: Inbox) -> dict[str, StandingAlarm]:
    """Where the alarms of a store stand, with acknowledgements that its writer has yet to take in."""
    newest = store[-1] if len(store) else None
    waiting = tuple(event for _, event in inbox.waiting())
    if newest is None:
        return standing_alarms({}, None, (*store.events, *waiting))
    return standing_alarms(newest.alarms, newest.scan.time, (*store.events, *waiting))


def _unheard(
    standing: dict[str, StandingAlarm], campaign: Campaign, rows: tuple[LedgerRow, ...], overdue: int, now: Instant
) -> dict[str, StandingAlarm]:
    """Slots that nobody answered are no data too, though nobody was there to say so."""
    if not overdue:
        return standing
    since = next((index for index, row in enumerate(reversed(rows)) if row.state == "taken"), len(rows))
    silent = since + overdue
    why = f"{silent} slots in a row without a scan, the last {overdue} of which nobody answered"
    for alarm in campaign.alarms:
        known = standing.get(alarm.name, StandingAlarm(alarm.name, "ok"))
        if silent >= alarm.no_data_after_slots and known.state != "no data":
            standing[alarm.name] = StandingAlarm(alarm.name, "no data", now, why)
    return standing


def _words(alarm: StandingAlarm) -> str:
    parts = [f"since {format_instant(alarm.since)}"] if alarm.since is not None else []
    parts += [alarm.why] if alarm.why else []
    parts.append(
        f"{alarm.acknowledged.told}, {format_instant(alarm.acknowledged.time)}"
        if alarm.acknowledged is not None
        else "not acknowledged"
    )
    return "; ".join(parts)


def _kept_campaign(store: Store, path: str | Path) -> Campaign | None:
    text = store.about.campaign
    if not text:
        return None
    try:
        return parse_campaign(text, f"the campaign in {path}", Path(path).parent if Path(path).is_dir() else Path())
    except ConfigError:  # of another version; what the store says does not hang on it
        return None


def _rows(where: LedgerAddress) -> tuple[LedgerRow, ...]:
    if not where.exists():
        return ()
    ledger = Ledger(where, write=False)
    try:
        return ledger.rows()
    finally:
        ledger.close()


def _ended(store: Store) -> bool:
    """Whether monitoring was last ended on purpose."""
    notes = [event.text for event in store.events if event.kind == "note" and event.text.startswith("monitoring ")]
    return bool(notes) and notes[-1].startswith(ENDED)


def _due(
    campaign: Campaign | None,
    rows: tuple[LedgerRow, ...],
    now: Instant,
    pace: Pace | None,
    *,
    running: bool,
    ended: bool,
) -> tuple[Instant | None, int]:
    """Give the next slot, and how many are overdue."""
    if campaign is None or campaign.schedule.video is not None:
        return None, 0
    slots, last = resume_slots(campaign, rows, now, pace=pace)
    coming = slots.after(now)
    if ended and not running:
        return coming, 0
    return coming, _overdue(campaign, slots, last, now)


def _overdue(campaign: Campaign, slots: Slots, last: Instant, now: Instant) -> int:
    due = list(islice(slots_between(slots, last, now), MANY))
    if due and seconds_between(due[-1], now) <= grace_of(campaign, slots, due[-1]):
        due.pop()
    return len(due)


def _lost(store: Store, rows: tuple[LedgerRow, ...]) -> str:
    """What the store lost since the oldest of the newest slots; empty if nothing."""
    since = rows[-RECENT:][0].planned if rows else None
    lost = [event for event in store.events if event.kind == "lost" and (since is None or event.time >= since)]
    return lost[-1].text if lost else ""


def _judge(
    rows: tuple[LedgerRow, ...], alarms: Mapping[str, AlarmState], overdue: int, trouble: str, *, empty: bool
) -> tuple[str, str]:
    worst = worst_state(alarms.values())
    if worst in ("alarm", "no data"):
        grave = [
            name if state == "alarm" else f"{name} (no data)"
            for name, state in alarms.items()
            if state in ("alarm", "no data")
        ]
        return "alarm", f"in alarm: {', '.join(grave)}"
    bad = [row for row in rows[-RECENT:] if row.state in ("missed", "rejected", "failed")]
    if overdue and not trouble:
        return "degraded", f"{overdue} {'slot is' if overdue == 1 else 'slots are'} overdue and nobody answered"
    if trouble:
        return "degraded", trouble
    if bad:
        text = f"{len(bad)} of the newest {min(len(rows), RECENT)} slots not taken; the last: {bad[-1].state}"
        return "degraded", f"{text} {format_instant(bad[-1].planned)}, {bad[-1].cause}"
    if empty:
        return "empty", "no scan yet"
    if worst == "warning":
        return "warning", ", ".join(f"{name}: {state}" for name, state in alarms.items() if state != "ok")
    return "ok", ""


def _disk(path: str | Path, store: Store, now: Instant) -> tuple[int, int, Instant | None]:
    path = Path(path)
    if not path.is_dir():  # on S3: as much room as is paid for
        return 0, 0, None
    used, free = used_bytes(path), shutil.disk_usage(path).free
    count = len(store)
    full = full_at(now, free, used, store[0].scan.time, store[-1].scan.time, count) if count > 1 else None
    return used, free, full


def is_store(path: Path) -> bool:
    """Whether a path is to be taken as a store: a folder, or no file that could be a campaign."""
    return path.suffix not in (".yaml", ".yml") or path.is_dir()


def no_store(path: str | Path) -> StoreError:
    """Say that a campaign has no store yet."""
    return StoreError(f"{path}: no store yet: `microrelief run` makes it with the first scan")
