"""Reads a store and shows it: the Rerun timeline and the report."""

from .alarm_limits import rule_words
from .calibration_report import calibration_page
from .campaign_text import site_zone
from .comparison import gather_comparison
from .findings import Findings, Period, gather, gather_numbers
from .glance import Glance, glance, newest_picture
from .movie import MOVIE_SUFFIXES, write_movie
from .notebook import load_ipython_extension, show
from .page import fill_templates, page_style
from .record import record_review
from .region import Region
from .report import SECTIONS, Layout, write_comparison, write_findings, write_report
from .section import Cell, Figure, Section, Table
from .verdict import Verdict, judge_findings
from .viewer import NO_SCREEN, check_ports, has_screen, open_command, open_viewer, serve_web

__all__ = [
    "MOVIE_SUFFIXES",
    "NO_SCREEN",
    "SECTIONS",
    "Cell",
    "Figure",
    "Findings",
    "Glance",
    "Layout",
    "Period",
    "Region",
    "Section",
    "Table",
    "Verdict",
    "calibration_page",
    "check_ports",
    "fill_templates",
    "gather",
    "gather_comparison",
    "gather_numbers",
    "glance",
    "has_screen",
    "judge_findings",
    "load_ipython_extension",
    "newest_picture",
    "open_command",
    "open_viewer",
    "page_style",
    "record_review",
    "rule_words",
    "serve_web",
    "show",
    "site_zone",
    "write_comparison",
    "write_findings",
    "write_movie",
    "write_report",
]
