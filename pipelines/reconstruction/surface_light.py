"""What the white and the black frame alone tell of each pixel: texture and contrast."""

from __future__ import annotations

import numpy as np

from .frames import Frames
from .pixel_maps import Decoded

__all__ = ["show_light", "white_and_black"]


def white_and_black(frames: Frames) -> tuple[int, int]:
    """Which frame is the white one, and which the black."""
    names = [role.what for role in frames.patterns.roles]
    return names.index("white"), names.index("black")


def show_light(frames: Frames, into: Decoded) -> None:
    """Fill `texture` and `contrast`: white, and white minus black (0 where black is brighter), scaled to 8 bits."""
    white, black = (frames.stack[number] for number in white_and_black(frames))
    shift = 8 * (frames.stack.itemsize - 1)
    into.texture[:] = white >> shift
    into.contrast[:] = (np.maximum(white, black) - black) >> shift
