"""The surface on which things move: what each cell shows when nothing is on it, and how it changes beneath them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..scan import Scan

__all__ = ["Substrate", "bare_substrate", "update_substrate"]

Floats = npt.NDArray[np.float32]

FOLLOW = 0.2
"""Share of the way that the level goes towards each new height that belongs to it."""
WITHIN = 4.0
"""A height within so many standard uncertainties of the level belongs to it."""
LEAST_MM = 0.01
"""And one within this, whatever the uncertainty: what one bite takes is no object."""
TWICE = 2
"""A lower height is believed once it was seen so many times running: a single one may be an error."""


@dataclass(frozen=True, slots=True, eq=False)
class Substrate:
    """Height of the bare substrate as far as scans have shown it.

    Parameters
    ----------
    level : ndarray of float32, shape (rows, columns)
        mm; NaN where nothing was measured yet.
    sigma : ndarray of float32, shape (rows, columns)
        Standard uncertainty of `level`, mm.
    below : ndarray of uint8, shape (rows, columns)
        How many times running a cell was seen lower than `level`.
    """

    level: Floats
    sigma: Floats
    below: npt.NDArray[np.uint8]


def bare_substrate(scans: Iterable[Scan]) -> Substrate | None:
    """Find the substrate from some scans through which everything on it has moved by its own length.

    Raises
    ------
    ValueError
        If the scans are not on one grid.
    """
    found: Substrate | None = None
    for scan in scans:
        found = update_substrate(found, scan)
    return found


def update_substrate(before: Substrate | None, scan: Scan) -> Substrate:
    """Take one more scan into account.

    A height within 4 sigma (or 10 um) of the level belongs to the substrate, and the level goes a fifth of the
    way towards it: so it follows what is taken away bit by bit. A height farther below, seen twice running, becomes the
    level at once: what was taken for substrate had been something on it, which went away. What lies higher lies on the
    substrate and tells nothing of it.

    Parameters
    ----------
    before : Substrate or None
        None before the first scan, all of which is then taken for substrate.
    scan : Scan

    Returns
    -------
    Substrate

    Raises
    ------
    ValueError
        If the scan is not on the grid of those before.
    """
    height, sigma = scan.height, scan.sigma
    if before is None:
        return Substrate(height.copy(), sigma.copy(), np.zeros(height.shape, np.uint8))
    if before.level.shape != height.shape:
        raise ValueError(f"a scan of {height.shape} cells, but the substrate has {before.level.shape}")
    seen = np.isfinite(height)
    fresh = seen & ~np.isfinite(before.level)
    off = height - before.level
    slack = np.maximum(WITHIN * np.hypot(before.sigma, sigma), np.float32(LEAST_MM))
    same = np.abs(off) <= slack  # false for NaN
    lower = off < -slack
    below = np.where(lower, before.below + np.uint8(1), np.where(seen, np.uint8(0), before.below)).astype(np.uint8)
    fallen = below >= TWICE
    below[fallen] = 0
    level = np.where(same, before.level + np.float32(FOLLOW) * off, before.level)
    spread = np.where(same, np.hypot(np.float32(1 - FOLLOW) * before.sigma, np.float32(FOLLOW) * sigma), before.sigma)
    new = fresh | fallen
    return Substrate(
        np.where(new, height, level).astype(np.float32), np.where(new, sigma, spread).astype(np.float32), below
    )
