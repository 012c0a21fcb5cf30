"""What several metrics of one comparison need: worked out once, by whichever thread asks first."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from threading import Lock
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from .crack_depths import CrackDepths, crack_depths
from .crack_widths import CrackOpenings, crack_openings
from .cracks import crack_mask
from .curl import crack_distance
from .plates import Plate, find_plates
from .roughness import Filters, height_parameters
from .values import Comparison, Measurement
from .volume import Volumes, volumes

__all__ = ["crack_of", "cracked", "depths_of", "forget", "openings_of", "plates_of", "roughness_of", "volumes_of"]

S_CELLS = 3.0
"""Nesting index of the S-filter, cells: the finest that the raster carries, as `microrelief roughness` takes it."""

Given = TypeVar("Given")
Result = TypeVar("Result")


class _Once(Generic[Given, Result]):
    """A function whose last result is kept, keyed by identity; of two threads that ask at once the second waits."""

    def __init__(self, work: Callable[[Given], Result]) -> None:
        self._kept, self._lock = lru_cache(maxsize=1)(work), Lock()

    def __call__(self, given: Given) -> Result:
        with self._lock:
            return self._kept(given)

    def forget(self) -> None:
        self._kept.cache_clear()


@_Once
def volumes_of(comparison: Comparison) -> Volumes:
    """Volumes of the region."""
    return volumes(comparison.change, comparison.region, comparison.stable, comparison.noise)


@_Once
def crack_of(comparison: Comparison) -> npt.NDArray[np.bool_]:
    """Crack cells of the region."""
    return crack_mask(comparison.scan) & comparison.region


@_Once
def baseline_crack(baseline: Scan) -> npt.NDArray[np.bool_]:
    """Crack cells of a baseline, all of them."""
    return crack_mask(baseline)


@_Once
def openings_of(comparison: Comparison) -> CrackOpenings:
    """Local widths of those cracks, and their centre lines."""
    return crack_openings(comparison.scan, crack_of(comparison))


@_Once
def depths_of(comparison: Comparison) -> CrackDepths:
    """Depths of those cracks."""
    return crack_depths(comparison.scan, crack_of(comparison), openings_of(comparison).lines)


@_Once
def cracked(comparison: Comparison) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
    """Cracks of now and of the baseline, and the distance to them."""
    # only within the region: the seam of a holder beside it is no crack
    crack = crack_of(comparison) | (baseline_crack(comparison.baseline) & comparison.region)
    return crack, crack_distance(crack, comparison.scan.grid.pitch_mm)


@_Once
def plates_of(comparison: Comparison) -> tuple[Plate, ...]:
    """Plates between the cracks of now and of the baseline."""
    now, then = crack_of(comparison), baseline_crack(comparison.baseline)
    return find_plates(comparison, now, then, cracked(comparison)[1])[1]


@_Once
def roughness_of(comparison: Comparison) -> Mapping[str, Measurement]:
    """Height parameters of the region's cells, cracks included, within the smallest rectangle that holds them."""
    region, scan = comparison.region, comparison.scan
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    if not rows.size:
        return {}
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    height = np.where(region[box], scan.height[box], np.float32(np.nan))
    pitch = scan.grid.pitch_mm
    return height_parameters(height, pitch, Filters(S_CELLS * pitch, form=1), scan.sigma[box])


def forget() -> None:
    """Let go of the last comparison: no scan outlives its tick. The baseline comes back with every scan of an epoch."""
    for kept in (volumes_of, crack_of, openings_of, depths_of, cracked, plates_of, roughness_of):
        kept.forget()
