"""Reads a store and shows it: the Rerun timeline and the report."""

from .alarm_limits import rule_words
from .blueprint import PRESETS, Preset
from .calibration_report import calibration_page
from .catalog import serve_shards
from .findings import Findings, gather
from .glance import Glance, glance, newest_picture, page_style
from .live import LiveReview
from .record import check_not_empty, record_review
from .report import SECTIONS, write_findings, write_report
from .section import Figure, Section, Table
from .shards import Shards, cache_folder, update_shards
from .verdict import Verdict, judge_findings
from .viewer import NO_SCREEN, check_ports, has_screen, open_command, open_viewer, serve_web

__all__ = [
    "NO_SCREEN",
    "PRESETS",
    "SECTIONS",
    "Figure",
    "Findings",
    "Glance",
    "LiveReview",
    "Preset",
    "Section",
    "Shards",
    "Table",
    "Verdict",
    "cache_folder",
    "calibration_page",
    "check_not_empty",
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
    "serve_shards",
    "serve_web",
    "update_shards",
    "write_findings",
    "write_report",
]
