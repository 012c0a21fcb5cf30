"""Coarse histories: 8x8-cell means, single scans in a tail that is folded into long chunks every 64."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import Tick

from .layout import FOLD
from .packing import Packing
from .rows import Rows, row

__all__ = ["read_bins", "rows_of_bins"]

Indices = npt.NDArray[np.int64]


def rows_of_bins(group: Any, number: int, tick: Tick) -> list[Rows]:
    """Give the rows of one scan's means: into the tail, or with the tail into the long chunks where it is full.

    A chunk of `FOLD` scans written anew at each of them would cost `FOLD` / 2 times its bytes; so each scan is
    written twice: once alone, once folded.
    """
    assert tick.scan is not None
    slot = number % FOLD
    change = tick.change
    rows = [row("binned/time", number, tick.scan.time.astype(np.int64))]
    for name, values in (("height", tick.scan.height), ("dz", None if change is None else change.dz)):
        tail = group[f"{name}_tail"]
        packing = Packing.of(tail)
        nothing = np.full(tail.shape[1:], packing.fill, packing.kind)
        fresh = nothing if values is None else packing.pack_bins(values, name)
        if slot < FOLD - 1:
            rows.append(row(f"binned/{name}_tail", slot, fresh))
        else:
            folded = np.concatenate([tail[: FOLD - 1], fresh[np.newaxis]])
            rows.append(Rows(f"binned/{name}", number + 1 - FOLD, FOLD, folded))
    return rows


def read_bins(group: Any, name: str, rows: Indices, columns: Indices) -> npt.NDArray[np.signedinteger[Any]]:
    """Read coarse cells through all scans.

    Every chunk that they lie in is read once, whatever number of them it holds.

    Parameters
    ----------
    group : zarr group
        ``/binned``.
    name : str
        ``height`` or ``dz``.
    rows, columns : ndarray of int, shape (n,)

    Returns
    -------
    ndarray, shape (time, n)
        Packed steps.
    """
    count, folded = group["time"].shape[0], group[name].shape[0]
    values = np.empty((count, len(rows)), group[name].dtype)
    for part, array in ((slice(0, folded), group[name]), (slice(folded, count), group[f"{name}_tail"])):
        length = part.stop - part.start
        if not length:
            continue
        tiles = np.stack([rows // array.chunks[1], columns // array.chunks[2]])
        for tile in np.unique(tiles, axis=1).T:
            here = np.flatnonzero((tiles == tile[:, np.newaxis]).all(axis=0))
            top, left = rows[here].min(), columns[here].min()
            block = array[:length, top : rows[here].max() + 1, left : columns[here].max() + 1]
            values[part, here] = block[:, rows[here] - top, columns[here] - left]
    return values
