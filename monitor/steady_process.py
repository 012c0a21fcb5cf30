"""How a video's process spends its cores: freed memory stays its own, one thread multiplies small matrices."""

from __future__ import annotations

import ctypes
import sys

from threadpoolctl import threadpool_limits

__all__ = ["SteadyProcess"]

TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
"""The C library's parameters (``mallopt(3)``)."""

LARGEST = 32 * 2**20
"""The largest threshold that the C library takes, bytes: a map of 2560x1440 cells is below it, a capture above."""

KEPT = 2**30
"""Free memory above this is given back to the system at once."""

TRIMMED_AFTER = 50
"""After so many scans all that is free is given back: it lies in ever smaller pieces, which add up."""


class SteadyProcess:
    """Lets whatever comes and goes with every scan cost no system calls, until it is closed.

    Maps of a scan are tens of megabytes, freed a moment later. By default the C library asks the system for each of
    them and gives it back, and the system fills its pages with zeros: a seventh of a video's time. And numpy's linear
    algebra keeps threads spinning for the next product, which is small here.
    """

    def __init__(self) -> None:
        library = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
        # other libraries than GNU's may have none of this
        self._library = library if hasattr(library, "mallopt") and hasattr(library, "malloc_trim") else None
        if self._library is not None:
            for parameter, value in ((TRIM_THRESHOLD, KEPT), (MMAP_THRESHOLD, LARGEST), (ARENA_MAX, 1)):
                self._library.mallopt(parameter, value)
        self._limits = threadpool_limits(limits=1, user_api="blas")
        self._scans = 0

    def after_scan(self) -> None:
        """Give back what is free, now and then."""
        self._scans += 1
        if self._library is not None and self._scans % TRIMMED_AFTER == 0:
            self._library.malloc_trim(0)

    def close(self) -> None:
        """Give linear algebra its threads back. The C library keeps its parameters: they cannot be read."""
        self._limits.restore_original_limits()
