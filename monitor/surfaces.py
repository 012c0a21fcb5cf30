"""Surfaces that a command is given: capture folders, point maps and height maps of any scanner, all as scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from configs import CaptureError, InputError
from pipelines import Calibration, Frames, PatternSet, PointMap, Scan, instant
from pipelines import reconstruction as rec
from storage import holds_points, read_capture, read_height_map, read_points

from .progress import progress

__all__ = ["Surface", "measure_points", "noise_sigma_mm", "read_surfaces"]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A scan by its name, and the calibration's shared part of its sigma."""

    name: str
    scan: Scan
    bow_mm: float


def read_surfaces(
    paths: Sequence[Path], rigs: Sequence[Calibration | None], patterns: PatternSet | None, pitch_mm: float | None
) -> list[Surface]:
    """Read each path with its calibration.

    Height maps without sigma get the noise that their cells show against their neighbours; this is said on stdout.

    Raises
    ------
    InputError
        If a path is none of these, holds no measured cell, or needs a calibration that is not given.
    """
    names = [path.name or str(path) for path in paths]
    names = names if len(set(names)) == len(names) else [str(path) for path in paths]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{twice}: given twice")
    surfaces = []
    with progress("reading surfaces") as step:
        for number, (path, rig) in enumerate(zip(paths, rigs, strict=True), start=1):
            scan = _read(path, rig, patterns, pitch_mm)
            if not np.isfinite(scan.height).any():
                raise InputError(f"{path}: no cell of it was measured")
            name = names[number - 1]
            if not np.isfinite(scan.sigma).any():
                noise = noise_sigma_mm(scan)
                print(f"{name}: has no sigma; its noise from cell to cell is taken: {1000 * noise:.3g} um")
                sigma = np.where(np.isfinite(scan.height), np.float32(noise), np.float32(np.nan))
                scan = replace(scan, sigma=sigma)
            surfaces.append(Surface(name, scan, rec.bow_mm(rig) if rig is not None else 0.0))
            step(number, len(paths))
    return surfaces


def noise_sigma_mm(scan: Scan) -> float:
    """Standard deviation of a height map's noise, mm: from second differences, which even slopes do not enter."""
    h = scan.height.astype(np.float64)
    bend = h[:, 1:-1] - (h[:, :-2] + h[:, 2:]) / 2 if h.shape[1] > 2 else np.empty(0)
    bend = bend[np.isfinite(bend)]
    noise = 1.4826 * float(np.median(np.abs(bend))) / np.sqrt(1.5) if bend.size else 0.0
    return max(noise, 1e-6 * scan.grid.pitch_mm)


def _read(path: Path, rig: Calibration | None, patterns: PatternSet | None, pitch_mm: float | None) -> Scan:
    if not path.exists():
        raise InputError(f"{path}: no such capture folder or height map")
    if path.is_dir():
        if rig is None:
            raise InputError(f"{path}: is a capture, it needs the calibration.json of its rig: --calibration FILE")
        frames = read_capture(path, patterns)
        return rec.to_scan(measure_points(path, frames, rig), rig, rec.footprint_grid(rig, pitch_mm), frames.time)
    if holds_points(path):
        if rig is None:
            raise InputError(f"{path}: holds points, it needs the calibration.json of its rig: --calibration FILE")
        time = instant(datetime.fromtimestamp(path.stat().st_mtime, UTC))
        return rec.to_scan(read_points(path), rig, rec.footprint_grid(rig, pitch_mm), time)
    return read_height_map(path, print)


def measure_points(
    path: Path, frames: Frames, rig: Calibration, on: rec.Device | None = None, *, local_integration: bool = False
) -> PointMap:
    """Reconstruct the capture that was read from a folder, on the CPU or another device.

    Raises
    ------
    InputError
        If the frames are not of this rig.
    CaptureError
        If not one pixel was measured.
    """
    try:
        if local_integration:
            points = rec.reconstruct(frames, rig, local_integration=True)  # there is none on a GPU
        else:
            points = (on or rec.device("cpu")).reconstruct(frames, rig)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    if not points.valid.any():
        raise CaptureError(
            f"{path}: not one pixel could be measured: is the exposure right, and are these the right patterns?"
        )
    return points
