"""Rows: values for consecutive rows of an array; a transaction writes those of all its arrays at once."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["Known", "Rows", "all_of", "at_once", "delete_below", "read_row", "row", "texts", "write_rows"]

T = TypeVar("T")

Known = dict[str, Any]
"""Zarr's metadata of arrays by path, as they are in one snapshot: to parse them took half of a small commit's time."""

WITHOUT_LOOKING: Any = {"order": "C", "write_empty_chunks": True}
"""How arrays are written: Zarr else compares each chunk with its fill value first, which took a tenth of an append."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What goes into the rows from `start` of the array at `path`.

    `values` has a row along its first axis for each of `count`; None only lengthens the array: rows that hold its fill
    value cost nothing.
    """

    path: str
    start: int
    count: int
    values: npt.NDArray[Any] | None


def row(path: str, number: int, value: Any) -> Rows:
    """Give one row: a number, a text, or one scan's cells; None for the array's fill value."""
    if value is None:
        return Rows(path, number, 1, None)
    if isinstance(value, str):
        return Rows(path, number, 1, texts([value]))
    return Rows(path, number, 1, np.asarray(value)[np.newaxis])


def texts(values: Sequence[str]) -> npt.NDArray[Any]:
    """Give texts of any length as an array."""
    return np.array(values, dtype=np.dtypes.StringDType())


def write_rows(store: Any, rows: Sequence[Rows], known: Known | None = None) -> None:
    """Write all rows, lengthening arrays where they end before them.

    A tick touches some sixty arrays. Through Zarr's plain interface each opening, lengthening and writing is a hop to
    its event loop and back, a millisecond in all; here they are tasks of one loop. `known` learns each array's new
    length; after a failure it may know what is not so.
    """
    import zarr

    known = {} if known is None else known

    async def write() -> None:
        with zarr.config.set({"json_indent": None}):  # with an indent, Python's slow encoder writes the metadata
            await all_of(_write(store, each, known) for each in rows)

    at_once(write())


def read_row(store: Any, group: str, number: int, names: Iterable[str], known: Known | None = None) -> dict[str, Any]:
    """Read row `number` of several arrays of a group; give numbers, texts or one scan's cells by name."""
    known = {} if known is None else known

    async def read(name: str) -> tuple[str, Any]:
        array = await _array(store, f"{group}/{name}", known)
        return name, (await array.getitem((slice(number, number + 1), ...)))[0]

    return dict(at_once(all_of(read(name) for name in names)))


def delete_below(store: Any, folders: Sequence[str]) -> None:
    """Delete every key below some folders of a store, such as the chunks of some rows of an array."""

    async def delete() -> None:
        await all_of(store.delete_dir(folder) for folder in folders)

    at_once(delete())


def at_once(work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end, in a loop and a thread of its own: the caller's may run one (a notebook's does)."""
    with ThreadPoolExecutor(1, thread_name_prefix="microrelief-store") as worker:
        return worker.submit(asyncio.run, work).result()


async def all_of(tasks: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
    """Do everything at once, and raise only when nothing goes on: Icechunk would answer to a loop that is closed."""
    results = []
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, BaseException):
            raise result
        results.append(result)
    return results


async def _array(store: Any, path: str, known: Known) -> Any:
    """Open an array; what is known of it need not be read and checked again."""
    import zarr

    place = zarr.storage.StorePath(store, path)
    if path not in known:
        known[path] = (await zarr.AsyncArray.open(place, zarr_format=3)).metadata
    return zarr.AsyncArray(known[path], place, WITHOUT_LOOKING)


async def _write(store: Any, rows: Rows, known: Known) -> None:
    array = await _array(store, rows.path, known)
    end = rows.start + rows.count
    if array.shape[0] < end:
        await array.resize((end, *array.shape[1:]))
        known[rows.path] = array.metadata
    if rows.values is not None:
        await array.setitem((slice(rows.start, end), ...), rows.values)
