"""Captures in which light reaches a pixel from elsewhere too: mirrored by a wall, or scattered inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from pipelines import Frames, PatternSet

from .synthetic_capture import NOON, View

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Stray:
    """Light from elsewhere, in the columns of the image from `first` on.

    Parameters
    ----------
    share : float
        Of the direct light of an unshadowed pixel.
    blur_px : float
        Gaussian blur of what is seen by it, projector px.
    shift_px : float, optional
        The pattern is seen mirrored at the column `first` looks at, and so much further down; else in place.
    direct : float
        Share of the direct light that is left: 0 in shadow.
    """

    share: float
    blur_px: float
    shift_px: float | None = None
    direct: float = 1.0
    first: int = 150


def take_scattered(
    view: View, patterns: PatternSet, stray: Stray, seed: int = 0
) -> tuple[Frames, npt.NDArray[np.bool_]]:
    """Frames, and which pixels the stray light reaches."""
    rng = np.random.default_rng(seed)
    reached = np.zeros(view.column.shape, bool)
    reached[10:-10, stray.first :] = True
    column, row = view.column, view.row
    if stray.shift_px is not None:
        wall = column[:, stray.first : stray.first + 1]
        column, row = 2 * wall - column - 8, row + stray.shift_px
    frames = []
    for image in patterns.images().astype(np.float32) / 255:
        fine = np.kron(image, np.ones((4, 4), np.float32))

        def seen(blur_px: float, column: Floats, row: Floats, fine: npt.NDArray[np.float32] = fine) -> Floats:
            blurred = gaussian_filter(fine, 4 * blur_px, mode="nearest")
            return np.asarray(map_coordinates(blurred, [4 * row + 1.5, 4 * column + 1.5], order=1, mode="nearest"))

        direct = seen(view.blur_px, view.column, view.row)
        other = stray.share * seen(float(np.hypot(stray.blur_px, view.blur_px)), column, row)
        light = np.where(reached, stray.direct * direct + other, direct)
        value = view.dark + view.light * light + view.noise * rng.standard_normal(light.shape)
        frames.append(np.clip(np.rint(value), 0, 255).astype(np.uint8))
    return Frames(np.stack(frames), NOON, patterns, exposure_ms=8.0), reached
