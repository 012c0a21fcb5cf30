"""How a video's process spends its cores: freed memory stays its own, one thread multiplies small matrices."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

__all__ = ["steady_process"]

TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
"""The C library's parameters (``mallopt(3)``)."""

LARGEST = 32 * 2**20
"""The largest threshold that the C library takes, bytes: a map of 2560x1440 cells is below it, a capture above."""

KEPT = 2**30
"""Free memory above this is given back to the system."""


@contextmanager
def steady_process() -> Iterator[None]:
    """Let whatever comes and go with every scan cost no system calls.

    Maps of a scan are tens of megabytes, freed a moment later. By default the C library asks the system for each of
    them and gives it back, and the system fills its pages with zeros: a seventh of a video's time. And numpy's linear
    algebra keeps threads spinning for the next product, which is small here.
    """
    if sys.platform.startswith("linux"):
        library = ctypes.CDLL(None)
        if hasattr(library, "mallopt"):  # other libraries than GNU's may have none
            for parameter, value in ((TRIM_THRESHOLD, KEPT), (MMAP_THRESHOLD, LARGEST), (ARENA_MAX, 1)):
                library.mallopt(parameter, value)
    with threadpool_limits(limits=1, user_api="blas"):
        yield
