"""Reads a store and shows it: the Rerun timeline and the report."""

from .alarm_limits import rule_words
from .blueprint import PRESETS, Preset
from .calibration_report import calibration_page
from .campaign_text import site_zone
from .catalog import serve_shards
from .comparison import gather_comparison
from .draw_tracks import read_tracks
from .findings import Findings, Period, gather, gather_numbers
from .glance import Glance, glance, newest_picture
from .happened import known_events
from .live import LiveReview
from .movie import MOVIE_SUFFIXES, write_movie
from .notebook import load_ipython_extension, show
from .page import fill_templates, page_style
from .record import check_not_empty, record_review
from .region import Region
from .report import SECTIONS, Layout, write_comparison, write_findings, write_report
from .section import Cell, Figure, Section, Table
from .shards import Shards, cache_folder, update_shards
from .verdict import Verdict, judge_findings
from .viewer import NO_SCREEN, behind_proxy, check_ports, has_screen, open_command, open_viewer, serve_web

__all__ = [
    "MOVIE_SUFFIXES",
    "NO_SCREEN",
    "PRESETS",
    "SECTIONS",
    "Cell",
    "Figure",
    "Findings",
    "Glance",
    "Layout",
    "LiveReview",
    "Period",
    "Preset",
    "Region",
    "Section",
    "Shards",
    "Table",
    "Verdict",
    "behind_proxy",
    "cache_folder",
    "calibration_page",
    "check_not_empty",
    "check_ports",
    "fill_templates",
    "gather",
    "gather_comparison",
    "gather_numbers",
    "glance",
    "has_screen",
    "judge_findings",
    "known_events",
    "load_ipython_extension",
    "newest_picture",
    "open_command",
    "open_viewer",
    "page_style",
    "read_tracks",
    "record_review",
    "rule_words",
    "serve_shards",
    "serve_web",
    "show",
    "site_zone",
    "update_shards",
    "write_comparison",
    "write_findings",
    "write_movie",
    "write_report",
]
