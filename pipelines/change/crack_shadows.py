"""Where the rim of a crack lies whose wall is in shadow: where the light has fallen to half of what the rim has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .crack_edges import RIM_CELLS, STEP

__all__ = ["shadow_edges"]

Floats = npt.NDArray[np.float64]

HALF_LIGHT = 0.5
"""Of the rim's: a shadow's border blurred by any even point spread keeps its place at half the light."""
WITHIN_CELLS = 2.0
"""From where measurement begins: light that falls farther off is the ground's own colour."""


def shadow_edges(light: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_], begin: Floats) -> Floats:
    """Find the border of the shadow on profiles along which measurement begins at the rim.

    Optics spread the rim's light into the shadow, and what is lit faintly is measured at the rim's height: measurement
    begins inside of the rim, by as much as the point spread and the decoder let it. Where the light is half is the rim.

    Parameters
    ----------
    light : ndarray of float32, shape (profile, sample)
        Texture from the middle of the crack outward, `STEP` cells apart; NaN where not measured.
    inside : ndarray of bool, shape (profile, sample)
        Samples in the crack's mask.
    begin : ndarray of float64, shape (profile,)
        Where measurement begins, cells from the middle.

    Returns
    -------
    ndarray of float64, shape (profile,)
        Cells from the middle; NaN where the light does not fall to half near `begin`, or nothing is known of the rim.
    """
    samples = light.shape[1]
    lead, take = np.arange(samples), np.arange(light.shape[0])
    left = np.where((~inside).any(axis=1), np.argmax(~inside, axis=1), samples)[:, None]
    on_rim = (lead >= left + RIM_CELLS[0] / STEP) & (lead <= left + RIM_CELLS[1] / STEP) & ~inside & np.isfinite(light)
    known = on_rim.sum(axis=1) >= 3
    half = np.full(len(light), np.nan)
    half[known] = HALF_LIGHT * np.nanmedian(np.where(on_rim, light, np.nan)[known], axis=1)
    near = np.abs(lead * STEP - begin[:, None]) <= WITHIN_CELLS
    dark = near & (light < half[:, None])
    last = samples - 1 - np.argmax(dark[:, ::-1], axis=1)
    after = np.minimum(last + 1, samples - 1)
    low, high = light[take, last], light[take, after]
    found = known & dark.any(axis=1) & (high >= half)
    share = np.where(found, (half - low) / np.where(found, high - low, 1.0), 0.0)
    return np.where(found, (last + share) * STEP, np.nan)
