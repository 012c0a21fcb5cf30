"""Keeps what pipelines define: stores of scans, folders of captures, files of other programs."""

from .capture_folder import read_capture, write_capture
from .ledger import Ledger, LedgerAddress, LedgerRow, SlotState, ledger_beside
from .pattern_file import read_patterns, write_patterns
from .store import STORES, About, Store, Stored, create_store, open_store

__all__ = [
    "STORES",
    "About",
    "Ledger",
    "LedgerAddress",
    "LedgerRow",
    "SlotState",
    "Store",
    "Stored",
    "create_store",
    "ledger_beside",
    "open_store",
    "read_capture",
    "read_patterns",
    "write_capture",
    "write_patterns",
]
