"""Captures of a rough surface with slopes, steps, cracks and a shadow, whose every pixel's place is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from pipelines import Frames, PatternSet
from pipelines.reconstruction import Decoded

from .synthetic_capture import NOON

Floats = npt.NDArray[np.float64]
DRAWN = 16


@dataclass(frozen=True)
class Rough:
    """What the light passes on its way; lengths in projector px unless they say camera.

    `blur_px` and `camera_blur_px` are standard deviations of Gaussians, `density` projector px per camera px, `gamma`
    the projector's response, `flicker` the standard deviation of its power (a share), `drift` what the room's light
    adds by the last frame (counts).
    """

    shape: tuple[int, int] = (480, 640)
    blur_px: float = 0.6
    camera_blur_px: float = 0.5
    density: float = 0.9
    light: float = 150.0
    noise: float = 2.0
    flicker: float = 0.008
    drift: float = 0.0
    gamma: float = 1.0
    mirrored: bool = False
    turned: bool = False
    seed: int = 0


def noise_field(random: np.random.Generator, shape: tuple[int, int], size: float) -> Floats:
    """Even noise of standard deviation about 0.3, smooth over `size` camera px."""
    field: Floats = gaussian_filter(random.standard_normal(shape), size) * size
    return field


def see(rough: Rough, patterns: PatternSet) -> tuple[Frames, Floats, Floats, npt.NDArray[np.bool_]]:
    """Frames, true column and row, and where the projector's light falls."""
    random = np.random.default_rng(rough.seed)
    rows, columns = rough.shape
    v, u = np.mgrid[:rows, :columns].astype(float)
    relief = 6 * noise_field(random, rough.shape, 12) + 3.6 * noise_field(random, rough.shape, 3)
    relief += np.where((u > 0.55 * columns) & (v > 0.3 * rows), 9.3, 0)
    relief -= np.where((u < 0.2 * columns) & (v < 0.5 * rows), 40.7, 0)
    relief += np.where(v > 0.75 * rows, (u % 150) * 0.35, 0)
    for _ in range(5):
        angle, wide, deep = random.uniform(0, np.pi), random.uniform(1.5, 8), random.uniform(8, 30)
        across = (u - random.uniform(0, columns)) * np.cos(angle) + (v - random.uniform(0, rows)) * np.sin(angle)
        across += 8 * np.sin((u + v) / 40)
        relief -= np.where(np.abs(across) < wide, deep * (1 - (across / wide) ** 4), 0)
    along, beside = (v, u) if rough.turned else (u, v)
    sign = -1 if rough.mirrored else 1
    column = patterns.size[0] / 2 + sign * rough.density * (along - along.mean()) + relief
    row = patterns.size[1] / 2 + rough.density * (beside - beside.mean()) + 0.02 * relief + 0.03 * along
    lit = (column > 0) & (column < patterns.size[0] - 1) & (row > 0) & (row < patterns.size[1] - 1)
    lit &= np.abs(u - 0.8 * columns + 0.3 * v) > 6
    albedo = 0.6 + 0.5 * noise_field(random, rough.shape, 2) + 0.4 * noise_field(random, rough.shape, 20)
    albedo = albedo.clip(0.12, 1)
    stack = []
    for number, (image, role) in enumerate(zip(patterns.images(), patterns.roles, strict=True)):
        shown = np.full(rough.shape, float(role.what == "white"))
        if role.axis:
            line = (image[0] if role.axis == "columns" else image[:, 0]) / 255.0
            fine = gaussian_filter1d(np.repeat(line**rough.gamma, DRAWN), rough.blur_px * DRAWN, mode="nearest")
            place = column if role.axis == "columns" else row
            shown = np.interp((place + 0.5) * DRAWN - 0.5, np.arange(fine.size), fine)
        lamp = rough.light * (1 + rough.flicker * random.standard_normal())
        room = 8 + rough.drift * number / len(patterns.roles)
        clean = albedo * (np.where(lit, 0.012 + 0.988 * shown, 0) * lamp + room)
        grey = gaussian_filter(clean, rough.camera_blur_px) + 2 + rough.noise * random.standard_normal(rough.shape)
        stack.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return Frames(np.stack(stack), NOON, patterns, 8.0), column, row, lit


@dataclass(frozen=True)
class Verdict:
    """How the places of an axis compare with the truth, at lit pixels."""

    kept: float
    """Share of the lit pixels that got a place."""
    count: int
    gross: int
    """Pixels more than `GROSS_PX` off."""
    sd_px: float
    """Robust standard deviation of the error."""
    chi: float
    """The same of error over sigma."""
    mean_px: float


GROSS_PX = 4.0


def judge(found: npt.NDArray[np.float32], sigma: npt.NDArray[np.float32], true: Floats, lit: npt.ArrayLike) -> Verdict:
    """Compare one axis with the truth."""
    known = np.isfinite(found) & lit
    error = (found - true)[known]
    ratio = error / sigma[known]
    robust = 1.4826 * np.median(np.abs([error, ratio]), axis=1)
    return Verdict(
        float(known.sum() / np.sum(lit)),
        int(known.sum()),
        int((np.abs(error) > GROSS_PX).sum()),
        float(robust[0]),
        float(robust[1]),
        float(error[np.abs(error) < 1].mean()),
    )


def judge_both(decoded: Decoded, column: Floats, row: Floats, lit: npt.ArrayLike) -> tuple[Verdict, Verdict]:
    """Compare both axes with the truth."""
    return (
        judge(decoded.column, decoded.sigma_column, column, lit),
        judge(decoded.row, decoded.sigma_row, row, lit),
    )
