"""Reads a store and shows it: the Rerun timeline and the report."""

from .alarm_limits import rule_words
from .calibration_report import calibration_page
from .findings import Findings, gather
from .glance import Glance, glance, newest_picture, page_style
from .record import record_review
from .report import SECTIONS, write_findings, write_report
from .section import Figure, Section, Table
from .verdict import Verdict, judge_findings
from .viewer import NO_SCREEN, check_ports, has_screen, open_command, open_viewer, serve_web

__all__ = [
    "NO_SCREEN",
    "SECTIONS",
    "Figure",
    "Findings",
    "Glance",
    "Section",
    "Table",
    "Verdict",
    "calibration_page",
    "check_ports",
    "gather",
    "glance",
    "has_screen",
    "judge_findings",
    "newest_picture",
    "open_command",
    "open_viewer",
    "page_style",
    "record_review",
    "rule_words",
    "serve_web",
    "write_findings",
    "write_report",
]
