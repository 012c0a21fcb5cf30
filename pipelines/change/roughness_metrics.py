"""Roughness followed through time: height parameters (ISO 25178-2) of the region, after one filter chain for all."""

from __future__ import annotations

from collections.abc import Callable

from .roughness import ROUGHNESS
from .shared_results import roughness_of
from .values import Comparison, Measurement, Metric

__all__ = ["ROUGHNESS_METRICS"]

FOLLOWED = ("Sa", "Sq", "Ssk", "Sku", "Sz")


def _parameter(name: str) -> Callable[[Comparison], Measurement]:
    def measure(comparison: Comparison) -> Measurement:
        return roughness_of(comparison).get(name, Measurement(float("nan"), float("nan")))

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
