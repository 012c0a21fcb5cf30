"""How fast each place moves: a straight line through the coarse changes of every well registered scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.trends import RateMoments
from storage import ScanTable, Store, coarse_maps

__all__ = ["RateMap", "rate_map_of"]


@dataclass(frozen=True, slots=True, eq=False)
class RateMap:
    """Rate per day of each block of 8x8 cells and its standard uncertainty, mm; from so many scans."""

    rate: np.ndarray
    sigma: np.ndarray
    scans: int


def rate_map_of(store: Store, table: ScanTable, numbers: Sequence[int]) -> RateMap | None:
    """Fit the rate of each place to the well registered among some scans of one epoch.

    Parameters
    ----------
    store : Store
    table : ScanTable
    numbers : sequence of int
        Scans, in rising order; those of the newest one's epoch count.

    Returns
    -------
    RateMap or None
        None where there are too few.
    """
    if not numbers:
        return None
    epoch, newest = table.epochs[numbers[-1]], table.times[numbers[-1]]
    good = [each for each in numbers if table.epochs[each] == epoch and table.verdicts[each] == "good"]
    moments: RateMoments | None = None
    for number, dz in coarse_maps(store, good, "dz"):
        moments = moments or RateMoments(dz.shape)
        moments.add(float((table.times[number] - newest) / np.timedelta64(1, "D")), dz)
    if moments is None:
        return None
    rate, sigma = moments.rate()
    return RateMap(rate, sigma, len(good)) if np.isfinite(rate).any() else None
