"""Slabs: a compiled loop over rows runs in one thread per core, each on its own stretch of rows."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba

__all__ = ["in_slabs"]


def in_slabs(rows: int, work: Callable[[int, int], object], *, step: int = 0, least: int = 64) -> None:
    """Call ``work(first, last)`` on stretches that together are all rows.

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
    size = step or -(-rows // cores)
    starts = range(0, rows, size)
    if cores == 1 or len(starts) == 1:
        for first in starts:
            work(first, min(first + size, rows))
        return
    with ThreadPoolExecutor(cores) as pool:
        for done in [pool.submit(work, first, min(first + size, rows)) for first in starts]:
            done.result()
