"""Keeps what pipelines define: stores of scans, folders of captures, files of other programs."""

from .capture_folder import read_capture, read_image, write_capture
from .care import Collected, Statistics, cite, collect, compact, expire, statistics
from .copying import copy_store
from .durable import whole_file
from .exporters import write_change, write_height_map, write_points, write_series
from .history import cell_history, coarse_maps, find_scan, line_history
from .importers import read_height_map, read_raster, scan_of
from .inbox import Inbox
from .ledger import Ledger, LedgerAddress, LedgerRow, LedgerWriteError, SlotState, ledger_beside
from .location import store_exists, writer_of
from .network import network_file_system
from .packing import Packing, fitting_packing
from .past import Snapshot, only_grown, snapshots
from .pattern_file import read_patterns, write_patterns
from .point_file import holds_points, read_points
from .rework import Rework
from .room import BYTES_PER_CELL, Room, full_at, room_of, used_bytes
from .scan_table import ScanTable, scan_table
from .spread import Spread, engine
from .stage_file import StageFile, StagePosition, read_stage
from .store import About, Store, Stored
from .stores import STORES, create_store, open_store
from .verification import Finding, Verified, verify

__all__ = [
    "BYTES_PER_CELL",
    "STORES",
    "About",
    "Collected",
    "Finding",
    "Inbox",
    "Ledger",
    "LedgerAddress",
    "LedgerRow",
    "LedgerWriteError",
    "Packing",
    "Rework",
    "Room",
    "ScanTable",
    "SlotState",
    "Snapshot",
    "Spread",
    "StageFile",
    "StagePosition",
    "Statistics",
    "Store",
    "Stored",
    "Verified",
    "cell_history",
    "cite",
    "coarse_maps",
    "collect",
    "compact",
    "copy_store",
    "create_store",
    "engine",
    "expire",
    "find_scan",
    "fitting_packing",
    "full_at",
    "holds_points",
    "ledger_beside",
    "line_history",
    "network_file_system",
    "only_grown",
    "open_store",
    "read_capture",
    "read_height_map",
    "read_image",
    "read_patterns",
    "read_points",
    "read_raster",
    "read_stage",
    "room_of",
    "scan_of",
    "scan_table",
    "snapshots",
    "statistics",
    "store_exists",
    "used_bytes",
    "verify",
    "whole_file",
    "write_capture",
    "write_change",
    "write_height_map",
    "write_patterns",
    "write_points",
    "write_series",
    "writer_of",
]
