"""Where work on many scans is done: here, in processes of this machine, or on a cluster; results keep their order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Any, Protocol, TypeVar

from configs import InputError, MicroreliefError

__all__ = ["Spread", "engine"]

Shared = TypeVar("Shared")
Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 2
"""Items under way for each worker: one that is worked on, and one that waits, so that none is idle."""

CONNECT_S = 10


class Spread(Protocol):
    """Works on items one by one or several at once, and gives the results in the order of the items."""

    def __call__(
        self, work: Callable[[Shared, Item], Result], shared: Shared, items: Iterable[Item]
    ) -> Iterator[Result]:
        """Give ``work(shared, item)`` of each item. Closing the iterator drops what is still under way."""
        ...


@contextmanager
def engine(workers: int = 1, scheduler: str | None = None) -> Iterator[Spread]:
    """Give the engine for the length of a block.

    Parameters
    ----------
    workers : int
        Processes of this machine; with 1 the work is done in this one, without dask.
    scheduler : str, optional
        Address of a ``dask.distributed`` scheduler, such as ``tcp://127.0.0.1:8786``, whose workers do the work.
        They need this package and must reach the store under its path or address.

    Raises
    ------
    InputError
        If there is no scheduler at the address, or it has no worker.
    MicroreliefError
        If the extra `dask` is not installed, or a worker died.
    """
    if scheduler is None and workers == 1:
        yield _here
        return
    try:
        import dask
        from distributed import Client, LocalCluster
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise MicroreliefError(
            "several workers need dask: install it with  pip install 'microrelief[dask]', or leave --workers out"
        ) from None
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_settings(workers)))
        if scheduler is None:
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    memory_limit=0,
                )
            )
            client = stack.enter_context(Client(cluster))
        else:
            try:
                client = stack.enter_context(Client(scheduler, timeout=CONNECT_S))
            except (OSError, ValueError) as error:
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                raise InputError(
                    f"--scheduler {scheduler}: no scheduler answers there ({reason}): start one with  dask scheduler"
                ) from None
            if not client.scheduler_info(n_workers=-1)["workers"]:
                raise InputError(f"--scheduler {scheduler}: it has no worker: start some with  dask worker {scheduler}")
        try:
            yield _on(client)
        except KilledWorker:
            raise MicroreliefError(
                "a worker died several times at the same scans: is its memory enough? Try fewer workers"
            ) from None


def _here(work: Callable[[Shared, Item], Result], shared: Shared, items: Iterable[Item]) -> Iterator[Result]:
    return (work(shared, item) for item in items)


def _settings(workers: int) -> dict[str, Any]:
    """Local workers share the machine's cores; OpenMP and BLAS threads are held to one by distributed itself."""
    threads = max(1, (os.cpu_count() or 1) // workers)
    return {
        "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": threads,
        "distributed.logging.distributed": "error",
    }


def _on(client: Any) -> Spread:
    def spread(work: Callable[[Shared, Item], Result], shared: Shared, items: Iterable[Item]) -> Iterator[Result]:
        ahead = AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        everywhere = client.scatter(shared, broadcast=True, hash=False)
        rest = iter(items)
        # one future per item and a few at a time: one graph of all of them costs half a minute at 500,000 tasks
        futures = deque(client.submit(work, everywhere, item, pure=False) for item in islice(rest, ahead))
        try:
            while futures:
                first = futures.popleft()
                result = first.result()
                first.release()
                futures.extend(client.submit(work, everywhere, item, pure=False) for item in islice(rest, 1))
                yield result
        finally:
            client.cancel(list(futures))

    return spread
