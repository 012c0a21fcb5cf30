"""One scan against its baseline: register, move, subtract, and keep all that a metric may look at."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scan import Scan
from .difference import difference
from .motion import Motion
from .move import apply_motion
from .noise_model import NoiseModel
from .register import find_motion
from .values import Comparison

__all__ = ["compare"]


def compare(
    scan: Scan,
    baseline: Scan,
    stable: npt.NDArray[np.bool_] | None = None,
    region: npt.NDArray[np.bool_] | None = None,
    noise: NoiseModel | None = None,
    near: Motion | None = None,
) -> Comparison:
    """Compare a scan with its baseline.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    stable : ndarray of bool, shape (rows, columns), optional
        Ground that does not move; found if left out (see `register`).
    region : ndarray of bool, shape (rows, columns), optional
        Cells that count; everything if left out. Given stable areas are taken out of it, found ones are not: they
        are soil.
    noise : NoiseModel, optional
        Calibrated from repeat scans (`noise_model`); it then makes the level of detection and the volumes' uncertainty.
    near : Motion, optional
        Of a scan shortly before, onto the same baseline: in a video the scan is followed from there (see `register`).

    Returns
    -------
    Comparison
        With ``change.motion.verdict == "failed"`` the scan is left where it is and its numbers mean nothing: reject it.

    Raises
    ------
    ValueError
        If grids or shapes differ.
    """
    shape = baseline.grid.shape
    if region is not None and region.shape != shape:
        raise ValueError(f"region mask has shape {region.shape}, the grid {shape}")
    motion, held = find_motion(scan, baseline, stable, near)
    moved = apply_motion(scan, motion)
    counts = np.ones(shape, dtype=np.bool_) if region is None else region.copy()
    if stable is not None:
        counts &= ~stable
    return Comparison(baseline, moved, difference(moved, baseline, motion, noise), held, counts, noise)
