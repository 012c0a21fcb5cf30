"""The whole way from frames to points."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from .clean import reject_mixed
from .frames import Frames
from .pixel_maps import PointMap
from .rig_model import Calibration
from .subpixel import locate
from .triangulate import triangulate

__all__ = ["check_projector", "reconstruct", "without"]


def reconstruct(frames: Frames, calibration: Calibration, *, local_integration: bool = False) -> PointMap:
    """Decode a capture to sub-pixel and give each pixel its point in the camera frame.

    Pixels that see two surfaces at once are rejected; a background and lone points are still there. With
    `local_integration` pixels too faint by themselves are read from sums over a window (`local_integration.integrate`).

    Raises
    ------
    ValueError
        If the images or the patterns are not of the size that was calibrated.
    """
    check_projector(frames, calibration)
    points = triangulate(locate(frames, local_integration=local_integration), calibration)
    return without(points, reject_mixed(points))


def without(points: PointMap, mixed: npt.NDArray[np.bool_]) -> PointMap:
    """Take out these pixels, in place: the points are just made, nobody else holds them."""
    for measured in (points.xyz, points.sigma_z, points.projector):
        measured[mixed] = np.nan
    points.level[mixed] = LEVEL_NONE
    return points


def check_projector(frames: Frames, calibration: Calibration) -> None:
    """Refuse patterns that are not of the projector that was calibrated.

    Raises
    ------
    ValueError
        Saying both sizes.
    """
    columns, rows = frames.patterns.size
    if frames.patterns.size != calibration.projector.size:
        wide, high = calibration.projector.size
        raise ValueError(
            f"patterns for a projector of {columns}x{rows}, but the calibration is for {wide}x{high}: "
            "use the pattern file of the calibration"
        )
