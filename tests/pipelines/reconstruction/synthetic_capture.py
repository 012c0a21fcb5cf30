"""Captures of a known map: every camera pixel sees a known place on the projector, through blur and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipelines import Frames, Instant, PatternSet

NOON = Instant("2026-01-01T12:00:00", "ns")


@dataclass(frozen=True)
class View:
    """Where camera pixels look on the projector, px, and how the light gets there."""

    column: npt.NDArray[np.float64]
    row: npt.NDArray[np.float64]
    light: float = 160.0
    dark: float = 12.0
    blur_px: float = 0.0
    noise: float = 0.0
    flicker: float = 0.0


def slanted(rows: int, columns: int, size: tuple[int, int], density: float = 0.45) -> View:
    """A view whose columns and rows both vary smoothly, not along the camera's axes."""
    v, u = np.mgrid[:rows, :columns].astype(float)
    column = 20.3 + density * u + 0.05 * v
    row = 11.7 + density * v + 0.03 * u
    return View(np.clip(column, 0, size[0] - 1), np.clip(row, 0, size[1] - 1))


def take(view: View, patterns: PatternSet, *, dtype: type = np.uint8, gain: float = 1.0, seed: int = 0) -> Frames:
    """Project, blur along both axes with a Gaussian of `blur_px` projector px, add noise, digitise."""
    rng = np.random.default_rng(seed)
    images = patterns.images().astype(np.float64) / 255
    frames = []
    column, row = np.rint(view.column).astype(int), np.rint(view.row).astype(int)
    for image, role in zip(images, patterns.roles, strict=True):
        if view.blur_px:
            from scipy.ndimage import gaussian_filter1d

            # patterns vary along one axis; drawn four times finer, so that a pixel is a square before it is blurred
            line, at = (image[:, 0], view.row) if role.axis == "rows" else (image[0], view.column)
            fine = gaussian_filter1d(np.repeat(line, 4), 4 * view.blur_px, mode="nearest")
            seen = np.interp(4 * at + 1.5, np.arange(fine.size), fine)
        else:
            seen = image[row, column]
        lamp = 1 + view.flicker * rng.standard_normal()
        value = gain * (view.dark + view.light * lamp * seen + view.noise * rng.standard_normal(seen.shape))
        frames.append(np.clip(np.rint(value), 0, np.iinfo(dtype).max).astype(dtype))
    return Frames(np.stack(frames), NOON, patterns, exposure_ms=8.0)
