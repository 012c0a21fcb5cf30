"""Slabs: a compiled loop over rows runs in one thread per core, each on its own stretch; or whole steps do."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

__all__ = ["in_slabs", "side_by_side"]

Result = TypeVar("Result")


def in_slabs(rows: int, work: Callable[[int, int], Result], *, step: int = 0, least: int = 64) -> list[Result]:
    """Call ``work(first, last)`` on stretches that together are all rows; gives what each returned, in order.

    Threads and not numba's own parallel loops: those share one thread pool that must not be entered from two threads,
    and here a video may be reconstructed while a report is made. The kernels release the interpreter's lock.

    Parameters
    ----------
    rows : int
    work : callable
        Must write nothing outside its own rows.
    step : int
        Rows of a stretch; 0 shares the rows out among the cores (``NUMBA_NUM_THREADS`` limits them).
    least : int
        No stretch is shorter, but the last.
    """
    cores = max(1, min(int(numba.config.NUMBA_NUM_THREADS), rows // least))
    size = step or max(1, -(-rows // cores))
    stretches = [(first, min(first + size, rows)) for first in range(0, rows, size)]
    if cores == 1 or len(stretches) == 1:
        return [work(first, last) for first, last in stretches]
    with ThreadPoolExecutor(cores) as pool:
        return [done.result() for done in [pool.submit(work, *stretch) for stretch in stretches]]


def side_by_side(*jobs: Callable[[], Result]) -> list[Result]:
    """Results of steps that do not need each other, in order; each in a thread of its own where there are cores."""
    cores = min(int(numba.config.NUMBA_NUM_THREADS), len(jobs))
    if cores < 2:
        return [job() for job in jobs]
    with ThreadPoolExecutor(cores) as pool:
        return [done.result() for done in [pool.submit(job) for job in jobs]]
