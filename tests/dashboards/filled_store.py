"""The drying crust in a real store on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipelines import Measurement, Tick
from storage import create_store

from .drying import UNITS, DryingStore

__all__ = ["fill_store"]


def fill_store(source: DryingStore, path: Path) -> Path:
    """Write every scan and event of `source` to an Icechunk store at `path`."""
    about = source.about
    assert about.grid is not None
    store = create_store(
        path,
        site=about.site,
        grid=about.grid,
        campaign=about.campaign,
        campaign_hash=about.campaign_hash,
        metrics=about.metrics,
        software=about.software,
    )
    try:
        events = list(source.events)
        for stored in source.scans:
            row = source.table.iloc[stored.number]
            measured = {name: Measurement(row[name], row[f"{name}_sigma"]) for name in UNITS if np.isfinite(row[name])}
            now = tuple(event for event in events if event.time <= stored.planned)
            events = events[len(now) :]
            store.append(Tick(stored.planned, stored.scan, stored.change, measured, stored.alarms, now))
        if not source.scans and events:
            for event in events:
                store.append(Tick(event.time, events=(event,)))
    finally:
        store.close()
    return path
