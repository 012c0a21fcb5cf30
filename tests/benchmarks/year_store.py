"""A long campaign on the disk for the benchmarks of dashboards: made once, then kept in the temporary folder."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from pipelines import Change, Measurement, Tick
from pipelines.change import METRICS
from storage import create_store
from tests.dashboards.drying import CAMPAIGN, SIX_HOURS, START, drying_store

__all__ = ["A_DAY", "year_store"]

A_DAY = 4
"""Scans a day, each day in a commit of its own."""

NAMES = (
    *("net_volume", "gained_volume", "lost_volume", "crack_area", "crack_length", "crack_opening", "edge_lift"),
    *("crack_depth", "crack_volume", "curl_angle", "plate_lift_largest", "covered"),
)


def year_store(scans: int, size: int) -> Path:
    """Give the store of so many scans of `size` x `size` cells; the first call makes it, 540 of 1000 in two minutes."""
    path = Path(tempfile.gettempdir()) / f"microrelief-bench-{scans}x{size}.icechunk"
    if not path.exists():
        draft = path.with_name(f"{path.name}.part")
        shutil.rmtree(draft, ignore_errors=True)
        _make(draft, scans, size)
        draft.rename(path)
    return path


def _make(path: Path, scans: int, size: int) -> None:
    ticks = _ticks(scans, size)
    units = {name: METRICS[name].unit for name in NAMES}
    grid = drying_store(1, size).about.grid
    assert grid is not None
    store = create_store(path, site="Bench", grid=grid, campaign=CAMPAIGN, metrics=units)
    try:
        while day := list(islice(ticks, A_DAY)):
            store.append_all(day)
    finally:
        store.close()


def _ticks(scans: int, size: int) -> Iterator[Tick]:
    """A crust that dries through four states, with fresh noise in every scan and a dozen metrics."""
    states = drying_store(4, size).scans
    midnight = START.astype("datetime64[D]").astype("datetime64[ns]")
    base = replace(states[0].scan, time=midnight)
    noise = np.random.default_rng(1).normal(0, 0.003, base.height.shape).astype(np.float32)
    for number in range(scans):
        state = states[min(4 * number // scans, 3)]
        time = midnight + number * SIX_HOURS
        height = state.scan.height + np.roll(noise, number, axis=1)
        scan = replace(state.scan, time=time, height=height)
        change, values = None, {}
        if number:
            dz = height - base.height
            assert states[-1].change is not None
            lod = np.where(np.isfinite(dz), 0.0126, np.nan).astype(np.float32)
            change = Change(scan.grid, midnight, dz, lod, states[-1].change.motion)
            wobble = np.random.default_rng(number).normal(0, 0.05, len(NAMES))
            values = {
                name: Measurement(1 - np.exp(-3 * number / scans) + off, 0.05)
                for name, off in zip(NAMES, wobble, strict=True)
            }
        yield Tick(time, scan, change, values, {"crack opening": "ok"})
