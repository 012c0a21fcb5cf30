"""Store: the protocol that every store keeps, and the values that it hands out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from configs import InputError, StoreError
from pipelines import Calibration, Change, Event, Grid, Instant, Scan, Tick, instant
from pipelines.trends import AlarmState

from .packing import HeightType, range_mm

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["STORES", "About", "Store", "Stored", "create_store", "open_store"]


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

    Five verbs: ``append``, ``len``, ``[]``, ``window``, ``series``; and three nouns: ``about``, ``events``,
    ``calibration(calibration_id)``.
    """

    def append(self, tick: Tick) -> int | None:
        """Commit one tick as one transaction; return the scan's number, or None where it holds no scan.

        Returns only when the tick is durable. A scan older than the newest is refused.
        """
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

    def close(self) -> None:
        """Let go of the writer's lock, if held."""
        ...


def _icechunk(path: Path, **facts: Any) -> Store:
    from .icechunk_store import IcechunkStore

    return IcechunkStore.create(path, **facts)


def _memory(path: Path, **facts: Any) -> Store:
    from .memory_store import MemoryStore

    return MemoryStore(path, **facts)


STORES: dict[str, Callable[..., Store]] = {"icechunk": _icechunk, "memory": _memory}
"""How to make a store of each kind."""


def create_store(
    path: str | Path,
    *,
    site: str,
    grid: Grid,
    campaign: str = "",
    campaign_hash: str = "",
    metrics: Mapping[str, str] | None = None,
    software: str = "",
    kind: str = "icechunk",
    created: Instant | None = None,
    height_type: HeightType | None = None,
) -> Store:
    """Make a store and hold its writer's lock.

    Parameters
    ----------
    path : str or Path
        A folder that does not exist yet or is empty.
    site : str
    grid : Grid
        The grid of every scan of this store.
    campaign, campaign_hash, software : str
        Provenance: the campaign file's text, the hash of its settings, what made the store.
    metrics : mapping of str to str
        Unit of each metric by name.
    kind : str
        A name of `STORES`.
    created : Instant, optional
        Now, unless given.
    height_type : {"int16", "int32"}, optional
        How heights are packed, in steps of 0.5 um: int16 reaches 16 mm, int32 1 km. Unless given: int16 where the grid
        is no wider and no longer than that reach, int32 elsewhere.

    Raises
    ------
    InputError
        If there is no such kind.
    StoreError
        If there is something at `path`, or it cannot be made.
    """
    if kind not in STORES:
        raise InputError(f"there is no store of kind {kind!r}: choose one of {', '.join(STORES)}")
    if height_type is None:
        widest = max(grid.shape) * grid.pitch_mm
        height_type = "int16" if widest <= 2 * range_mm("int16") else "int32"
    return STORES[kind](
        _local(path),
        site=site,
        grid=grid,
        campaign=campaign,
        campaign_hash=campaign_hash,
        metrics=dict(metrics or {}),
        software=software,
        created=instant(datetime.now(UTC)) if created is None else created,
        height_type=height_type,
    )


def open_store(path: str | Path, *, write: bool = False, metrics: Mapping[str, str] | None = None) -> Store:
    """Open a store: to read (any number of readers) or to write (one, which holds the lock).

    Parameters
    ----------
    path : str or Path
    write : bool
    metrics : mapping of str to str
        Units of metrics that a writer adds where the store does not have them yet.

    Raises
    ------
    StoreError
        If there is no store at `path`, it was made by a newer microrelief, or another writer holds it.
    """
    from .icechunk_store import IcechunkStore

    return IcechunkStore.open(_local(path), write=write, metrics=dict(metrics or {}))


def _local(path: str | Path) -> Path:
    if "://" in str(path):
        raise StoreError(f"{path}: stores on object storage are not supported yet: give a local folder")
    return Path(path)
