"""``microrelief process``: the pipelines once more over what a store keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import numpy as np
from cyclopts import Parameter

from configs import InputError
from pipelines import parse_instant
from storage import Store, engine, open_store

from ..check import load_checked
from ..clock import RealClock
from ..progress import progress
from ..reprocess import Outcome, campaign_of, rules_of
from ..reprocess import process as work_out
from .reconstruct import read_calibration

__all__ = ["process", "scan_number"]


def process(
    store: str,
    *,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    to: str | None = None,
    campaign: Path | None = None,
    calibration: Path | None = None,
    workers: int = 1,
    scheduler: str | None = None,
) -> int:
    """Work stored scans out again: frames to heights, change, metrics and alarms.

    Scans whose frames are kept (`retain: {raw_frames: all}`) are made again from them; the others keep their heights,
    and their change, metrics and alarms are worked out again. The old results are the newest until all new ones are
    there, and stay readable in the snapshot before. A run that was cut short goes on where it stood when it is started
    again in the same way; one that would change nothing says so.

    Parameters
    ----------
    store
        The store's folder or address.
    from_
        First scan: a number, or a time such as 2026-11-22T21:00:00Z. Without it the first there is.
    to
        Last scan, likewise. Without it the newest.
    campaign
        Campaign file with new settings; without it those that the store keeps.
    calibration
        Use this calibration.json for all scans made again, instead of the one that each was made with.
    workers
        Processes of this machine that share the work (needs the extra `dask`). Results are the same for any number.
    scheduler
        Address of a dask.distributed scheduler whose workers do the work, instead.

    Examples
    --------
    microrelief process site.icechunk --from 2026-11-01T00:00:00Z --workers 4
    microrelief process site.icechunk --campaign site.yaml --scheduler tcp://127.0.0.1:8786
    """
    if workers < 1:
        raise InputError(f"--workers must be at least 1, not {workers}")
    if scheduler is not None and workers != 1:
        raise InputError("--workers and --scheduler exclude each other: choose one")
    file = load_checked(campaign) if campaign is not None else None
    rig = read_calibration(calibration) if calibration is not None else None
    opened = open_store(store, write=True)
    try:
        if not len(opened):
            raise InputError(f"{store}: holds no scan yet")
        settings = file.campaign if file is not None else campaign_of(opened)
        zone = settings.site.zone if settings is not None else "UTC"
        first = scan_number(opened, from_, zone, "--from") if from_ is not None else 0
        last = scan_number(opened, to, zone, "--to") if to is not None else len(opened) - 1
        if first > last:
            raise InputError(f"--from {from_} --to {to}: no scan lies between them")
        rules = rules_of(file.campaign if file is not None else None, opened)
        with engine(workers, scheduler) as spread, progress("processing scans") as step:
            outcome = work_out(
                opened,
                rules,
                spread,
                first=first,
                last=last,
                now=RealClock().now(),
                calibration=rig,
                campaign_text=file.text if file is not None else "",
                step=step,
            )
    finally:
        opened.close()
    print("\n".join(_told(outcome)))
    return 0


def scan_number(store: Store, text: str, zone: str, option: str) -> int:
    """Give a scan's number: that of the first not before a time, or for ``--to`` the last not after it."""
    if text.isdecimal():
        number = int(text)
        if number >= len(store):
            raise InputError(f"{option} {text}: there is no such scan, the newest is {len(store) - 1}")
        return number
    try:
        moment = parse_instant(text, ZoneInfo(zone))
    except ValueError as error:
        raise InputError(f"{option}: {error}, or give a scan's number") from None
    times = store.window()["time"].values
    found = int(np.searchsorted(times, moment, side="left" if option == "--from" else "right"))
    found -= option != "--from"
    if not 0 <= found < len(times):
        raise InputError(f"{option} {text}: no scan lies {'after' if option == '--from' else 'before'} it")
    return found


def _told(outcome: Outcome) -> list[str]:
    span = f"scans {outcome.first} to {outcome.last}"
    if outcome.unchanged:
        return [f"{span}: processed so already, nothing to do"]
    lines = [f"went on at scan {outcome.resumed_at}"] if outcome.resumed_at is not None else []
    lines += [f"{span} processed again, snapshot {outcome.snapshot}"]
    return lines + [f"  {number} {what}" for what, number in outcome.tally.items()]
