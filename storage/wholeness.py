"""Whether a snapshot is whole: the newest row of each array, which is what a torn commit would have torn."""

from __future__ import annotations

from typing import Any

from .layout import FOLD
from .rows import Known, all_of, at_once

__all__ = ["faults", "read_newest"]


def faults() -> tuple[type[Exception], ...]:
    """Give what a damaged file shows as: whatever the codec above it makes of the bytes."""
    import icechunk

    return (icechunk.IcechunkError, OSError, ValueError, RuntimeError, KeyError, IndexError, TypeError)


def read_newest(store: Any, *, whole: bool = True) -> Known:
    """Read the newest row of every array of a Zarr store, all its chunks; give what is known of the arrays then.

    A commit writes only rows at the end, new manifests for them, and a snapshot: where all of these can be read, so
    can what came before, unless the disk has lost what it had acknowledged. `verify` reads everything.

    Without `whole`, where a file is there whole or not at all: a look into one chunk of each array of cells and of
    change, and so into its manifest.

    Raises
    ------
    ValueError
        If arrays that grow together are of different lengths.
    Exception
        Whatever the codecs make of damaged bytes.
    """
    return at_once(_read_all(store, whole))


async def _read_all(store: Any, whole: bool) -> Known:
    from zarr.api.asynchronous import open_group

    root = await open_group(store=store, mode="r", use_consolidated=False)
    found: Any = root.members(max_depth=None)
    arrays = {path: member async for path, member in found if hasattr(member, "chunks")}
    count = int(arrays["scans/time"].shape[0])
    for path, array in arrays.items():
        if array.metadata.dimension_names[0] == "time" and not path.startswith("raw/") and array.shape[0] != count:
            if path.startswith("binned/") and path != "binned/time":  # folded, under the name that schema 1 gave it
                continue
            raise ValueError(f"{path} holds {array.shape[0]} scans, scans/time {count}")
    if whole:
        await all_of(_read_row(array, _newest(path, array, count)) for path, array in arrays.items())
    elif count:
        of_scans = (array for path, array in arrays.items() if path.startswith(("scans/", "change/")))
        await all_of(_look(array, count - 1) for array in of_scans if array.metadata.dimension_names[0] == "time")
    return {path: array.metadata for path, array in arrays.items()}


def _newest(path: str, array: Any, count: int) -> int:
    if path.startswith("binned/") and path.endswith("_tail"):
        return (count - 1) % FOLD if count else -1
    return int(array.shape[0]) - 1


async def _read_row(array: Any, number: int) -> None:
    if number >= 0:
        await array.getitem((slice(number, number + 1), ...))


async def _look(array: Any, number: int) -> None:
    await array.getitem((number, *(0,) * (array.ndim - 1)))
