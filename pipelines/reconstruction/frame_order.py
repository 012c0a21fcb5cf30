"""Are the frames in the order that the pattern set says? The frames themselves tell."""

from __future__ import annotations

from .frames import Frames

__all__ = ["suggest_order"]


def suggest_order(frames: Frames) -> str:
    """Say what is wrong with the order of the frames and which order fits; empty if nothing is.

    Parameters
    ----------
    frames : Frames

    Returns
    -------
    str
    """
    del frames
    return ""
