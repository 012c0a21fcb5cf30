"""Cracks: what is one and what is not, their length and their width, on closed forms and on the soils."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.change import crack_mask, crack_openings
from pipelines.change.crack_edges import crack_edges
from pipelines.change.crack_lines import crack_lines
from tests.pipelines.change.scans import bumps, sampled, scan_of, soil_scan

PITCH = 0.02
Floats = npt.NDArray[np.float64]


def straight(width: float, depth: float, angle: float = 0.4, step: float = 0.0, rows: int = 240) -> Floats:
    """A parabolic crack through the middle of a rough surface; the far side stands `step` higher."""

    def surface(x: Floats, y: Floats) -> Floats:
        across = (x - 2.4) * np.cos(angle) + (y - 2.4) * np.sin(angle)
        z = 0.3 * bumps(4)(x, y) + np.where(across > 0, step, 0.0)
        half = width / 2
        return np.where(np.abs(across) < half, z - depth * (1 - (across / half) ** 2), z)

    return sampled(surface, rows, 240, PITCH)


def mean_opening(scan_height: Floats, sigma: float = 0.003, pitch: float = PITCH) -> tuple[float, float]:
    found = crack_openings(scan_of(scan_height, pitch, sigma=sigma))
    known = np.isfinite(found.opening_mm)
    mean = np.average(found.opening_mm[known], weights=found.step_mm[known])
    return float(mean), float(found.lines.step.sum() * pitch)


@settings(max_examples=8, deadline=None)
@given(st.floats(0.1, 0.6), st.floats(0.0, np.pi), st.integers(0, 1000))
def test_width_and_length_of_a_straight_crack(width: float, angle: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 0.003, (240, 240))
    opening, length = mean_opening(straight(width, 0.5, angle) + noise)
    assert opening == pytest.approx(width, abs=0.5 * PITCH + 0.03 * width)
    # through the middle of a square, from side to side
    side = 4.8 / max(abs(np.cos(angle)), abs(np.sin(angle)))
    assert length == pytest.approx(side, rel=0.03, abs=0.15)


def test_plates_at_different_heights() -> None:
    opening, _ = mean_opening(straight(0.3, 0.6, 0.2, step=0.3))
    assert opening == pytest.approx(0.3, abs=0.5 * PITCH + 0.01)


def test_a_floor_that_nobody_sees_is_crack() -> None:
    height = straight(0.3, 0.6, 0.3)
    x, y = np.meshgrid(np.arange(240) * PITCH, np.arange(240) * PITCH)
    across = (x - 2.4) * np.cos(0.3) + (y - 2.4) * np.sin(0.3)
    height[np.abs(across) < 0.15] = np.nan
    scan = scan_of(height)
    mask = crack_mask(scan)
    truth = np.isnan(height)
    assert (mask & truth).sum() / (mask | truth).sum() > 0.97
    assert mean_opening(height)[0] == pytest.approx(0.3, abs=0.5 * PITCH)


def test_a_half_shadowed_floor_is_crack() -> None:
    height = straight(0.4, 0.8, 0.3)
    x, y = np.meshgrid(np.arange(240) * PITCH, np.arange(240) * PITCH)
    across = (x - 2.4) * np.cos(0.3) + (y - 2.4) * np.sin(0.3)
    height[(across > -0.05) & (across < 0.2)] = np.nan
    assert mean_opening(height)[0] == pytest.approx(0.4, abs=PITCH)


def test_a_hairline_two_cells_wide_is_kept() -> None:
    mask = crack_mask(scan_of(straight(0.04, 0.15), sigma=0.003))
    assert crack_lines(mask).step.sum() * PITCH == pytest.approx(4.8 / np.cos(0.4), rel=0.08)


@pytest.mark.parametrize(
    "surface",
    [
        lambda x, y: bumps(2)(x, y),
        lambda x, y: -0.15 * np.exp(-(((x - 2) / 0.5) ** 2)) + 0 * y,  # a hollow 0.15 deep and 0.8 wide
        lambda x, y: 0.4 * x - 0.3 * y,
        lambda x, y: np.where(x > 2, 0.4, 0.0) + 0 * y,  # a step has one wall
        lambda x, y: -0.4 * np.exp(-((np.hypot(x - 2, y - 2) / 0.08) ** 2)),  # a pit is not elongated
    ],
    ids=["relief", "hollow", "slope", "step", "pit"],
)
def test_what_is_no_crack(surface: object) -> None:
    assert callable(surface)
    noise = np.random.default_rng(0).normal(0, 0.003, (200, 200))
    assert not crack_mask(scan_of(sampled(surface, 200, 200) + noise, sigma=0.003)).any()


def test_shadows_dropouts_and_the_frame_are_no_crack() -> None:
    height = sampled(lambda x, y: 0.5 * np.maximum(0, 1 - ((x - 2) ** 2 + (y - 2) ** 2) / 0.2), 220, 220)
    y, x = np.mgrid[:220, :220] * PITCH
    distance = np.hypot(x - 2, y - 2)
    height[(distance > 0.44) & (distance < 0.64) & (x < 1.8) & (np.abs(y - 2) < 0.35)] = np.nan  # beside a pebble
    height[np.random.default_rng(0).random(height.shape) < 0.05] = np.nan
    height[:8] = height[-8:] = np.nan
    height[:, :8] = height[:, -8:] = np.nan
    assert not crack_mask(scan_of(height)).any()


def test_nothing_measured_has_no_crack() -> None:
    scan = scan_of(np.full((40, 40), np.nan))
    assert not crack_mask(scan).any()
    assert crack_openings(scan).opening_mm.size == 0


def test_length_of_a_ring() -> None:
    y, x = np.mgrid[:300, :300]
    radius = np.hypot(x - 150, y - 150)
    lines = crack_lines(np.abs(radius - 100) < 4)
    assert lines.step.sum() == pytest.approx(2 * np.pi * 100, rel=0.01)
    assert lines.free_ends == 0
    # normals point along the radius
    ray = np.stack([lines.column - 150, lines.row - 150], axis=1)
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    assert np.abs((ray * lines.normal).sum(axis=1)).min() > 0.97


def strip(start: tuple[float, float], end: tuple[float, float], width: float) -> npt.NDArray[np.bool_]:
    """Cells of a straight crack with round ends, its ends and width in cells."""
    y, x = np.mgrid[:200, :200].astype(np.float64)
    away, length = np.subtract(end, start), float(np.hypot(*np.subtract(end, start)))
    along = np.clip(((x - start[0]) * away[0] + (y - start[1]) * away[1]) / length, 0, length) / length
    inside: npt.NDArray[np.bool_] = np.hypot(x - start[0] - along * away[0], y - start[1] - along * away[1]) < width / 2
    return inside


@pytest.mark.parametrize("width", [5.0, 13.0, 31.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4])
def test_length_is_from_tip_to_tip(width: float, angle: float) -> None:
    away = 60 * np.array([np.cos(angle), np.sin(angle)])
    lines = crack_lines(strip(tuple(100 - away), tuple(100 + away), width))
    assert lines.free_ends == 2
    assert lines.step.sum() == pytest.approx(120 + width, abs=2)


def test_a_short_branch_that_leaves_the_field_is_no_spur() -> None:
    """The fork lies 15 cells from the border, less than the crack is wide."""
    stem = strip((100.0, 100.0), (100.0, 184.0), 17.0)
    legs = strip((100.0, 184.0), (60.0, 224.0), 17.0) | strip((100.0, 184.0), (140.0, 224.0), 17.0)
    lines = crack_lines(stem | legs)
    assert int(lines.leaves.sum()) == 2
    assert lines.step.sum() == pytest.approx(84 + 17 / 2 + 2 * 15.5 * np.sqrt(2), abs=8)


@pytest.mark.parametrize("cells", [20, 35])
def test_a_crack_that_cuts_a_corner_of_the_field_is_found(cells: int) -> None:
    """What is seen of it is shorter than any crack that ends inside the field may be."""
    y, x = np.mgrid[:200, :200] * PITCH
    across = (x + y) / np.sqrt(2) - cells * PITCH / np.sqrt(2)
    height = 0.3 * bumps(4)(x, y) - 0.3 * np.clip(1 - (across / 0.1) ** 2, 0, None)
    mask, truth = crack_mask(scan_of(height)), np.abs(across) < 0.1
    assert cells * np.sqrt(2) * PITCH < 1.0
    assert (mask & truth).sum() > 0.85 * (mask | truth).sum()
    pit = bumps(4)(x, y) * 0.3 - 0.3 * np.exp(-((((x - 0.3) ** 2 + y**2) / 0.15**2) ** 2))
    assert not crack_mask(scan_of(pit)).any()


def test_spurs_are_pruned_and_branches_kept() -> None:
    mask = np.zeros((200, 300), dtype=np.bool_)
    mask[95:106] = True
    mask[86:95, 150:156] = True  # a notch in the rim
    mask[106:180, 80:91] = True  # a branch
    lines = crack_lines(mask)
    assert lines.step.sum() == pytest.approx(300 + 77, abs=10)
    assert lines.free_ends == 1


def depth_at(shape: str, u: Floats) -> Floats:
    """Depth of a crack of depth 1 at u half widths from its middle."""
    inside: Floats = np.clip(1 - u, 0, None)
    if shape == "parabola":
        inside = 1 - np.clip(u, 0, 1) ** 2
    elif shape == "vertical":
        inside = (u < 1).astype(np.float64)
    return inside


def places(pitch: float, parts: int) -> tuple[Floats, Floats]:
    """Of the parts of the cells of 2.8 x 2.8 mm."""
    count = round(2.8 / pitch) * parts
    y, x = (np.mgrid[:count, :count] + 0.5) * pitch / parts - pitch / 2
    return x, y


@cache
def relief(pitch: float, parts: int) -> Floats:
    """The ground of all the cracks below: it takes longest."""
    return 0.3 * bumps(3)(*places(pitch, parts))


@pytest.mark.parametrize("width", [0.1, 0.25, 0.4])
@pytest.mark.parametrize(("shape", "pitch"), [(s, p) for s in ("parabola", "vee", "vertical") for p in (0.01, 0.02)])
def test_the_edge_does_not_depend_on_the_shape(shape: str, pitch: float, width: float) -> None:
    """Cells are means over 4 x 4 points; the crack winds, so that its walls fall anywhere in a cell."""
    count, parts = round(2.8 / pitch), 4
    x, y = places(pitch, parts)
    middle = count * pitch / 2
    across, along = (x - middle) * 0.9 + (y - middle) * 0.436, (y - middle) * 0.9 - (x - middle) * 0.436
    distance = np.abs(across + 0.1 * np.sin(1.5 * along)) / np.hypot(1, 0.15 * np.cos(1.5 * along))
    lift = 0.1 * np.exp(-np.maximum(distance - width / 2, 0) / 0.8)
    surface = lift - 0.6 * depth_at(shape, distance / (width / 2)) + relief(pitch, parts)
    height = surface.reshape(count, parts, count, parts).mean(axis=(1, 3))
    noise = np.random.default_rng(1).normal(0, 0.003, height.shape)
    opening, _ = mean_opening(height + noise, pitch=pitch)
    cells = width / pitch
    # half a crack of fewer than some five cells does not tell a steep wall from a bent one
    assert opening == pytest.approx(width, abs=(0.45 if cells > 10 else 0.6) * pitch)


def test_what_cannot_be_told_warns_of_nothing() -> None:
    """An even profile without a wall, one that was hardly measured and one beside the field's border."""
    z = np.array([[0.5] * 12 + [1.0], [np.nan] * 11 + [1.0, 1.0], [0.0, 0.0, 0.0] + [1.0] * 10])
    inside = np.arange(13) < np.array([[11], [11], [13]])
    edge, sigma, crossed = crack_edges(z, inside, np.array([0.5, np.inf, 0.0]), 0.01)
    assert edge.shape == sigma.shape == crossed.shape == (3,)
    assert np.isnan(edge[2])  # it never leaves the mask


@pytest.mark.parametrize(("name", "epoch", "overlap"), [("a", 0, 0.94), ("a", 1, 0.95), ("b", 0, 0.92), ("b", 1, 0.94)])
def test_soils(shared_data: Path, name: str, epoch: int, overlap: float) -> None:
    scan, truth, known = soil_scan(shared_data, name, epoch)
    mask = crack_mask(scan)
    assert (mask & truth).sum() / (mask | truth).sum() > overlap
    found = crack_openings(scan, mask)
    seen = np.isfinite(found.opening_mm)
    assert seen.mean() > 0.9
    # where a crack begins and at junctions it has another width than the nominal one: the middle says what is right
    assert np.nanmedian(found.opening_mm) == pytest.approx(known["width_mm"][epoch], abs=0.005)  # a cell is 0.01 mm
    assert found.lines.step.sum() == pytest.approx(crack_lines(truth).step.sum(), rel=0.03)
