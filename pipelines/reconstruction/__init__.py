"""Frames to height maps: patterns, decoding, calibration, triangulation, gridding, clean-up."""

from .board import Board, CharucoBoard
from .calibration import calibrate, calibrate_decoded
from .decode import decode
from .frame_order import suggest_order
from .frames import Frames
from .gridding import footprint_grid, to_scan
from .optics import CHIPS, PAPER_SETUP, Figure, OpticsSetup, conflicts, work_out
from .patterns import PAPER_STRIPES, FrameRole, PatternSet
from .pixel_maps import Decoded, PointMap
from .reconstruct import reconstruct
from .rig_model import Calibration, Lens, PoseResidual
from .subpixel import locate, refine
from .triangulate import triangulate

__all__ = [
    "CHIPS",
    "PAPER_SETUP",
    "PAPER_STRIPES",
    "Board",
    "Calibration",
    "CharucoBoard",
    "Decoded",
    "Figure",
    "FrameRole",
    "Frames",
    "Lens",
    "OpticsSetup",
    "PatternSet",
    "PointMap",
    "PoseResidual",
    "calibrate",
    "calibrate_decoded",
    "conflicts",
    "decode",
    "footprint_grid",
    "locate",
    "reconstruct",
    "refine",
    "suggest_order",
    "to_scan",
    "triangulate",
    "work_out",
]
