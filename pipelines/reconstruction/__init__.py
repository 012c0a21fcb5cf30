"""Frames to height maps: patterns, decoding, calibration, triangulation, gridding, clean-up."""

from .decode import decode
from .frame_order import suggest_order
from .frames import Frames
from .patterns import PAPER_STRIPES, FrameRole, PatternSet
from .pixel_maps import Decoded, PointMap
from .rig_model import Calibration, Lens, PoseResidual

__all__ = [
    "PAPER_STRIPES",
    "Calibration",
    "Decoded",
    "FrameRole",
    "Frames",
    "Lens",
    "PatternSet",
    "PointMap",
    "PoseResidual",
    "decode",
    "suggest_order",
]
