"""A store of small scans made of real frames: a plane on which a block rises, seen by an exact rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from configs import Alarm
from monitor.visit import Epoch, Recipe, visit
from pipelines import Calibration, Frames, Grid, Instant, Lens, PatternSet
from storage import Packing, Store, create_store

CAMERA = (96, 72)
PATTERNS = PatternSet("gray", (184, 80), bits=(8, 7))
START = np.datetime64("2026-11-22T21:00:00", "ns")
GRID = Grid(40, 52, 1.0, -26.0, -20.0)
UNITS = {"net_volume": "mm3", "gained_volume": "mm3"}
ALARM = Alarm(name="block", metric="gained_volume", warn_above=300.0, alarm_above=900.0)
ALBEDO = gaussian_filter(np.random.default_rng(7).normal(0, 1, CAMERA[::-1]), 1.5)
ALBEDO = 1 + 0.15 * ALBEDO / ALBEDO.std()
STABLE = np.zeros(GRID.shape, dtype=bool)
STABLE[:6], STABLE[-6:] = True, True


def at(number: int) -> Instant:
    return START + np.timedelta64(number, "h")


def rig(baseline_mm: float = 40.0) -> Calibration:
    camera = Lens(CAMERA, np.array([[200.0, 0, 47.5], [0, 200.0, 35.5], [0, 0, 1]]), np.zeros(5))
    projector = Lens(PATTERNS.size, np.array([[200.0, 0, 47.5], [0, 200.0, 35.5], [0, 0, 1]]), np.zeros(5))
    site = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 100]])
    return Calibration(camera, projector, np.eye(3), np.array([baseline_mm, 0, 0]), site, {"stereo": 0.1})


def recipe(calibration: Calibration | None = None, **changes: object) -> Recipe:
    used = calibration or rig()
    made = Recipe(GRID, STABLE, None, tuple(UNITS), (ALARM,), patterns=PATTERNS, calibration=used, keep_frames=True)
    return replace(made, **changes)  # type: ignore[arg-type]  # any of its fields


def capture(number: int) -> Frames:
    """What the camera sees: a plane 100 mm away, and a block on it that grows nearer with each scan."""
    rng = np.random.default_rng(number)
    images: list[npt.NDArray[np.uint8]] = []
    row, column = np.mgrid[0 : CAMERA[1], 0 : CAMERA[0]]
    block = (abs(row - 36) < 12) & (abs(column - 48) < 14)
    # a rig with a baseline of 40 mm and f = 200 px sees depth Z at a disparity of 8000 / Z
    shift = np.where(block, 80 + number % 5, 80)
    for image in PATTERNS.images():
        light = image[row, np.clip(column + shift, 0, PATTERNS.size[0] - 1)] / 255 * 180.0 + 20
        images.append(np.clip(light * ALBEDO + rng.normal(0, 1, light.shape), 0, 255).astype(np.uint8))
    return Frames(np.stack(images), at(number), PATTERNS, 8.0)


def fill(path: str | Path, count: int, made: Recipe | None = None, without: tuple[int, ...] = ()) -> Store:
    """Make a store as a campaign does; `without` names scans whose frames are not kept."""
    made = made or recipe()
    store = create_store(path, site="block", grid=GRID, metrics=UNITS, packing=Packing("int32"))
    epoch = None
    for number in range(count):
        result = visit(capture(number), made, epoch, at(number))
        tick = result.tick
        stored = store.append(replace(tick, frames=None) if number in without else tick)
        assert stored == number
        baseline = store[number].scan if epoch is None or tick.change is None else epoch.baseline
        epoch = Epoch(baseline, result.watches)
    return store
