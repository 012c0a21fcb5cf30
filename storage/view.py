"""A window of time onto a store, as a lazy xarray Dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines import Instant

from .layout import CELLS_OF_CHANGE, CELLS_OF_SCAN

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["window_of"]

PER_SCAN = ("scan", "epoch", "planned", "calibration")


def window_of(store: Any, first: Instant | None, last: Instant | None) -> xr.Dataset:
    """Give the scans of a Zarr store between two instants (both included); cells are read when they are asked for."""
    import xarray as xr

    scans = xr.open_zarr(store, group="scans", consolidated=False, chunks=None)
    change = xr.open_zarr(store, group="change", consolidated=False, chunks=None)
    both = scans[[*CELLS_OF_SCAN, *PER_SCAN]].assign({name: change[name] for name in CELLS_OF_CHANGE})
    return cut(both, first, last)


def cut(dataset: xr.Dataset, first: Instant | None, last: Instant | None) -> xr.Dataset:
    """Cut a Dataset whose times ascend."""
    times = dataset["time"].values
    start = 0 if first is None else int(np.searchsorted(times, first, side="left"))
    stop = len(times) if last is None else int(np.searchsorted(times, last, side="right"))
    return dataset.isel(time=slice(start, stop))
