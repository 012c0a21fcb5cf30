"""The whole way from frames to a scan."""

from __future__ import annotations

from .frames import Frames
from .pixel_maps import PointMap
from .rig_model import Calibration
from .subpixel import locate
from .triangulate import triangulate

__all__ = ["reconstruct"]


def reconstruct(frames: Frames, calibration: Calibration) -> PointMap:
    """Decode a capture to sub-pixel and give each pixel its point in the camera frame, before any clean-up.

    Raises
    ------
    ValueError
        If the images or the patterns are not of the size that was calibrated.
    """
    columns, rows = frames.patterns.size
    if frames.patterns.size != calibration.projector.size:
        wide, high = calibration.projector.size
        raise ValueError(
            f"patterns for a projector of {columns}x{rows}, but the calibration is for {wide}x{high}: "
            "use the pattern file of the calibration"
        )
    return triangulate(locate(frames), calibration)
