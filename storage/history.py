"""What a place did through time, and which scan was taken when: questions to any store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import Grid, Instant, format_instant

from .binned import Indices, read_bins
from .icechunk_store import IcechunkStore
from .layout import FOLD
from .packing import BIN, Packing
from .store import Store

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["cell_history", "coarse_maps", "find_scan", "line_history"]

Which = Literal["nearest", "exact", "before", "after"]
Quantity = Literal["height", "dz"]


def find_scan(store: Store, time: Instant, which: Which = "nearest") -> int:
    """Find a scan by its time.

    Parameters
    ----------
    store : Store
    time : Instant
    which : {"nearest", "exact", "before", "after"}
        ``before`` and ``after`` take a scan at `time` itself too; of two scans equally near, the earlier one.

    Returns
    -------
    int
        Its number: ``store[number]`` reads it.

    Raises
    ------
    InputError
        If there is no such scan.
    """
    if which not in get_args(Which):
        raise InputError(f"which must be one of {', '.join(get_args(Which))}, not {which!r}")
    times = store.window()["time"].values
    where = int(np.searchsorted(times, time, side="left"))
    here = where < len(times) and times[where] == time
    found: int | None = where
    if which == "before":
        found = where if here else where - 1
    elif which == "nearest" and not here and where:
        found = where - 1 if where == len(times) or time - times[where - 1] <= times[where] - time else where
    elif which == "exact" and not here:
        found = None
    if found is None or not 0 <= found < len(times):
        span = f" from {format_instant(times[0])} to {format_instant(times[-1])}" if len(times) else ""
        told = "no scan" if which == "nearest" else f"no scan {'at' if which == 'exact' else which}"
        raise InputError(f"{store.about.location}: {told} {format_instant(time)}: it holds {len(times)} scans{span}")
    return found


def cell_history(store: Store, x_mm: float, y_mm: float, name: Quantity = "height") -> xr.DataArray:
    """Give the mean of the 8x8 cells around a place, in every scan.

    Parameters
    ----------
    store : Store
    x_mm, y_mm : float
        In the site frame.
    name : {"height", "dz"}
        Height, or change since the epoch's baseline.

    Returns
    -------
    xarray.DataArray, shape (time,)
        float32 mm in the store's steps, of 0.5 um as a rule; NaN where nothing was measured. Coordinates ``x`` and
        ``y`` are the middle of the 8x8 cells.

    Raises
    ------
    InputError
        If the place lies beyond the grid.
    """
    return _history(store, np.array([x_mm]), np.array([y_mm]), name).isel(point=0)


def line_history(
    store: Store, start_mm: tuple[float, float], end_mm: tuple[float, float], name: Quantity = "height"
) -> xr.DataArray:
    """Give the profile along a straight line, in every scan: `cell_history` for each 8x8 cells on the way.

    Parameters
    ----------
    store : Store
    start_mm, end_mm : (float, float)
        x and y in the site frame.
    name : {"height", "dz"}

    Returns
    -------
    xarray.DataArray, shape (time, distance)
        ``distance`` from the start, mm.

    Raises
    ------
    InputError
        If either end lies beyond the grid.
    """
    grid = _grid_of(store)
    start, end = np.asarray(start_mm, dtype=float), np.asarray(end_mm, dtype=float)
    length = float(np.hypot(*(end - start)))
    distance = np.linspace(0.0, length, 1 + int(np.ceil(length / (grid.pitch_mm * BIN))))
    x, y = start[:, np.newaxis] + (end - start)[:, np.newaxis] * (distance / length if length else distance)
    profile = _history(store, x, y, name).rename(point="distance")
    return profile.assign_coords(distance=("distance", distance, {"units": "mm"}))


def coarse_maps(
    store: Store, numbers: Sequence[int], name: Quantity = "height"
) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
    """Give maps of 8x8-cell means of many scans: a few large reads, whatever the size of the scans.

    Parameters
    ----------
    store : Store
    numbers : sequence of int
        Scans, in rising order.
    name : {"height", "dz"}

    Yields
    ------
    (int, ndarray of float32, shape (ceil(rows / 8), ceil(columns / 8)))
        A scan's number and its means, mm; NaN where fewer than half of the cells were measured.
    """
    if not isinstance(store, IcechunkStore):
        for number in numbers:
            stored = store[number]
            change = stored.change
            nothing = np.full(stored.scan.height.shape, np.nan, dtype=np.float32)
            cells = stored.scan.height if name == "height" else change.dz if change is not None else nothing
            packing = Packing("int32")
            yield number, packing.unpack(packing.pack_bins(np.asarray(cells, np.float32), name))
        return
    folded, tail = store.binned[name], store.binned[f"{name}_tail"]
    packing, length = Packing.of(folded), folded.shape[0]
    for start in sorted({number // FOLD * FOLD for number in numbers}):
        block = folded[start : start + FOLD] if start < length else tail[:]
        for number in numbers:
            if start <= number < start + FOLD:
                yield number, packing.unpack(block[number - start])


def _history(store: Store, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], name: Quantity) -> xr.DataArray:
    import xarray as xr

    if name not in get_args(Quantity):
        raise InputError(f"histories are of {' and '.join(get_args(Quantity))}, not {name!r}")
    grid = _grid_of(store)
    rows, columns = _bin(y, grid.y0_mm, grid, 0, "y"), _bin(x, grid.x0_mm, grid, 1, "x")
    if isinstance(store, IcechunkStore):
        times, packed = store.binned["time"][:].astype("datetime64[ns]"), read_bins(store.binned, name, rows, columns)
        packing = Packing.of(store.binned[name])
    else:
        packing = Packing("int32")
        times, packed = _averaged(store, rows, columns, name, packing)
    middle = (BIN - 1) / 2
    return xr.DataArray(
        packing.unpack(packed),
        dims=("time", "point"),
        coords={
            "time": times,
            "x": ("point", grid.x0_mm + grid.pitch_mm * (BIN * columns + middle), {"units": "mm"}),
            "y": ("point", grid.y0_mm + grid.pitch_mm * (BIN * rows + middle), {"units": "mm"}),
        },
        name=name,
        attrs={"units": "mm", "long_name": f"mean {name} of {BIN}x{BIN} cells"},
    )


def _averaged(store: Store, rows: Indices, columns: Indices, name: Quantity, packing: Packing) -> tuple[Any, Any]:
    """Average scan by scan what a store without coarse histories holds."""
    window = store.window()
    packed = [packing.pack_bins(np.asarray(cells, np.float32), name)[rows, columns] for cells in window[name].values]
    return window["time"].values, np.array(packed, dtype=np.int32).reshape(-1, len(rows))


def _bin(places: npt.NDArray[np.float64], first: float, grid: Grid, axis: int, letter: str) -> Indices:
    """Give the index of the 8x8 cells that hold each place."""
    cells = np.floor((places - first) / grid.pitch_mm + 0.5)
    beyond = (cells < 0) | (cells >= grid.shape[axis])
    if beyond.any():
        low, high = first - grid.pitch_mm / 2, first + grid.pitch_mm * (grid.shape[axis] - 0.5)
        raise InputError(f"{letter} must lie on the grid, from {low:.6g} to {high:.6g} mm, not {places[beyond][0]:.6g}")
    index: Indices = (cells // BIN).astype(np.int64)
    return index


def _grid_of(store: Store) -> Grid:
    grid = store.about.grid
    if grid is None:
        raise InputError(f"{store.about.location}: has no grid, so no places")
    return grid
