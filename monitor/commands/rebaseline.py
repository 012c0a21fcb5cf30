"""The command `rebaseline`."""

from __future__ import annotations

from configs import InputError
from storage import engine, open_store

from ..clock import RealClock
from ..progress import progress
from ..reprocess import campaign_of, process, rules_of

__all__ = ["rebaseline"]


def rebaseline(store: str, *, scan: int) -> int:
    """Begin a new epoch: compare a scan's followers with it instead of with the baseline they had.

    For a first scan that was taken too early, or a sample that was put back another way. Heights stay to the bit;
    change, metrics and alarms of the scans after it are worked out again, and the store says so. The old results stay
    readable in the snapshot before. Stop the campaign meanwhile; it then goes on with the new baseline.

    Parameters
    ----------
    store
        The store's folder or address.
    scan
        Number of the scan that becomes the baseline; negative numbers count from the newest.

    Examples
    --------
    microrelief rebaseline site.icechunk --scan 3
    """
    opened = open_store(store, write=True)
    try:
        count = len(opened)
        number = scan + count if scan < 0 else scan
        if not 0 <= number < count:
            newest = f"the newest is {count - 1}" if count else "it holds none yet"
            raise InputError(f"--scan {scan}: {store} has no such scan, {newest}")
        if opened[number].baseline == number:
            raise InputError(f"--scan {scan}: scan {number} is the baseline of its epoch already: nothing to do")
        rules = rules_of(campaign_of(opened), opened)
        with engine(1) as spread, progress("comparing scans") as step:
            outcome = process(
                opened, rules, spread, first=number, last=number, now=RealClock().now(), baseline=True, step=step
            )
        epoch = opened[number].epoch
    finally:
        opened.close()
    compared = sum(outcome.tally.values()) - 1
    print(f"epoch {epoch} begins at scan {number}, its baseline; {compared} later scans worked out again")
    print(f"  the results before are in the snapshot before {outcome.snapshot}")
    return 0
