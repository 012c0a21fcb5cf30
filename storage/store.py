"""Store: the protocol that every store keeps, and the values that it hands out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from pipelines import Calibration, Change, Event, Frames, Grid, Instant, Scan, Tick
from pipelines.change import NoiseModel
from pipelines.trends import AlarmState

from .packing import STEP_MM

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["About", "Store", "Stored"]


@dataclass(frozen=True, slots=True)
class About:
    """What a store is: whose, on which grid, made by what.

    `campaign` is the campaign file's text, `campaign_hash` the hash of its settings, `snapshot` the store's newest
    snapshot when it was opened or last written (any derived number is traced by it).
    """

    location: str
    site: str
    grid: Grid | None
    campaign: str
    campaign_hash: str
    software: str
    schema: int
    snapshot: str
    metrics: dict[str, str] = field(default_factory=dict)
    """Unit of each metric by name."""
    step_mm: float = STEP_MM
    """What stored heights are rounded to."""
    noise: NoiseModel | None = None
    """The newest noise model of repeat scans, if any was kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """One scan as the store keeps it.

    `number` counts from 0; `epoch` grows where the calibration or the baseline changed; `baseline` is the number of the
    scan that `change` was measured against (its own number for a baseline, whose `change` is None).
    """

    number: int
    epoch: int
    baseline: int
    planned: Instant
    scan: Scan
    change: Change | None
    alarms: dict[str, AlarmState]


@runtime_checkable
class Store(Protocol):
    """Keeps ticks in the order of their time. One writer, any number of readers.

    Five verbs: ``append`` (one tick, or ``append_all`` of them), ``len``, ``[]``, ``window``, ``series``; and four
    nouns: ``about``, ``events``, ``calibration(calibration_id)``, ``frames(number)``.
    """

    def append(self, tick: Tick) -> int | None:
        """Commit one tick as one transaction; return the scan's number, or None where it holds no scan.

        Returns only when the tick is durable. A scan older than the newest is refused.
        """
        ...

    def append_all(self, ticks: Sequence[Tick]) -> tuple[int | None, ...]:
        """Commit several ticks as one transaction, all or none; return their scans' numbers as `append` does."""
        ...

    def __len__(self) -> int:
        """Count the scans."""
        ...

    def __getitem__(self, number: int) -> Stored:
        """Read one scan; negative numbers count from the end. Raises IndexError beyond either end."""
        ...

    def window(self, first: Instant | None = None, last: Instant | None = None) -> xr.Dataset:
        """Give the scans between two instants (both included), lazily.

        Dimensions time, y, x; coordinates in UTC and mm; variables height, sigma, texture, level, dz, lod and
        per scan number, epoch, planned, calibration.
        """
        ...

    def series(self) -> pd.DataFrame:
        """Give all metrics: index ``time`` (UTC), column ``scan``, and ``NAME`` and ``NAME_sigma`` per metric.

        ``attrs["units"]`` maps each metric's name to its unit.
        """
        ...

    @property
    def about(self) -> About:
        """What this store is and what made it."""
        ...

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, oldest first."""
        ...

    def calibration(self, calibration_id: str) -> Calibration:
        """Give a calibration that placed some scan. Raises KeyError where there is none of that id."""
        ...

    def frames(self, number: int) -> Frames | None:
        """Give the frames that a scan was made of; None where they were not kept, or were let go since.

        Raises IndexError beyond either end.
        """
        ...

    def close(self) -> None:
        """Let go of the writer's lock, if held."""
        ...
