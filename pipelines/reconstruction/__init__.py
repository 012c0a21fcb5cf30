"""Frames to height maps: patterns, decoding, calibration, triangulation, gridding, clean-up."""

from .board import Board, CharucoBoard
from .calibration import calibrate, calibrate_decoded
from .calibration_words import calibration_verdict, describe_calibration, rms_verdict
from .decode import decode
from .devices import Device, DeviceName, device
from .diagnose import CAUSES, Diagnosis, Finding, diagnose, diagnose_stack
from .frame_order import suggest_order
from .frames import Frames
from .gridding import footprint_grid
from .height_doubt import bow_mm
from .merge import LEVEL_CONTESTED, Merged, View, edge_weight, merge
from .mosaic import Offset, Placement, Seam, place_tiles, seam_between
from .optics import CHIPS, PAPER_SETUP, Figure, OpticsSetup, conflicts, work_out
from .patterns import PAPER_STRIPES, FrameRole, PatternSet
from .pixel_maps import Decoded, PointMap, Shared
from .reconstruct import reconstruct
from .regrid import covering_grid, regrid
from .resolution import ContrastCurve, DepthOfField, Roi, depth_of_field, object_pixel_um, usaf_contrast, usaf_line_um
from .rig_model import BoardCheck, Calibration, CornerResidual, Lens, PoseResidual
from .shared_board import site_to_site
from .slanted_edge import edge_contrast, find_edge
from .stripe_contrast import StripeContrast, stripe_contrast
from .subpixel import locate, refine
from .surface import scan_decoded, scan_frames, to_scan
from .triangulate import triangulate

__all__ = [
    "CAUSES",
    "CHIPS",
    "LEVEL_CONTESTED",
    "PAPER_SETUP",
    "PAPER_STRIPES",
    "Board",
    "BoardCheck",
    "Calibration",
    "CharucoBoard",
    "ContrastCurve",
    "CornerResidual",
    "Decoded",
    "DepthOfField",
    "Device",
    "DeviceName",
    "Diagnosis",
    "Figure",
    "Finding",
    "FrameRole",
    "Frames",
    "Lens",
    "Merged",
    "Offset",
    "OpticsSetup",
    "PatternSet",
    "Placement",
    "PointMap",
    "PoseResidual",
    "Roi",
    "Seam",
    "Shared",
    "StripeContrast",
    "View",
    "bow_mm",
    "calibrate",
    "calibrate_decoded",
    "calibration_verdict",
    "conflicts",
    "covering_grid",
    "decode",
    "depth_of_field",
    "describe_calibration",
    "device",
    "diagnose",
    "diagnose_stack",
    "edge_contrast",
    "edge_weight",
    "find_edge",
    "footprint_grid",
    "locate",
    "merge",
    "object_pixel_um",
    "place_tiles",
    "reconstruct",
    "refine",
    "regrid",
    "rms_verdict",
    "scan_decoded",
    "scan_frames",
    "seam_between",
    "site_to_site",
    "stripe_contrast",
    "suggest_order",
    "to_scan",
    "triangulate",
    "usaf_contrast",
    "usaf_line_um",
    "work_out",
]
