"""Slabs: a compiled loop over rows runs on all cores, each on its own stretch; or whole steps do, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache, partial
from typing import TypeVar

import numba

__all__ = ["in_slabs", "side_by_side"]

Result = TypeVar("Result")


@lru_cache(maxsize=1)
def _helpers(cores: int) -> ThreadPoolExecutor:
    """Threads that help whoever asks; kept, for many a stretch takes less time than the start of a thread."""
    return ThreadPoolExecutor(cores - 1, thread_name_prefix="slab")


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
    stretches = [partial(work, first, min(first + size, rows)) for first in range(0, rows, size)]
    return [one() for one in stretches] if cores == 1 else _shared_out(stretches)


def side_by_side(*jobs: Callable[[], Result]) -> list[Result]:
    """Results of steps that do not need each other, in order; in threads of their own where there are cores."""
    return [job() for job in jobs] if int(numba.config.NUMBA_NUM_THREADS) < 2 else _shared_out(jobs)


def _shared_out(jobs: Sequence[Callable[[], Result]]) -> list[Result]:
    """Do all jobs, some by helpers; raises the first one's error once none goes on.

    Whoever asks works too, and takes back what no helper has begun. So he waits only for what is under way, and jobs
    that share out jobs of their own cannot wait for each other.
    """
    if len(jobs) < 2:
        return [job() for job in jobs]
    helpers = _helpers(int(numba.config.NUMBA_NUM_THREADS))
    others = [helpers.submit(job) for job in jobs[1:]]
    done = [
        _done(jobs[0]),
        *(_done(job) if each.cancel() else each for job, each in zip(jobs[1:], others, strict=True)),
    ]
    for each in done:
        each.exception()
    return [each.result() for each in done]


def _done(job: Callable[[], Result]) -> Future[Result]:
    """A job that was done here, whatever came of it."""
    future: Future[Result] = Future()
    try:
        future.set_result(job())
    except BaseException as error:  # noqa: BLE001 - it is raised where the results are taken
        future.set_exception(error)
    return future
