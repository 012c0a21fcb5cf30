"""Scan: one height map with its uncertainty, texture and level, on a Grid, at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .grid import Grid
from .instant import Instant, check_instant

__all__ = ["LEVEL_NONE", "Scan"]

LEVEL_NONE = 255
"""`Scan.level` of a cell that was not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A height map.

    Parameters
    ----------
    grid : Grid
    time : Instant
        When the capture began, UTC.
    height : ndarray of float32, shape (rows, columns)
        mm above the reference plane; NaN means not measured, never 0.
    sigma : ndarray of float32, shape (rows, columns)
        Standard uncertainty of `height`, mm; NaN where `height` is NaN.
    texture : ndarray of uint8, shape (rows, columns)
        Brightness under full light, scaled to 8 bits.
    level : ndarray of uint8, shape (rows, columns)
        0 where the finest stripes were resolved, n where only the n-th coarser ones were,
        `LEVEL_NONE` where nothing was measured.
    calibration_id : str
        Content hash of the calibration that placed the cells; empty for an imported height map.
    """

    grid: Grid
    time: Instant
    height: npt.NDArray[np.float32]
    sigma: npt.NDArray[np.float32]
    texture: npt.NDArray[np.uint8]
    level: npt.NDArray[np.uint8]
    calibration_id: str = ""

    def __post_init__(self) -> None:
        check_instant(self.time, "scan time")
        for name, dtype in (("height", np.float32), ("sigma", np.float32), ("texture", np.uint8), ("level", np.uint8)):
            array = getattr(self, name)
            if array.shape != self.grid.shape or array.dtype != dtype:
                raise ValueError(
                    f"scan {name} must be {np.dtype(dtype)} of shape {self.grid.shape}, "
                    f"not {array.dtype} of shape {array.shape}"
                )

    @property
    def coverage(self) -> float:
        """Share of cells that were measured, 0 to 1."""
        return np.count_nonzero(np.isfinite(self.height)) / self.height.size
