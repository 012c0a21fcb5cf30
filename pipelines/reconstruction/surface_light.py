"""What the white and the black frame alone tell of each pixel: texture and contrast."""

from __future__ import annotations

import numpy as np

from .frames import Frames
from .light import frame_of
from .pixel_maps import Decoded

__all__ = ["show_light"]


def show_light(frames: Frames, into: Decoded) -> None:
    """Fill `texture` and `contrast`: white, and white minus black (0 where black is brighter), scaled to 8 bits."""
    white, black = (frames.stack[frame_of(frames.patterns, what)] for what in ("white", "black"))
    shift = 8 * (frames.stack.itemsize - 1)
    into.texture[:] = white >> shift
    into.contrast[:] = (np.maximum(white, black) - black) >> shift
