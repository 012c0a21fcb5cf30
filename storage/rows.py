"""Rows: values for consecutive rows of an array; a transaction writes those of all its arrays at once."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Rows", "all_of", "delete_below", "row", "texts", "write_rows"]


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


def write_rows(store: Any, rows: Sequence[Rows]) -> None:
    """Write all rows, lengthening arrays where they end before them.

    A tick touches some forty arrays. Through Zarr's plain interface each opening, lengthening and writing is a hop to
    its event loop and back, a millisecond in all; here they are tasks of one loop. The loop has a thread of its own:
    the caller's may run one already (a notebook's does).
    """
    with ThreadPoolExecutor(1, thread_name_prefix="microrelief-store") as worker:
        worker.submit(lambda: asyncio.run(_write_all(store, rows))).result()


def delete_below(store: Any, folders: Sequence[str]) -> None:
    """Delete every key below some folders of a store, such as the chunks of some rows of an array."""

    async def delete() -> None:
        await all_of(store.delete_dir(folder) for folder in folders)

    with ThreadPoolExecutor(1, thread_name_prefix="microrelief-store") as worker:
        worker.submit(lambda: asyncio.run(delete())).result()


async def _write_all(store: Any, rows: Sequence[Rows]) -> None:
    await all_of(_write(store, each) for each in rows)


async def all_of(tasks: Iterable[Coroutine[Any, Any, None]]) -> None:
    """Do everything at once, and raise only when nothing goes on: Icechunk would answer to a loop that is closed."""
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, BaseException):
            raise result


async def _write(store: Any, rows: Rows) -> None:
    from zarr.api.asynchronous import open_array

    array: Any = await open_array(store=store, path=rows.path, mode="r+")
    end = rows.start + rows.count
    if array.shape[0] < end:
        await array.resize((end, *array.shape[1:]))
    if rows.values is not None:
        await array.setitem((slice(rows.start, end), ...), rows.values)
