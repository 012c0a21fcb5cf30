"""MemoryStore: the same promises, kept in memory for one process; for tests and for looking at a video as it comes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from configs import StoreError
from pipelines import Calibration, Event, Frames, Grid, Instant, Measurement, Tick, format_instant
from pipelines.change import NoiseModel

from .layout import SCHEMA
from .order import Place, Tail, place_all
from .packing import Packing
from .series import frame_of
from .store import About, Stored

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["MemoryStore"]


class MemoryStore:
    """A store without a disk: it keeps the values that it is given, and refuses what a store on disk refuses."""

    def __init__(
        self,
        path: str | Path,
        *,
        site: str,
        grid: Grid,
        campaign: str = "",
        campaign_hash: str = "",
        metrics: Mapping[str, str],
        software: str = "",
        created: Instant,
        packing: Packing,
    ) -> None:
        self._facts = (f"memory:{path}", site, grid, campaign, campaign_hash, software)
        self._metrics = dict(metrics)
        self._created = created
        self._packing = packing
        self._tail = Tail()
        self._grid = grid
        self._scans: list[Stored] = []
        self._measured: list[Mapping[str, Measurement]] = []
        self._events: list[Event] = []
        self._calibrations: dict[str, Calibration] = {}
        self._frames: dict[int, Frames] = {}
        self._noise: NoiseModel | None = None
        self._commits = 0
        self._open = True

    def append(self, tick: Tick) -> int | None:
        """Keep one tick; see `Store.append`."""
        return self.append_all([tick])[0]

    def append_all(self, ticks: Sequence[Tick]) -> tuple[int | None, ...]:
        """Keep several ticks, all or none; see `Store.append_all`."""
        if not self._open:
            raise StoreError(f"{self.about.location}: is closed to writing")
        places = place_all(self._tail, ticks, self._grid, self._metrics)
        for tick in ticks:
            if tick.scan is not None:
                self._packing.pack(tick.scan.height, "height")
            if tick.change is not None:
                self._packing.pack(tick.change.dz, "change")
        for tick, where in zip(ticks, places, strict=True):
            self._keep(tick, where)
        self._commits += bool(ticks)
        return tuple(where.number for where in places)

    def _keep(self, tick: Tick, where: Place) -> None:
        if where.number is not None and tick.scan is not None:
            tail = where.tail
            self._scans.append(
                Stored(where.number, tail.epoch, tail.baseline, tick.planned, tick.scan, tick.change, dict(tick.alarms))
            )
            self._measured.append(dict(tick.metrics))
            if tick.frames is not None:
                self._frames[where.number] = tick.frames
        since = tick.frames_since
        if since is not None:
            self._frames = {number: each for number, each in self._frames.items() if each.time >= since}
        self._tail = where.tail
        self._events.extend(where.events)
        if tick.calibration is not None:
            self._calibrations.setdefault(tick.calibration.id, tick.calibration)
        self._noise = tick.noise or self._noise

    def __len__(self) -> int:
        return len(self._scans)

    def __getitem__(self, number: int) -> Stored:
        count = len(self)
        if not -count <= number < count:
            raise IndexError(f"{self.about.location}: there is no scan {number}: it holds {count}")
        return self._scans[number]

    def window(self, first: Instant | None = None, last: Instant | None = None) -> xr.Dataset:
        """Give the scans between two instants; see `Store.window`."""
        import xarray as xr

        from .view import cut

        stored, grid = self._scans, self._grid
        nothing = np.full(grid.shape, np.nan, dtype=np.float32)
        length = {"units": "mm"}

        def cells(arrays: list[np.ndarray], dtype: str, attributes: Mapping[str, str]) -> xr.Variable:
            stack = np.stack(arrays) if arrays else np.empty((0, *grid.shape), dtype)
            return xr.Variable(("time", "y", "x"), stack, attributes)

        scans = [item.scan for item in stored]
        changes = [item.change for item in stored]
        per_scan = {
            "scan": np.array([item.number for item in stored], dtype=np.int64),
            "epoch": np.array([item.epoch for item in stored], dtype=np.int32),
            "planned": np.array([item.planned for item in stored], dtype="datetime64[ns]"),
            "calibration": np.array([scan.calibration_id for scan in scans], dtype=object),
        }
        dataset = xr.Dataset(
            {
                "height": cells([scan.height for scan in scans], "float32", length),
                "sigma": cells([scan.sigma for scan in scans], "float32", length),
                "texture": cells([scan.texture for scan in scans], "uint8", {"units": "1"}),
                "level": cells([scan.level for scan in scans], "uint8", {"units": "1"}),
                "dz": cells([nothing if change is None else change.dz for change in changes], "float32", length),
                "lod": cells([nothing if change is None else change.lod for change in changes], "float32", length),
                **{name: xr.Variable(("time",), values) for name, values in per_scan.items()},
            },
            coords={
                "time": np.array([scan.time for scan in scans], dtype="datetime64[ns]"),
                "y": xr.Variable(("y",), grid.y_mm, length),
                "x": xr.Variable(("x",), grid.x_mm, length),
            },
        )
        return cut(dataset, first, last)

    def series(self) -> pd.DataFrame:
        """Give all metrics; see `Store.series`."""
        nothing = Measurement(np.nan, np.nan)
        columns = {}
        for name in self._metrics:
            measured = [metrics.get(name, nothing) for metrics in self._measured]
            columns[name] = np.array([each.value for each in measured], dtype=np.float64)
            columns[f"{name}_sigma"] = np.array([each.sigma for each in measured], dtype=np.float64)
        times = np.array([item.scan.time for item in self._scans], dtype="datetime64[ns]")
        return frame_of(times, np.arange(len(self), dtype=np.int64), columns, self._metrics)

    @property
    def about(self) -> About:
        """What this store is and what made it."""
        location, site, grid, campaign, campaign_hash, software = self._facts
        snapshot = f"{self._commits} since {format_instant(self._created)}"
        facts = (location, site, grid, campaign, campaign_hash, software, SCHEMA, snapshot)
        return About(*facts, dict(self._metrics), self._packing.step_mm, self._noise)

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, oldest first."""
        return tuple(sorted(self._events, key=lambda event: event.time))

    def calibration(self, calibration_id: str) -> Calibration:
        """Give a calibration that placed some scan. Raises KeyError where there is none of that id."""
        if calibration_id not in self._calibrations:
            raise KeyError(f"{self.about.location}: no calibration {calibration_id!r}")
        return self._calibrations[calibration_id]

    def frames(self, number: int) -> Frames | None:
        """Give the frames that a scan was made of; see `Store.frames`."""
        return self._frames.get(self[number].number)

    def close(self) -> None:
        """Close to writing."""
        self._open = False
