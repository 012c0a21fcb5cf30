"""Keeps what pipelines define: stores of scans, folders of captures, files of other programs."""

from .capture_folder import read_capture, read_image, write_capture
from .durable import whole_file
from .exporters import write_change, write_height_map, write_points, write_series
from .importers import read_height_map, read_raster, scan_of
from .ledger import Ledger, LedgerAddress, LedgerRow, SlotState, ledger_beside
from .lock import writer_of
from .pattern_file import read_patterns, write_patterns
from .rework import Rework
from .spread import Spread, engine
from .store import About, Store, Stored
from .stores import STORES, create_store, open_store

__all__ = [
    "STORES",
    "About",
    "Ledger",
    "LedgerAddress",
    "LedgerRow",
    "Rework",
    "SlotState",
    "Spread",
    "Store",
    "Stored",
    "create_store",
    "engine",
    "ledger_beside",
    "open_store",
    "read_capture",
    "read_height_map",
    "read_image",
    "read_patterns",
    "read_raster",
    "scan_of",
    "whole_file",
    "write_capture",
    "write_change",
    "write_height_map",
    "write_patterns",
    "write_points",
    "write_series",
    "writer_of",
]
