"""Two cores for one comparison: a compiled loop by stretches of rows, and whole steps side by side."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

__all__ = ["in_slabs", "side_by_side"]

Result = TypeVar("Result")
LEAST_ROWS = 64


def in_slabs(rows: int, work: Callable[[int, int], Result]) -> list[Result]:
    """Call ``work(first, last)`` on stretches that together are all rows, one a core; gives what each returned.

    Threads and not numba's own parallel loops, whose one pool must not be entered from two threads: a monitor compares
    one rig while it reconstructs for another. Kernels release the interpreter's lock.

    Parameters
    ----------
    rows : int
    work : callable
        Must write nothing outside its own rows.
    """
    cores = max(1, min(int(numba.config.NUMBA_NUM_THREADS), rows // LEAST_ROWS))
    size = max(1, -(-rows // cores))
    stretches = [(first, min(first + size, rows)) for first in range(0, rows, size)]
    if len(stretches) < 2:
        return [work(first, last) for first, last in stretches]
    with ThreadPoolExecutor(len(stretches)) as pool:
        return list(pool.map(work, *zip(*stretches, strict=True)))


def side_by_side(*jobs: Callable[[], Result]) -> list[Result]:
    """Results of steps that do not need each other, in order; each in a thread of its own where there are cores."""
    cores = min(int(numba.config.NUMBA_NUM_THREADS), len(jobs))
    if cores < 2:
        return [job() for job in jobs]
    with ThreadPoolExecutor(cores) as pool:
        return [done.result() for done in [pool.submit(job) for job in jobs]]
