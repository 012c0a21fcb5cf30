"""What one tick writes: its rows of every array, and the attributes that it changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipelines import Tick

from .binned import rows_of_bins
from .layout import NOISE
from .order import Place
from .packing import Packing
from .raw_frames import let_go, rows_of_frames
from .records import rows_of_calibration, rows_of_change, rows_of_events, rows_of_metrics, rows_of_scan
from .rows import Rows

__all__ = ["rows_of_tick"]


def rows_of_tick(root: Any, tick: Tick, where: Place, packing: Packing, metrics: Mapping[str, str]) -> list[Rows]:
    """Give the rows of a tick; a new noise model is kept, and frames past their time are let go, at once.

    Parameters
    ----------
    root : zarr.Group
        Of a session that is being written.
    tick : Tick
    where : Place
        The scan's number and epoch, and the events to keep.
    packing : Packing
    metrics : mapping of str to str
        Units of the store's metrics by name.
    """
    rows = rows_of_events(root["events/time"].shape[0], where.events)
    if where.number is not None:
        rows += rows_of_scan(where, tick, packing)
        rows += rows_of_change(where.number, tick, packing)
        rows += rows_of_metrics(where.number, tick, metrics)
        rows += rows_of_bins(root["binned"], where.number, tick)
    if tick.calibration is not None:
        rows += rows_of_calibration(root, tick.calibration)
    if tick.noise is not None:
        root.attrs[NOISE] = tick.noise.to_json()
    if tick.frames is not None:
        rows += rows_of_frames(root, where.number, tick.frames)
    if tick.frames_since is not None:
        let_go(root, tick.frames_since)
    return rows
