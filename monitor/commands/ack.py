"""The command `ack`."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from configs import InputError, did_you_mean
from pipelines import Acknowledgement, Instant, StandingAlarm, format_instant
from storage import Inbox, open_store

from ..clock import RealClock
from ..hand_in import addressed, hand_in
from ..standing import standing_of

__all__ = ["ack"]


def ack(path: Path, alarm: str, *, note: str = "", by: Annotated[str | None, Parameter(negative="")] = None) -> int:
    """Acknowledge an alarm: say, in the store, that somebody has seen it.

    It holds for the present exceedance. An alarm that clears and comes back, or becomes graver, needs a new one. While
    `microrelief run` writes the store, it takes the acknowledgement in with its next visit; `status`, `report` and
    `review` show it at once.

    Parameters
    ----------
    path
        Store (a folder or s3://bucket/prefix), or campaign file.
    alarm
        Its name in the campaign.
    note
        What was found or done.
    by
        Who; without it the name of this computer's user.

    Examples
    --------
    microrelief ack soil.icechunk "wide cracks" --by Ann --note "sealed on Monday"
    """
    store, inbox = addressed(path)
    who = by if by is not None else getpass.getuser()
    now = RealClock().now()
    standing = standing_of(open_store(store), inbox)
    if alarm not in standing:
        known = list(standing)
        raise InputError(f"{store}: no alarm {alarm!r}{did_you_mean(alarm, known) if known else ': it has none'}")
    print(_acknowledged(store, standing[alarm], who, note, now, inbox))
    return 0


def _acknowledged(store: str | Path, alarm: StandingAlarm, by: str, note: str, now: Instant, inbox: Inbox) -> str:
    if alarm.state == "ok":
        raise InputError(f"{store}: {alarm.name} is ok: there is nothing to acknowledge")
    # never before what it answers, whatever this computer's clock says
    time = now if alarm.since is None else max(now, alarm.since + np.timedelta64(1, "ns"))
    try:
        event = Acknowledgement(time, alarm.name, by, " ".join(note.split())).event
    except ValueError as error:
        raise InputError(f"--by {by}: {error}") from None
    since = f" since {format_instant(alarm.since)}" if alarm.since is not None else ""
    told = f"acknowledged {alarm.name}: {alarm.state}{since}"
    return told + hand_in(store, event, inbox)
