"""Where a campaign goes on: its slots, and the newest one that has been dealt with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from configs import Campaign
from pipelines import Instant
from storage import Ledger, LedgerRow, ledger_beside

from .adaptive import Pace, PacedSlots, paced_slots
from .scheduler import OnceSlots, Slots, make_slots

__all__ = ["resume_point", "resume_slots"]

NANOSECOND = np.timedelta64(1, "ns")


def resume_point(campaign: Campaign, now: Instant) -> tuple[Slots, Instant]:
    """Give a campaign's slots, and the newest one that has been dealt with; changes nothing."""
    beside = ledger_beside(campaign.store.path, campaign.store.beside)
    if not beside.exists():
        return resume_slots(campaign, (), now)
    ledger = Ledger(beside, write=False)
    try:
        return resume_slots(campaign, ledger.rows(), now)
    finally:
        ledger.close()


def resume_slots(
    campaign: Campaign, known: Sequence[LedgerRow], now: Instant, once: bool = False, pace: Pace | None = None
) -> tuple[Slots, Instant]:
    """Give the slots, and the newest one that has been dealt with, so that a restart stays on the same grid."""
    if once:
        return OnceSlots(now), now - NANOSECOND
    if campaign.schedule.video is not None:
        anchor = now.astype("datetime64[ms]").astype("datetime64[ns]")
        return make_slots(campaign, anchor), anchor - NANOSECOND
    rows = [row.planned for row in known]
    anchor = min(rows, default=_whole_second(now))
    slots = paced_slots(campaign, anchor, pace)
    for planned in sorted(rows, reverse=True):  # a single `microrelief scan` between two slots is none of them
        if slots.holds(planned) if isinstance(slots, PacedSlots) else slots.after(planned - NANOSECOND) == planned:
            return slots, planned
    return slots, min(anchor, now) - NANOSECOND


def _whole_second(moment: Instant) -> Instant:
    whole: Instant = moment.astype("datetime64[s]").astype("datetime64[ns]")
    return whole
