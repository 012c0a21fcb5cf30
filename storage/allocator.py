"""Memory that a long-lived writer has freed, given back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress

__all__ = ["give_back"]


def give_back() -> None:
    """Let glibc return the free pages of all its arenas; do nothing where another allocator is in use.

    A commit makes and drops buffers in a dozen threads. What lives grows by some kB with each, for snapshots list more
    and more manifests; what glibc holds in between grew ten times as fast.
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
