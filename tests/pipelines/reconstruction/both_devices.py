"""Captures that take every way through a reconstruction, and what differs between two devices that go it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from pipelines import Calibration, Frames, Instant, PatternSet, Shared
from pipelines.reconstruction import Device, footprint_grid
from pipelines.reconstruction.pinhole import project, undistort
from tests.pipelines.reconstruction.exact_rig import Floats, make_rig

NOON = Instant("2026-01-01T12:00:00", "ns")


@dataclass(frozen=True)
class Scene:
    """A capture with its rig; `pitches` are cells in pixels of the camera."""

    name: str
    frames: Frames
    rig: Calibration
    pitches: tuple[float, ...] = (1.0,)


def scenes(columns: int, rows: int) -> Iterator[Scene]:
    """Captures of this size: each takes branches that the others do not."""
    rig = _rig(columns, rows)
    gray = PatternSet("gray", rig.projector.size)
    yield Scene("waves with a crack", shoot(rig, gray), rig, (1.0, 0.4, 6.0))
    yield Scene("a part out of focus", shoot(rig, gray, soft=4.0), rig)
    yield Scene("without inverses", shoot(rig, replace(gray, complementary=False)), rig)
    yield Scene("one axis, 16 bits", shoot(rig, replace(gray, bits=(10, 0)), dtype=np.uint16), rig)
    yield Scene(
        "phases, before a far wall", shoot(rig, PatternSet("phase", rig.projector.size, bits=(5, 5)), wall=True), rig
    )


def _rig(columns: int, rows: int) -> Calibration:
    """The exact rig with a projector as coarse as suits a camera of few pixels, and with a doubt of its own."""
    rig = make_rig((columns, rows))
    share = columns / 640
    wide, high = (max(16, round(side * share)) for side in rig.projector.size)
    K = np.diag([wide / rig.projector.size[0], high / rig.projector.size[1], 1]) @ rig.projector.K
    doubt = {"field": {"map_um": [[1.0, 2.0, 1.5], [0.5, 0.2, 0.9], [2.0, 3.0, 1.0]]}}
    return replace(rig, projector=replace(rig.projector, size=(wide, high), K=K), sigma=doubt)


def shoot(
    rig: Calibration,
    patterns: PatternSet,
    *,
    soft: float = 0.0,
    wall: bool = False,
    dtype: type = np.uint8,
    seed: int = 1,
) -> Frames:
    """What the rig's camera sees of waves with a crack; `soft` blurs the projector's image in a third of the field."""
    columns, rows = rig.camera.size
    pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    rays = np.concatenate([undistort(rig.camera, pixels), np.ones((rows, columns, 1))], axis=-1)
    turned = rays @ rig.reference[:, :3].T
    depth = np.full((rows, columns), -rig.reference[2, 3] / rig.reference[2, 2])
    for _ in range(4):  # the camera looks nearly straight down: this converges at once
        site = turned * depth[..., None] + rig.reference[:, 3]
        depth += (site[..., 2] - _relief(site[..., 0], site[..., 1], wall)) / -turned[..., 2]
    lit_at = project(rig.projector, rays * depth[..., None] @ rig.R.T + rig.t_mm)
    column, row = np.rint(lit_at[..., 0]).astype(int), np.rint(lit_at[..., 1]).astype(int)
    wide, high = patterns.size
    lit = (column >= 0) & (column < wide) & (row >= 0) & (row < high) & (site[..., 1] > site[..., 1].min() + 0.4)
    column, row = np.where(lit, column, 0), np.where(lit, row, 0)
    random = np.random.default_rng(seed)
    gain = 1 if dtype is np.uint8 else 256
    stack: npt.NDArray[Any] = np.empty((len(patterns.roles), rows, columns), dtype)
    for frame, image in zip(stack, patterns.images(), strict=True):
        shown = image.astype(np.float32)
        light = np.where(lit, shown[row, column], 0)
        if soft:
            light[:, : columns // 3] = np.where(lit, gaussian_filter(shown, soft)[row, column], 0)[:, : columns // 3]
        light = gaussian_filter(light, 0.5) + random.normal(0, 1.5, light.shape)
        frame[:] = np.clip(np.rint(gain * (20 + 0.6 * light)), 0, np.iinfo(dtype).max)
    return Frames(stack, NOON, patterns)


def _relief(x: Floats, y: Floats, wall: bool) -> Floats:
    waves: Floats = 0.25 * np.sin(1.1 * x) * np.cos(0.9 * y) + 0.02 * np.sin(9 * x + 5 * y)
    waves = np.where(np.abs(x - 0.3 * y - 1) < 0.4, waves - 0.9, waves)
    return np.where(y > 1.5, waves - 14, waves) if wall else waves


@dataclass(frozen=True)
class Difference:
    """How two arrays of one name differ."""

    what: str
    same: float
    """Share of values that are equal to the last bit; NaN is equal to NaN."""
    masks: int
    """Values that are NaN in one of them only; for whole numbers those that differ."""
    most: float
    """Largest difference where both are numbers."""
    high: float
    """99.99th percentile of it."""
    measured: float
    """Share of values that are numbers in the first."""


def differences(ours: Any, theirs: Any) -> list[Difference]:
    """Compare the arrays of two point maps or two scans."""
    found = []
    for field in fields(ours):
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        if isinstance(a, np.ndarray):
            found.append(_difference(field.name, a, b))
    return found


def _difference(what: str, a: npt.NDArray[Any], b: npt.NDArray[Any]) -> Difference:
    if a.dtype.kind != "f":
        other = int((a != b).sum())
        return Difference(what, float((a == b).mean()), other, float(other > 0), 0.0, 1.0)
    known, also = ~np.isnan(a), ~np.isnan(b)
    off = np.abs(a[known & also].astype(np.float64) - b[known & also])
    same = float(((a == b) | ~(known | also)).mean())
    most, high = (float(off.max()), float(np.quantile(off, 0.9999))) if off.size else (0.0, 0.0)
    return Difference(what, same, int((known != also).sum()), most, high, float(known.mean()))


def both(scene: Scene, one: Device, other: Device) -> Iterator[tuple[str, list[Difference]]]:
    """Go all three ways on both devices, and tell what differs."""
    points = one.reconstruct(scene.frames, scene.rig)
    yield "points", differences(points, other.reconstruct(scene.frames, scene.rig))
    usual = footprint_grid(scene.rig).pitch_mm
    for pitch in scene.pitches:
        grid = footprint_grid(scene.rig, pitch * usual)
        scan = one.scan_frames(scene.frames, scene.rig, grid)
        yield f"cells of {pitch:g} px", differences(scan, other.scan_frames(scene.frames, scene.rig, grid))
    variance = float(np.nanmedian(points.sigma_z)) ** 2
    sharing = replace(points, shared=Shared(0.5 * variance, 0.3 * variance))  # small images tell nothing of it
    given = sharing, scene.rig, footprint_grid(scene.rig, 2 * usual), scene.frames.time
    yield "of a point map", differences(one.to_scan(*given), other.to_scan(*given))
