"""Cracks of soils that no rule was tuned on: found where they are, as long, wide and voluminous as the truth says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from pipelines import Scan
from pipelines.change import CrackOpenings, crack_depths, crack_mask, crack_openings
from pipelines.change.crack_lines import crack_lines
from pipelines.scenes import CrackNetwork, Soil
from pipelines.scenes.noise import fractal
from tests.pipelines.change.scans import scan_of

PITCH = 0.01
HALF = 3.2
PARTS = 2
"""Cells are means over so many points squared."""
NOISE = 0.003
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Known:
    """A scan and what is true of it; `widths` gives the true width of the nearest crack at any place."""

    scan: Scan
    crack: npt.NDArray[np.bool_]
    width: Floats
    length_mm: float
    volume_mm3: float


def axes() -> tuple[Floats, Floats]:
    points = -HALF + (np.arange(round(2 * HALF / PITCH) * PARTS) + 0.5) * PITCH / PARTS
    x, y = np.meshgrid(points, points)
    return x, y


def cells_of(values: Floats) -> Floats:
    count = values.shape[0] // PARTS
    mean: Floats = values.reshape(count, PARTS, count, PARTS).mean(axis=(1, 3))
    return mean


def known(
    height: Floats, distance: Floats, width: Floats, depth: Floats, length_mm: float, seed: int, stretch: Floats
) -> Known:
    noise = np.random.default_rng(seed).normal(0, NOISE, (height.shape[0] // PARTS,) * 2)
    first = -HALF + PITCH / 2
    scan = scan_of(cells_of(height) + noise, PITCH, sigma=NOISE, origin=(first, first))
    inside = cells_of((distance < width / 2).astype(np.float64)) > 0.5
    return Known(scan, inside, cells_of(width / stretch), length_mm, float(depth.sum()) * (PITCH / PARTS) ** 2)


def stretch_of(distance: Floats) -> Floats:
    """Distance per mm of true distance: the bend of the centre lines makes it differ from 1."""
    dy, dx = np.gradient(distance, PITCH / PARTS)
    stretch: Floats = np.clip(np.hypot(dx, dy), 0.5, 2.0)
    return stretch


def drying_soil(seed: int, age_h: float) -> Known:
    """The scene of the simulated rig: floors of the fourth power, plates that curl, widths that vary along cracks."""
    soil = Soil(seed=seed)
    x, y = axes()
    ground = soil.at(x, y)
    width, bare = ground.width(age_h), Soil(seed=seed, depth_mm=0.0, lift_mm=0.0).at(x, y)
    inside = ground.distance < width / 2
    level = bare.height(age_h)
    # at the middle of the crack everything below the plates' rims is missing
    across = np.clip(1 - (2 * ground.distance / width) ** 4, 0, None)
    rim = soil_lift(soil, ground.width(age_h)) + level
    depth = np.where(inside, rim - ground.height(age_h), 0.0)
    assert np.all(depth[across == 0] < 1e-9)
    length = float(soil.cracks().lines((-HALF, HALF, -HALF, HALF)).length_mm.sum())
    return known(ground.height(age_h), ground.distance, width, depth, length, seed, stretch_of(ground.distance))


def soil_lift(soil: Soil, width: Floats) -> Floats:
    """The rims' lift goes with the opening from place to place."""
    lift: Floats = soil.lift_mm * (width - soil.hairline_mm) / soil.opening_mm
    return lift


def parabolic_soil(seed: int, width_mm: float) -> Known:
    """As `shared/data/soils` describes theirs: parabolic floors, one width, exp(-d / 0.8 mm) curl, grains and waves."""
    random = np.random.default_rng(seed)
    spacing = 2.6
    lattice = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4), indexing="ij"), axis=-1)
    network = CrackNetwork(((lattice + 0.5 + random.uniform(-0.38, 0.38, lattice.shape)) * spacing).reshape(-1, 2))
    x, y = axes()
    distance = network.distance(x, y)
    relief = 0.10 * fractal(x, y, seed, 3.0, 4) + 0.03 * fractal(x, y, seed + 1, 0.25, 3, 0.6)
    curl = 0.08 * np.exp(-np.maximum(0, distance - width_mm / 2) / 0.8)
    depth = 2.5 * width_mm * np.clip(1 - (2 * distance / width_mm) ** 2, 0, None)
    length = float(network.lines((-HALF, HALF, -HALF, HALF)).length_mm.sum())
    width = np.full(x.shape, width_mm)
    return known(relief + curl - depth, distance, width, depth, length, seed, stretch_of(distance))


