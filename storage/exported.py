"""Exported: the one map that formats hold which know no more than heights, of a scan or of a change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines import Change, Grid, Instant, Scan

__all__ = ["MM_PER_M", "Exported", "of_change", "of_scan"]

MM_PER_M = 1000.0
Z_95 = 1.96
"""A level of detection at 95 % is so many standard uncertainties."""


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """Heights or changes in mm with their standard uncertainty and brightness, each of shape (rows, columns)."""

    grid: Grid
    time: Instant
    cells: npt.NDArray[np.float32]
    sigma: npt.NDArray[np.float32]
    texture: npt.NDArray[np.uint8]
    title: str
    calibration_id: str = ""


def of_scan(scan: Scan) -> Exported:
    """Take what a scan has for formats that know no more."""
    return Exported(scan.grid, scan.time, scan.height, scan.sigma, scan.texture, "height", scan.calibration_id)


def of_change(change: Change, time: Instant) -> Exported:
    """Take a change as if it were heights; its brightness is an even grey."""
    grey = np.full(change.grid.shape, 128, np.uint8)
    return Exported(change.grid, time, change.dz, (change.lod / np.float32(Z_95)), grey, "change")
