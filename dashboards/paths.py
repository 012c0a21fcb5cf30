"""Where each thing lies in a recording: the entity paths that recorder and blueprint share."""

from __future__ import annotations

import re

__all__ = [
    "ABOUT",
    "ALARMS",
    "APPLICATION",
    "BASELINE",
    "CAMERA",
    "CHANGE",
    "CRACKS",
    "CRACK_TABLE",
    "CRACK_WIDTHS",
    "HEIGHT",
    "LEVEL",
    "LIMITS",
    "LOG",
    "MAP_PATHS",
    "PLACES",
    "PLATES",
    "PLATE_LIFTS",
    "PLATE_TABLE",
    "QUALITY",
    "REGISTRATION",
    "SCAN_TIMELINE",
    "SIGMA",
    "SURFACE",
    "SURFACE_PATHS",
    "TIME_TIMELINE",
    "TRENDS",
    "VISITS",
    "alarm",
    "limit",
    "trend",
]

APPLICATION = "microrelief"
TIME_TIMELINE = "time"
SCAN_TIMELINE = "scan"

SURFACE = "/surface"
SURFACE_PATHS = "/surface/paths"
BASELINE = "/baseline"
CHANGE = "/maps/change"
HEIGHT = "/maps/height"
SIGMA = "/maps/sigma"
LEVEL = "/maps/level"
CAMERA = "/maps/camera"
CRACKS = "/maps/cracks"
PLATES = "/maps/plates"
MAP_PATHS = "/maps/paths"
PLACES = "/maps/places"
CRACK_TABLE = "/tables/cracks"
PLATE_TABLE = "/tables/plates"
ABOUT = "/tables/scan"
CRACK_WIDTHS = "/cracks"
PLATE_LIFTS = "/plates"
QUALITY = "/quality"
TRENDS = "/trends"
LIMITS = "/limits"
VISITS = "/visits"
REGISTRATION = "/registration"
ALARMS = "/alarm"
LOG = "/log"


def trend(metric: str) -> str:
    """Path of one metric's trend."""
    return f"{TRENDS}/{metric}"


def limit(metric: str, number: int) -> str:
    """Path of one limit of a metric."""
    return f"{LIMITS}/{metric}/{number}"


def alarm(name: str) -> str:
    """Path of one alarm's lane; the viewer shows it as written, so blanks become underscores."""
    lane = re.sub(r"[^\w.-]+", "_", name).strip("_")
    return f"{ALARMS}/{lane or 'unnamed'}"
