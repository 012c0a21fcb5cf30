"""The sections of a report, one file each; each is a pure function of the findings."""

from .alarms import alarms
from .events import events
from .maps import maps
from .metrics import metrics
from .period import period
from .provenance import provenance
from .quality import quality
from .trends import trends
from .verdict import verdict

__all__ = ["alarms", "events", "maps", "metrics", "period", "provenance", "quality", "trends", "verdict"]
