"""Two height maps to what moved, how much, and how sure we are. Uses nothing of `reconstruction`."""

from .compare import compare
from .crack_widths import CrackOpenings, crack_openings
from .cracks import CrackRule, crack_mask
from .curl import edge_lift
from .deposits import Deposit, find_deposits
from .difference import difference
from .m3c2 import Distances, m3c2
from .metrics import METRICS, measure
from .motion import Motion, Verdict
from .move import apply_motion
from .regions import polygon_mask
from .register import register
from .values import Change, Comparison, Measurement, Metric
from .volume import Volumes, volumes

__all__ = [
    "METRICS",
    "Change",
    "Comparison",
    "CrackOpenings",
    "CrackRule",
    "Deposit",
    "Distances",
    "Measurement",
    "Metric",
    "Motion",
    "Verdict",
    "Volumes",
    "apply_motion",
    "compare",
    "crack_mask",
    "crack_openings",
    "difference",
    "edge_lift",
    "find_deposits",
    "m3c2",
    "measure",
    "polygon_mask",
    "register",
    "volumes",
]