def bias_of(found: CrackOpenings, truth: Known) -> float:
    """Mean over the cracks of opening less the true width at the same place.

    Where two cracks have swallowed the plate between them the one that is left is wider than either: not counted.
    """
    inside = ndimage.distance_transform_edt(truth.crack) * PITCH
    lines, use = found.lines, found.lines.inner
    half = inside[np.rint(lines.row[use]).astype(int), np.rint(lines.column[use]).astype(int)]
    nominal = truth.width[np.rint(lines.row[use]).astype(int), np.rint(lines.column[use]).astype(int)]
    seen = np.isfinite(found.opening_mm) & (2 * half < 1.25 * nominal + 2 * PITCH)
    assert seen.mean() > 0.7
    row, column = (
        np.rint((at[seen] + HALF - PITCH / 2) / PITCH).astype(int).clip(0, truth.width.shape[0] - 1)
        for at in (found.y_mm, found.x_mm)
    )
    near = [np.roll(truth.width, (dr, dc), (0, 1))[row, column] for dr in (-4, 0, 4) for dc in (-4, 0, 4)]
    return float(np.average(found.opening_mm[seen] - np.median(near, axis=0), weights=found.step_mm[seen]))


def judge(truth: Known, least_overlap: float, title: str, *, narrow: bool) -> None:
    mask = crack_mask(truth.scan)
    found = crack_openings(truth.scan, mask)
    overlap = float((mask & truth.crack).sum() / (mask | truth.crack).sum())
    # lines of the true mask: where it is as wide as its plates, fewer than the closed form has
    true_length = float(crack_lines(truth.crack).step.sum()) * PITCH
    length = float(found.lines.step.sum()) * PITCH / true_length - 1
    volume = crack_depths(truth.scan, mask, found.lines).volume.value / truth.volume_mm3 - 1
    bias = bias_of(found, truth)
    print(
        f"{title}: IoU {overlap:.3f}, length {100 * length:+.1f} %, width {1000 * bias:+.1f} um, "
        f"volume {100 * volume:+.1f} %"
    )
    assert overlap >= least_overlap
    assert abs(length) < 0.1
    if narrow:
        assert true_length == pytest.approx(truth.length_mm, rel=0.06)
    assert abs(volume) < 0.1
    assert abs(bias) <= 0.005


@pytest.mark.parametrize(
    ("seed", "age_h"),
    [
        (4711, 14.0),
        pytest.param(4711, 25.0, marks=pytest.mark.soak),
        pytest.param(4711, 100.0, marks=pytest.mark.soak),
        pytest.param(815, 14.0, marks=pytest.mark.soak),
        pytest.param(815, 25.0, marks=pytest.mark.soak),
        (815, 100.0),
    ],
)
def test_the_drying_soil(seed: int, age_h: float) -> None:
    judge(drying_soil(seed, age_h), 0.85, f"soil {seed} at {age_h:.0f} h", narrow=age_h < 20)


@pytest.mark.parametrize(
    ("seed", "width_mm", "least_overlap"),
    [
        (616, 0.06, 0.6),
        (616, 0.17, 0.85),
        (2718, 0.1, 0.85),
        (2718, 0.3, 0.85),
        pytest.param(616, 0.1, 0.85, marks=pytest.mark.soak),
        pytest.param(616, 0.3, 0.85, marks=pytest.mark.soak),
        pytest.param(2718, 0.06, 0.6, marks=pytest.mark.soak),
        pytest.param(2718, 0.17, 0.85, marks=pytest.mark.soak),
    ],
)
def test_parabolic_soils(seed: int, width_mm: float, least_overlap: float) -> None:
    judge(parabolic_soil(seed, width_mm), least_overlap, f"parabolic {seed}, {width_mm} mm", narrow=width_mm < 0.15)


@pytest.mark.parametrize(
    ("seed", "width_mm", "least_overlap"),
    [
        (3000, 0.3, 0.85),
        (5019, 0.06, 0.6),
        *(pytest.param(seed, 0.17, 0.85, marks=pytest.mark.soak) for seed in range(6000, 6010)),
    ],
)
def test_small_fields(monkeypatch: pytest.MonkeyPatch, seed: int, width_mm: float, least_overlap: float) -> None:
    """Fields of 4 mm, hardly wider than a plate: most cracks are cut by the border, some to less than a millimetre."""
    monkeypatch.setitem(globals(), "HALF", 2.0)
    judge(parabolic_soil(seed, width_mm), least_overlap, f"4 mm, parabolic {seed}, {width_mm} mm", narrow=False)
