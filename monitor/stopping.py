"""Stopping gracefully: the first Ctrl-C or SIGTERM finishes the scan under way, the second stops at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["graceful_stop"]


@contextmanager
def graceful_stop() -> Iterator[threading.Event]:
    """Give a flag that the first signal sets; the second raises KeyboardInterrupt. Puts the old handlers back."""
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()
        print("stopping after the scan under way; once more stops at once", file=sys.stderr, flush=True)

    if threading.current_thread() is not threading.main_thread():
        yield stop  # signals go to the main thread; whoever runs us elsewhere sets the flag itself
        return
    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
