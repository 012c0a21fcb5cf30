"""Keeps what pipelines define: stores of scans, folders of captures, files of other programs."""

from .store import About, Store, Stored

__all__ = ["About", "Store", "Stored"]
