"""Roughness followed through time: height parameters (ISO 25178-2) of the region, after one filter chain for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from .roughness import ROUGHNESS, Filters, height_parameters
from .values import Comparison, Measurement, Metric

__all__ = ["ROUGHNESS_METRICS", "forget_roughness"]

S_CELLS = 3.0
"""Nesting index of the S-filter, cells: the finest that the raster carries, as `microrelief roughness` takes it."""
FOLLOWED = ("Sa", "Sq", "Ssk", "Sku", "Sz")


@lru_cache(maxsize=1)
def _heights(comparison: Comparison) -> Mapping[str, Measurement]:
    """Of the region's cells, cracks included, within the smallest rectangle that holds them."""
    region, scan = comparison.region, comparison.scan
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    if not rows.size:
        return {}
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    height = np.where(region[box], scan.height[box], np.float32(np.nan))
    pitch = scan.grid.pitch_mm
    return height_parameters(height, pitch, Filters(S_CELLS * pitch, form=1), scan.sigma[box])


def forget_roughness() -> None:
    """Let go of the last comparison: no scan outlives its tick."""
    _heights.cache_clear()


def _parameter(name: str) -> Callable[[Comparison], Measurement]:
    def measure(comparison: Comparison) -> Measurement:
        return _heights(comparison).get(name, Measurement(float("nan"), float("nan")))

    return measure


ROUGHNESS_METRICS = tuple(
    Metric(
        f"roughness_{name.lower()}",
        ROUGHNESS[name][0],
        f"Roughness {name}",
        f"ISO 25178-2: {ROUGHNESS[name][1]}; of the region, cracks included, after an S-filter of 3 cells and a plane.",
        _parameter(name),
        "What the scan's noise makes of it, its bias included" + ("; at least." if name == "Sz" else "."),
    )
    for name in FOLLOWED
)
"""Of the scan, not of its change: the baseline's own relief is in them."""
