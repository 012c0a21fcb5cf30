"""Where each thing lies in a recording: the entity paths that recorder and blueprint share."""

from __future__ import annotations

import re

__all__ = [
    "ALARMS",
    "APPLICATION",
    "CAMERA",
    "CHANGE",
    "HEIGHT",
    "LOG",
    "REGISTRATION",
    "SCAN_TIMELINE",
    "SURFACE",
    "TIME_TIMELINE",
    "TRENDS",
    "VISITS",
    "alarm",
    "trend",
]

APPLICATION = "microrelief"
TIME_TIMELINE = "time"
SCAN_TIMELINE = "scan"

SURFACE = "/surface"
CHANGE = "/maps/change"
HEIGHT = "/maps/height"
CAMERA = "/camera"
TRENDS = "/trends"
VISITS = "/visits"
REGISTRATION = "/registration"
ALARMS = "/alarm"
LOG = "/log"


def trend(metric: str) -> str:
    """Path of one metric's trend."""
    return f"{TRENDS}/{metric}"


def alarm(name: str) -> str:
    """Path of one alarm's lane; the viewer shows it as written, so blanks become underscores."""
    lane = re.sub(r"[^\w.-]+", "_", name).strip("_")
    return f"{ALARMS}/{lane or 'unnamed'}"
