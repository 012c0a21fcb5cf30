"""The sections of a report, one file each; each is a pure function of the findings."""

from .alarms import alarms
from .between import between, between_numbers
from .cracks import cracks
from .definitions import definitions
from .environment import environment
from .events import events
from .maps import maps
from .metrics import metrics
from .period import period
from .provenance import provenance
from .quality import quality
from .roughness import roughness
from .trends import trends
from .verdict import verdict
from .weekly import weekly

__all__ = [
    "alarms",
    "between",
    "between_numbers",
    "cracks",
    "definitions",
    "environment",
    "events",
    "maps",
    "metrics",
    "period",
    "provenance",
    "quality",
    "roughness",
    "trends",
    "verdict",
    "weekly",
]
