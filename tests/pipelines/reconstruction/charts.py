"""Charts with a known point spread: an edge and USAF bars, blurred by a Gaussian in closed form."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from pipelines.reconstruction import Roi, usaf_line_um

__all__ = ["bars", "edge", "transfer", "true_resolution_um"]

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]


def edge(
    shape: tuple[int, int], sigma_px: float, tilt_deg: float, noise: float = 0.5, *, lying: bool = False, seed: int = 0
) -> Image:
    """An edge through the middle, from 60 to 190 grey, tilted against the columns (or the rows: `lying`)."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(float)
    if lying:
        row, column = column, row
    tilt = np.deg2rad(tilt_deg)
    off = (column - column.max() / 2) * np.cos(tilt) + (row - row.max() / 2) * np.sin(tilt)
    grey: Floats = 60 + 65 * (1 + erf(off / (np.sqrt(2) * sigma_px)))
    return digitised(grey, noise, seed)


def bars(
    sigma_px: float, pixel_um: float, noise: float = 0.5, *, negative: bool = False, seed: int = 0
) -> tuple[Image, dict[tuple[int, int], Roi]]:
    """USAF elements of 1.2 to 14 px, dark on 190 grey (or bright on 40: `negative`), and a large square."""
    row, column = np.arange(420.0)[:, None], np.arange(900.0)[None, :]

    def box(left: float, right: float, top: float, bottom: float) -> Floats:
        across = erf((column - left) / (2**0.5 * sigma_px)) - erf((column - right) / (2**0.5 * sigma_px))
        down = erf((row - top) / (2**0.5 * sigma_px)) - erf((row - bottom) / (2**0.5 * sigma_px))
        product: Floats = 0.25 * across * down
        return product

    chart = box(20, 120, 20, 120)
    rois: dict[tuple[int, int], Roi] = {}
    x, y = 150.0, 90.0
    for group in range(-2, 10):
        for element in range(1, 7):
            w = usaf_line_um(group, element) / pixel_um
            if not 1.2 <= w <= 14:
                continue
            if x + 10 * w + 10 > 890:
                x, y = 150.0, y + 140
            x += 5 * w + 2.3
            for at in (-2 * w, 0.0, 2 * w):
                if element % 2:
                    chart += box(x + at - w / 2, x + at + w / 2, y - 2.5 * w, y + 2.5 * w)
                else:
                    chart += box(x - 2.5 * w, x + 2.5 * w, y + at - w / 2, y + at + w / 2)
            half = int(4.5 * w + 2)
            rois[group, element] = (int(x) - half, int(y) - half, 2 * half, 2 * half)
            x += 5 * w + 2.3
    return digitised(40 + 150 * (chart if negative else 1 - chart), noise, seed), rois


def digitised(grey: Floats, noise: float, seed: int) -> Image:
    noisy = grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def transfer(line_um: Floats, sigma_px: float, pixel_um: float) -> Floats:
    """Contrast of a sine of that line width behind a Gaussian."""
    contrast: Floats = np.exp(-2 * (np.pi * sigma_px * pixel_um / (2 * line_um)) ** 2)
    return contrast


def true_resolution_um(sigma_px: float, pixel_um: float, threshold: float = 0.02) -> float:
    """Line width whose sine has the threshold's contrast; never below one pixel."""
    return max(pixel_um, float(np.pi * sigma_px * pixel_um / np.sqrt(-2 * np.log(threshold))))
