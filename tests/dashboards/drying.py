"""A soil crust that dries, in a store held in memory: small, with holes, alarms and a failed visit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipelines import AlarmChange, Calibration, Change, Event, Frames, Grid, Instant, Motion, Scan, Tick
from pipelines.trends import AlarmState
from storage import About, Stored

if TYPE_CHECKING:
    import xarray as xr

START = np.datetime64("2026-05-04T06:00:00", "ns")
SIX_HOURS = np.timedelta64(6 * 3600 * 10**9, "ns")
UNITS = {
    "net_volume": "mm3",
    "gained_volume": "mm3",
    "lost_volume": "mm3",
    "crack_area": "mm2",
    "crack_opening": "mm",
    "edge_lift": "mm",
}
CAMPAIGN = """
site: {name: "Plot 7, north bank"}
metrics: [net_volume, crack_opening]
alarms:
  - {name: crack opening, metric: crack_opening, warn_above: 0.25, alarm_above: 0.36}
  - {metric: edge_lift, warn_above: 9}
"""


@dataclass
class DryingStore:
    """Keeps what it is given; everything a dashboard may read of a store."""

    about: About
    scans: Sequence[Stored] = ()
    events: tuple[Event, ...] = ()
    table: pd.DataFrame = field(default_factory=pd.DataFrame)

    def append(self, tick: Tick) -> int | None:
        raise NotImplementedError("this store is only read")

    def append_all(self, ticks: Sequence[Tick]) -> tuple[int | None, ...]:
        raise NotImplementedError("this store is only read")

    def __len__(self) -> int:
        return len(self.scans)

    def __getitem__(self, number: int) -> Stored:
        return self.scans[number]

    def window(self, first: Instant | None = None, last: Instant | None = None) -> xr.Dataset:
        raise NotImplementedError("dashboards read scan by scan")

    def series(self) -> pd.DataFrame:
        return self.table

    def calibration(self, calibration_id: str) -> Calibration:
        raise KeyError(calibration_id)

    def frames(self, number: int) -> Frames | None:
        return None

    def close(self) -> None:
        pass


def crust(grid: Grid, dryness: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Height in mm and texture of a crust with one branching crack; `dryness` from 0 to 1."""
    rng = np.random.default_rng(11)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    height = np.zeros(grid.shape)
    for _ in range(40):
        wave, phase = rng.normal(0, 2.2, 2), rng.uniform(0, 2 * np.pi)
        height += 0.012 * np.cos(wave[0] * x + wave[1] * y + phase)
    path = 0.8 * np.sin(0.7 * y) + 0.25 * np.sin(2.3 * y + 1)
    branch = np.where(x > path, np.abs(y - 0.6 * (x - path) - 0.4), 99.0)
    distance = np.minimum(np.abs(x - path), branch)
    width = 0.12 + 0.45 * dryness
    height += 0.22 * dryness * np.exp(-distance / 0.8) - 0.06 * dryness
    depth = 0.5 + 0.4 * dryness
    height -= np.where(distance < width / 2, depth * (1 - (2 * distance / width) ** 2) + 0.22 * dryness, 0.0)
    noise = np.random.default_rng(seed)
    grain = np.random.default_rng(5).normal(0, 12, grid.shape)
    light = np.clip(150 + grain - 55 * dryness * 0.3 - np.where(distance < width / 2, 80, 0), 0, 255)
    return height + noise.normal(0, 0.003, grid.shape), light


def drying_store(
    scans: int = 6, size: int = 120, *, alarm: bool = True, site: str = "Plot 7, north bank", location: str = "memory"
) -> DryingStore:
    """A campaign of `scans` visits every six hours; the third planned visit failed."""
    grid = Grid(size, size, 10.0 / size, -5.0 + 5.0 / size, -5.0 + 5.0 / size)
    kept: list[Stored] = []
    rows: list[dict[str, float]] = []
    times: list[Instant] = []
    events: list[Event] = []
    states: list[AlarmState] = []
    for visit in range(scans + (scans > 3)):
        time = START + visit * SIX_HOURS
        if scans > 3 and visit == 2:
            events.append(Event(time, "failed", "capture failed: frame 17 of 42 is missing"))
            continue
        number = len(kept)
        dryness = 1 - np.exp(-2.5 * number / max(scans - 1, 1))
        height, light = crust(grid, float(dryness), number)
        rng = np.random.default_rng(100 + number)
        holes = rng.random(grid.shape) < 0.001
        x, y = np.meshgrid(grid.x_mm, grid.y_mm)
        holes |= (x - 3.2) ** 2 + (y + 3.0) ** 2 < 0.36
        height[holes] = np.nan
        sigma = np.where(holes, np.nan, 0.004)
        scan = Scan(
            grid,
            time,
            height.astype(np.float32),
            sigma.astype(np.float32),
            light.astype(np.uint8),
            np.where(holes, 255, 0).astype(np.uint8),
            "c0ffee0123456789",
        )
        change = None
        if number:
            base = kept[0].scan
            motion = Motion(np.eye(4), 0.0031 + 0.0002 * number, 0.98, 0.4, 0.0008, 0.003, "good")
            dz = scan.height - base.height
            lod = np.where(np.isfinite(dz), 0.0126, np.nan).astype(np.float32)
            change = Change(grid, base.time, dz, lod, motion)
        opening = 0.45 * dryness
        state: AlarmState = "ok"
        if alarm and opening > 0.36:
            state = "alarm"
        elif alarm and opening > 0.25:
            state = "warning"
        if states and state != states[-1]:
            events.append(AlarmChange(time, "crack opening", states[-1], state, f"{opening:.2f} mm").event)
        states.append(state)
        kept.append(Stored(number, 0, 0, time, scan, change, {"crack opening": state}))
        gained, lost = 7.2 * dryness, 9.6 * dryness
        values = (gained - lost, gained, lost, 2.0 + 7.5 * dryness, opening, 0.19 * dryness)
        sigmas = (0.31, 0.2, 0.22, 0.25, 0.012, 0.006)
        row: dict[str, float] = {"scan": float(number)}
        for name, value, uncertainty in zip(UNITS, values, sigmas, strict=True):
            row[name] = value + rng.normal(0, uncertainty / 2) if number else np.nan
            row[f"{name}_sigma"] = uncertainty if number else np.nan
        rows.append(row)
        times.append(time)
    index = pd.DatetimeIndex(np.array(times, dtype="datetime64[ns]"), name="time", tz="UTC")
    columns = ["scan"] + [part for name in UNITS for part in (name, f"{name}_sigma")]
    table = pd.DataFrame(rows, index=index, columns=columns)
    table.attrs["units"] = dict(UNITS)
    about = About(location, site, grid, CAMPAIGN, "5e1ec7ed", "microrelief 0.1.0", 1, "SNAP0123", dict(UNITS))
    return DryingStore(about, tuple(kept), tuple(events), table)
