"""Frames: one capture, as the camera gave it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..instant import Instant, check_instant
from .patterns import PatternSet

__all__ = ["Frames"]


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """A stack of frames and what was projected while they were taken.

    Parameters
    ----------
    stack : ndarray of uint8 or uint16, shape (frame, row, column)
        C-contiguous, indexed by the image as captured, in the order of ``patterns.roles``.
    time : Instant
        When the first frame was taken, UTC.
    patterns : PatternSet
    exposure_ms : float
        NaN where unknown.
    remarks : tuple of str
        What the rig had to do to get them, such as a frame that was taken again; a line each.
    """

    stack: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    time: Instant
    patterns: PatternSet
    exposure_ms: float = float("nan")
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_instant(self.time, "capture time")
        if self.stack.ndim != 3 or self.stack.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"frames must be (frame, row, column) in uint8 or uint16, not {self.stack.dtype} {self.stack.shape}"
            )
        if len(self.stack) != len(self.patterns.roles):
            raise ValueError(f"{len(self.stack)} frames, but the pattern set has {len(self.patterns.roles)}")

    @property
    def image_size(self) -> tuple[int, int]:
        """Camera columns, rows."""
        return self.stack.shape[2], self.stack.shape[1]
