"""Keeps what pipelines define: stores of scans, folders of captures, files of other programs."""

from .capture_folder import read_capture, read_image, write_capture
from .durable import whole_file
from .exporters import write_height_map, write_points, write_series
from .history import cell_history, find_scan, line_history
from .importers import read_height_map
from .ledger import Ledger, LedgerAddress, LedgerRow, SlotState, ledger_beside
from .location import store_exists, writer_of
from .network import network_file_system
from .past import Snapshot, snapshots
from .pattern_file import read_patterns, write_patterns
from .point_file import holds_points, read_points
from .stage_file import StageFile, StagePosition, read_stage
from .store import About, Store, Stored
from .stores import STORES, create_store, open_store

__all__ = [
    "STORES",
    "About",
    "Ledger",
    "LedgerAddress",
    "LedgerRow",
    "SlotState",
    "Snapshot",
    "StageFile",
    "StagePosition",
    "Store",
    "Stored",
    "cell_history",
    "create_store",
    "find_scan",
    "holds_points",
    "ledger_beside",
    "line_history",
    "network_file_system",
    "open_store",
    "read_capture",
    "read_height_map",
    "read_image",
    "read_patterns",
    "read_points",
    "read_stage",
    "snapshots",
    "store_exists",
    "whole_file",
    "write_capture",
    "write_height_map",
    "write_patterns",
    "write_points",
    "write_series",
    "writer_of",
]
