"""Coarse histories: 8x8-cell means, single scans in a tail that is folded into long chunks every 64."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipelines import Tick

from .layout import FOLD
from .packing import fill_of, pack_bins
from .rows import Rows, row

__all__ = ["history_of", "rows_of_bins"]


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
        kind = str(tail.dtype)
        fresh = np.full(tail.shape[1:], fill_of(kind), kind) if values is None else pack_bins(values, kind, name)
        if slot < FOLD - 1:
            rows.append(row(f"binned/{name}_tail", slot, fresh))
        else:
            folded = np.concatenate([tail[: FOLD - 1], fresh[np.newaxis]])
            rows.append(Rows(f"binned/{name}", number + 1 - FOLD, FOLD, folded))
    return rows


def history_of(group: Any, name: str, row: int, column: int) -> Any:
    """Read one coarse cell through all scans: packed steps, shape (time,)."""
    count, folded = group["time"].shape[0], group[name].shape[0]
    return np.concatenate([group[name][:, row, column], group[f"{name}_tail"][: count - folded, row, column]])
