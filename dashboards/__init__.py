"""Reads a store and shows it: the Rerun timeline and the report."""

from .record import record_review
from .viewer import NO_SCREEN, check_ports, has_screen, open_viewer, serve_web

__all__ = [
    "NO_SCREEN",
    "check_ports",
    "has_screen",
    "open_viewer",
    "record_review",
    "serve_web",
]
