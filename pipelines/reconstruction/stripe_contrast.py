"""Stripe contrast: how well projected stripes are told apart, pixel by pixel and integrated along the stripes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .frames import Frames

__all__ = ["StripeContrast", "stripe_contrast"]

LIT = 0.15  # of the brightest white minus black: darker pixels tell of noise only


@dataclass(frozen=True, slots=True)
class StripeContrast:
    """Contrast of one stripe pattern over the lit pixels: 1 for sharp stripes, 0 for even grey.

    `single` is what a pixel sees, `integrated` what is left after a mean over a few pixels along the stripes, each less
    the noise; `noise` and `noise_integrated` are that noise, in the same measure. Stripes are told apart where the
    contrast stands well above its noise.
    """

    axis: str
    index: int
    single: float
    integrated: float
    noise: float
    noise_integrated: float


def stripe_contrast(frames: Frames, integrate_px: int = 15) -> tuple[StripeContrast, ...]:
    """Measure each pair of complementary patterns as the paper's section 4.2 does, with local integration.

    The measure is the root mean square of (pattern - inverse) / (white - black).

    Parameters
    ----------
    frames : Frames
        With white, black and complementary stripes; other patterns are left out.
    integrate_px : int
        Pixels of the mean along the stripes.

    Returns
    -------
    tuple of StripeContrast
        In the order of the patterns; empty where nothing is lit or no pattern has its inverse.
    """
    roles = {(role.what, role.axis, role.index, role.inverted): at for at, role in enumerate(frames.patterns.roles)}
    if not {("white", "", 0, False), ("black", "", 0, False)} <= roles.keys():
        return ()
    full = frames.stack[roles["white", "", 0, False]].astype(np.float32) - frames.stack[roles["black", "", 0, False]]
    lit = full > LIT * np.percentile(full, 99.5)
    if not lit.any() or full.max() <= 0:
        return ()
    found = []
    for (what, axis, index, inverted), at in roles.items():
        partner = roles.get((what, axis, index, True))
        if what != "bit" or inverted or partner is None:
            continue
        pair = frames.stack[at].astype(np.float32) - frames.stack[partner]
        share = np.where(lit, pair / np.where(lit, full, 1), 0).astype(np.float32)
        along = max((_measure(share, lit, integrate_px), _measure(share.T, lit.T, integrate_px)), key=lambda m: m[1])
        found.append(StripeContrast(axis, index, *along))
    return tuple(found)


def _measure(
    share: npt.NDArray[np.float32], lit: npt.NDArray[np.bool_], length: int
) -> tuple[float, float, float, float]:
    """Single, integrated, noise, noise integrated, for stripes that run down the image."""
    from scipy.ndimage import uniform_filter1d

    neighbours = lit[1:] & lit[:-1]
    noise = float(np.mean(np.diff(share, axis=0)[neighbours] ** 2)) / 2
    whole = uniform_filter1d(lit.astype(np.float32), length, axis=0, mode="constant") > 1 - 0.5 / length
    mean = uniform_filter1d(share, length, axis=0, mode="constant")
    if not whole.any():
        return 0.0, 0.0, noise**0.5, noise**0.5
    single = float(np.mean(share[whole] ** 2)) - noise
    integrated = float(np.mean(mean[whole] ** 2)) - noise / length
    below = (noise / length) ** 0.5
    return max(single, 0.0) ** 0.5, max(integrated, 0.0) ** 0.5, noise**0.5, below
