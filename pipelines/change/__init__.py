"""Two height maps to what moved, how much, and how sure we are. Uses nothing of `reconstruction`."""

from .blocks import block_means
from .compare import compare
from .crack_depths import CrackDepths, crack_depths
from .crack_identity import CrackHistory, CrackLine, CrackSighting, CrackSightings, follow_cracks, next_cracks
from .crack_names import CrackEvent, CrackMemory
from .crack_sizes import CrackSize
from .crack_tips import CrackTip
from .crack_widths import CrackOpenings, crack_openings
from .cracks import CrackRule, crack_mask
from .curl import edge_lift
from .deposits import Deposit, find_deposits
from .difference import difference
from .m3c2 import Distances, m3c2
from .metrics import METRICS, measure
from .motion import Motion, Verdict
from .move import apply_motion
from .noise_model import NoiseCell, NoiseModel
from .objects import Expected, ObjectRule, StandingObject, find_objects
from .plate_identity import NamedPlates, PlateMemory, PlateSightings, follow_plates, name_plates
from .plates import Plate, find_plates, rim_slope
from .regions import polygon_mask
from .register import LEAST_CELLS, register
from .repeatability import noise_model, repeat_pairs, unrest
from .roughness import ROUGHNESS, Filters, filtered, roughness
from .stable import largest_consensus
from .substrate import Substrate, bare_substrate, update_substrate
from .tracking import Sighting, Sightings, follow_objects
from .values import Change, Comparison, Measurement, Metric
from .volume import Volumes, volumes

__all__ = [
    "LEAST_CELLS",
    "METRICS",
    "ROUGHNESS",
    "Change",
    "Comparison",
    "CrackDepths",
    "CrackEvent",
    "CrackHistory",
    "CrackLine",
    "CrackMemory",
    "CrackOpenings",
    "CrackRule",
    "CrackSighting",
    "CrackSightings",
    "CrackSize",
    "CrackTip",
    "Deposit",
    "Distances",
    "Expected",
    "Filters",
    "Measurement",
    "Metric",
    "Motion",
    "NamedPlates",
    "NoiseCell",
    "NoiseModel",
    "ObjectRule",
    "Plate",
    "PlateMemory",
    "PlateSightings",
    "Sighting",
    "Sightings",
    "StandingObject",
    "Substrate",
    "Verdict",
    "Volumes",
    "apply_motion",
    "bare_substrate",
    "block_means",
    "compare",
    "crack_depths",
    "crack_mask",
    "crack_openings",
    "difference",
    "edge_lift",
    "filtered",
    "find_deposits",
    "find_objects",
    "find_plates",
    "follow_cracks",
    "follow_objects",
    "follow_plates",
    "largest_consensus",
    "m3c2",
    "measure",
    "name_plates",
    "next_cracks",
    "noise_model",
    "polygon_mask",
    "register",
    "repeat_pairs",
    "rim_slope",
    "roughness",
    "unrest",
    "update_substrate",
    "volumes",
]
