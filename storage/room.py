"""Room on the disk: what a store takes, when the disk will be full, and the reserve that scans must leave free."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines import Grid, Instant

from .folder import Folder

__all__ = ["BYTES_PER_CELL", "Room", "full_at", "reserve_bytes", "room_of", "used_bytes"]

BYTES_PER_CELL = 4.0
"""A stored scan with its change, compressed: 2.8 to 3.8 were measured on the simulated soil."""

RESERVE_BYTES = 500e6
RESERVE_SCANS = 10
LEAST_SCANS = 2
PART_OF_DISK = 0.05
LONGEST_S = 100 * 365 * 86400
LEAST_RECORD, LEAST_RECORD_S = 10, 86400
"""Of fewer scans in less time nobody knows the pace: two taken by hand may lie seconds apart."""


@dataclass(frozen=True, slots=True)
class Room:
    """A folder's disk, and how much of it must stay free, bytes."""

    folder: Path
    reserve: float

    def shortage(self) -> str:
        """Say that less than the reserve is free, and what to do; empty where there is room, or no disk to ask."""
        try:
            free = shutil.disk_usage(self.folder).free
        except OSError:
            return ""
        if free >= self.reserve:
            return ""
        free_mb, reserve_mb = free / 1e6, self.reserve / 1e6
        return (
            f"disk almost full, no scan taken: {free_mb:.0f} MB free below {self.folder}, {reserve_mb:.0f} MB are "
            "kept in reserve; free some space (`microrelief store compact` may), or lower store.reserve_mb"
        )


def room_of(path: str | Path, grid: Grid | None, scans: int, reserve_mb: float | None = None) -> Room:
    """Give the room of a store.

    Parameters
    ----------
    path : str or Path
        Its folder, or ``s3://bucket/prefix``, where nothing is short.
    grid : Grid or None
        Its grid: what a scan takes, where there is none yet.
    scans : int
        How many it holds.
    reserve_mb : float, optional
        What must stay free; see `reserve_bytes`.
    """
    path = Path(path)
    if reserve_mb is not None:
        return Room(path, reserve_mb * 1e6)
    cells = grid.rows * grid.columns if grid is not None else 0
    scan = used_bytes(path) / scans if scans else cells * BYTES_PER_CELL
    try:
        total = shutil.disk_usage(path).total
    except OSError:
        return Room(path, 0.0)
    return Room(path, reserve_bytes(total, scan))


def reserve_bytes(total: float, scan: float) -> float:
    """Give what must stay free on a disk of `total` bytes where a scan takes `scan`.

    The greater of 500 MB and ten scans, but no more than a twentieth of the disk, and no less than two scans.
    """
    return max(LEAST_SCANS * scan, min(max(RESERVE_BYTES, RESERVE_SCANS * scan), PART_OF_DISK * total))


def used_bytes(folder: Path) -> int:
    """Give the bytes in all files of a folder, while others may write it."""
    return sum(size for _, size in Folder(folder).sizes())


def full_at(now: Instant, free: float, used: float, first: Instant, last: Instant, scans: int) -> Instant | None:
    """Say when the disk will be full at the pace so far; None where that is not known, or a century away."""
    if scans < 2 or not used:
        return None
    seconds = float((last - first) / np.timedelta64(1, "s"))
    if scans < LEAST_RECORD and seconds < LEAST_RECORD_S:
        return None
    left = free / used * seconds * scans / (scans - 1)
    if not 0 < left < LONGEST_S:
        return None
    full: Instant = now + np.timedelta64(round(left), "s")
    return full
