"""ScanTable: one row per scan of what is known beside its cells: times, epoch, registration, alarms, metrics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import AlarmState

from .icechunk_store import IcechunkStore
from .layout import metrics_of
from .repository import root_of
from .store import Store

__all__ = ["ScanTable", "scan_table", "table_of"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ScanTable:
    """All scans of a store, without their cells.

    Parameters
    ----------
    times, planned : ndarray of datetime64[ns], shape (scans,)
        When each was taken, and its slot of the schedule.
    epochs : ndarray of int, shape (scans,)
    verdicts : tuple of str
        Of the registration: ``good``, ``doubtful`` or ``failed``; empty for a baseline.
    calibrations : tuple of str
        Id of the calibration that placed each; empty for a height map from elsewhere.
    alarms : tuple of (mapping of str to str)
        State of each alarm after each scan.
    metrics : mapping of str to (ndarray of float64, ndarray of float64), each of shape (scans,)
        Values and standard uncertainties; NaN where not measured.
    """

    times: npt.NDArray[np.datetime64]
    planned: npt.NDArray[np.datetime64]
    epochs: npt.NDArray[np.int64]
    verdicts: tuple[str, ...]
    calibrations: tuple[str, ...]
    alarms: tuple[Mapping[str, AlarmState], ...]
    metrics: Mapping[str, tuple[Floats, Floats]]

    def __len__(self) -> int:
        return len(self.times)


def scan_table(store: Store) -> ScanTable:
    """Read the table of a store: a few small arrays, whatever the size of its maps."""
    if isinstance(store, IcechunkStore):
        return table_of(root_of(store.session))
    scans = [store[number] for number in range(len(store))]
    series = store.series()
    return ScanTable(
        np.array([each.scan.time for each in scans], dtype="datetime64[ns]"),
        np.array([each.planned for each in scans], dtype="datetime64[ns]"),
        np.array([each.epoch for each in scans], dtype=np.int64),
        tuple(each.change.motion.verdict if each.change is not None else "" for each in scans),
        tuple(each.scan.calibration_id for each in scans),
        tuple(each.alarms for each in scans),
        {name: (series[name].to_numpy(), series[f"{name}_sigma"].to_numpy()) for name in store.about.metrics},
    )


def table_of(root: Any) -> ScanTable:
    """Read the table below the root group of a store."""
    table = root["metrics"]
    return ScanTable(
        root["scans/time"][:].astype("datetime64[ns]"),
        root["scans/planned"][:].astype("datetime64[ns]"),
        root["scans/epoch"][:].astype(np.int64),
        tuple(str(verdict) for verdict in root["change/verdict"][:]),
        tuple(str(calibration) for calibration in root["scans/calibration"][:]),
        tuple(json.loads(str(states)) for states in root["scans/alarms"][:]),
        {name: (table[name][:], table[f"{name}_sigma"][:]) for name in metrics_of(table)},
    )
