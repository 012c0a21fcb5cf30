"""Two scans on one grid to their difference and its level of detection."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..scan import Scan
from ..slabs import in_slabs
from .motion import Motion
from .noise_model import NoiseModel, local_slope
from .values import Change

__all__ = ["Z_95", "difference", "subtracted"]

Cells = npt.NDArray[np.float32]

Z_95 = 1.959963984540054
"""Two-sided 95 % point of the normal distribution."""


@njit(cache=True, nogil=True)
def _subtracted(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    now, then, sigma_now, sigma_then, z, shared, dz, lod, first, last
):
    for i in range(first, last):
        for j in range(now.shape[1]):
            change = now[i, j] - then[i, j]
            spread = np.sqrt(sigma_now[i, j] ** 2 + sigma_then[i, j] ** 2)
            dz[i, j] = change
            lod[i, j] = z * (spread + shared) if abs(change) < np.inf else np.float32(np.nan)


def subtracted(now: Scan, then: Scan) -> tuple[Cells, Cells]:
    """Difference of two scans' heights and its standard uncertainty, mm; NaN where either is NaN."""
    dz, sigma = np.empty_like(now.height), np.empty_like(now.height)
    given = now.height, then.height, now.sigma, then.sigma, np.float32(1), np.float32(0), dz, sigma
    in_slabs(len(dz), lambda first, last: _subtracted(*given, first, last), least=256)
    return dz, sigma


def difference(moved: Scan, baseline: Scan, motion: Motion, noise: NoiseModel | None = None) -> Change:
    """Subtract the baseline from a scan that was moved onto it (DoD, a difference of elevation models).

    Parameters
    ----------
    moved : Scan
        On the baseline's grid, after `motion`.
    baseline : Scan
    motion : Motion
        What was taken out; its vertical uncertainty widens the level of detection.
    noise : NoiseModel, optional
        Calibrated from repeat scans.

    Returns
    -------
    Change
        ``dz`` in mm; NaN where either scan is NaN. ``lod = 1.96 (sqrt(s1^2 + s2^2) + reg)``, the 95 % level of
        detection of Lague, Brodu and Leroux (2013, eq. 1) with each cell's own standard uncertainties in place
        of roughness over root n, and ``reg`` the vertical uncertainty of the registration, which they add
        linearly because every cell shares it. With a noise model ``lod = 1.96 sd``, sd the model's for the cell's
        sigmas and slope; by as much as this registration is less certain than those of the repeat scans, in
        quadrature, sd is greater.

    Raises
    ------
    ValueError
        If the scans lie on different grids.
    """
    if moved.grid != baseline.grid:
        raise ValueError(f"scans lie on different grids: {moved.grid} and {baseline.grid}")
    shared = motion.sigma_z_mm if np.isfinite(motion.sigma_z_mm) else 0.0
    dz, lod = np.empty_like(moved.height), np.empty_like(moved.height)
    given = moved.height, baseline.height, moved.sigma, baseline.sigma, np.float32(Z_95), np.float32(shared), dz, lod
    in_slabs(len(dz), lambda first, last: _subtracted(*given, first, last), least=256)
    if noise is not None:
        spread = np.sqrt(moved.sigma**2 + baseline.sigma**2)
        known = noise.sd(spread, local_slope(baseline.height, baseline.grid.pitch_mm))
        lod = np.float32(Z_95) * np.hypot(known, np.float32(np.sqrt(max(0.0, shared**2 - noise.sigma_z_mm**2))))
        lod[~np.isfinite(dz)] = np.nan
    return Change(baseline.grid, baseline.time, dz, lod, motion)
