"""Scans of closed-form surfaces, for the tests of this room."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pipelines import LEVEL_NONE, Grid, Scan, parse_instant

Surface = Callable[[npt.NDArray[np.float64], npt.NDArray[np.float64]], npt.NDArray[np.float64]]


def scan_of(
    height: npt.NDArray[np.floating],
    pitch_mm: float = 0.02,
    *,
    sigma: float = 0.002,
    texture: npt.NDArray[np.floating] | None = None,
    hour: int = 0,
    origin: tuple[float, float] = (0.0, 0.0),
) -> Scan:
    rows, columns = height.shape
    grid = Grid(rows, columns, pitch_mm, *origin)
    z = height.astype(np.float32)
    good = np.isfinite(z)
    bright = np.full(z.shape, 128.0) if texture is None else texture
    return Scan(
        grid,
        parse_instant(f"2026-01-01T{hour:02d}:00:00Z"),
        z,
        np.where(good, np.float32(sigma), np.float32(np.nan)),
        np.clip(np.rint(bright), 0, 255).astype(np.uint8),
        np.where(good, 0, LEVEL_NONE).astype(np.uint8),
    )


def sampled(surface: Surface, rows: int = 160, columns: int = 200, pitch_mm: float = 0.02) -> npt.NDArray[np.float64]:
    y, x = np.mgrid[:rows, :columns] * pitch_mm
    return surface(x, y)


def bumps(seed: int = 0, count: int = 60) -> Surface:
    """A smooth rough surface that can be evaluated anywhere: a sum of plane waves of 0.1 to 0.8 mm."""
    random = np.random.default_rng(seed)
    wave = 2 * np.pi / random.uniform(0.1, 0.8, count)
    angle, phase = random.uniform(0, np.pi, count), random.uniform(0, 2 * np.pi, count)
    size = 0.05 / np.sqrt(count)

    def surface(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        z = np.zeros(np.broadcast(x, y).shape)
        for k, a, p in zip(wave, angle, phase, strict=True):
            z += size * np.sin(k * (x * np.cos(a) + y * np.sin(a)) + p)
        return z

    return surface


def soil_scan(
    folder: Path, name: str, epoch: int
) -> tuple[Scan, npt.NDArray[np.bool_], dict[str, npt.NDArray[np.float64]]]:
    """A soil surface of `soils`, its true crack mask and its truths."""
    with np.load(folder / "soils" / f"{name}.npz") as kept:
        truth = {key: kept[key].astype(np.float64) for key in kept.files}
    scan = scan_of(truth[f"height_t{epoch}"], float(truth["pitch_mm"]), sigma=0.003, hour=epoch)
    return scan, truth["edge_distance"] < truth["width_mm"][epoch] / 2, truth
