"""Two height maps to what moved, how much, and how sure we are. Uses nothing of `reconstruction`."""

from .motion import Motion, Verdict
from .values import Change, Comparison, Measurement, Metric

__all__ = ["Change", "Comparison", "Measurement", "Metric", "Motion", "Verdict"]
