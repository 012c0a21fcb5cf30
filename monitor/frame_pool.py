"""Frame pool: room for captures that is made once and lent again and again, so that a video's memory stays flat."""

from __future__ import annotations

from threading import Lock
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt

from pipelines import Frames

__all__ = ["FramePool"]

Stack = npt.NDArray[Any]


class FramePool:
    """Lends stacks of frames. Safe to use from several threads.

    A rig whose attribute `make_stack` is set to `take` captures into lent room: fresh memory of 150 MB costs a page
    fault for each 4 kB of it. There are never more stacks than captures whose frames are needed at once; one that is
    lost (of a capture that failed) is forgotten.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._free: list[Stack] = []
        self._lent: WeakValueDictionary[int, Stack] = WeakValueDictionary()

    def lend_to(self, rig: object) -> None:
        """Let a rig capture into lent room, if it can."""
        if hasattr(rig, "make_stack"):
            rig.make_stack = self.take

    def take(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Stack:
        """Lend a stack that holds anything; free ones of another shape are thrown away."""
        with self._lock:
            self._free = [each for each in self._free if each.shape == shape and each.dtype == dtype]
            stack = self._free.pop() if self._free else np.empty(shape, dtype)
            self._lent[id(stack)] = stack
            return stack

    def let_go(self, frames: Frames) -> None:
        """Take back the room of frames that nobody needs any more; those that are not lent are no matter."""
        with self._lock:
            stack = self._lent.pop(id(frames.stack), None)
            if stack is not None:
                self._free.append(stack)
