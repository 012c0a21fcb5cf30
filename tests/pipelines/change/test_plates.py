"""Curl of plates on known warps: lift, angle, curvature, with noise, tilt, a missing edge; and their names in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pipelines import LEVEL_NONE, Grid, Scan, parse_instant
from pipelines.change import (
    Change,
    Comparison,
    Motion,
    Plate,
    compare,
    crack_mask,
    find_plates,
    name_plates,
    rim_slope,
)
from pipelines.change.curl import crack_distance
from tests.pipelines.change.draw_curl import PICTURE, drawing
from tests.pipelines.change.scans import bumps, soil_scan

PITCH = 0.02
SHAPE = 400, 400
HALF = 0.12
DECAY = 0.8
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def crossed(half: float = HALF) -> tuple[Floats, Floats, Floats]:
    """x, y, and the distance to the nearest wall of two cracks that cross at right angles: four plates."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * PITCH
    return x, y, np.minimum(np.abs(x - 4), np.abs(y - 4)) - half


def still(before: Floats, after: Floats, region: Mask | None = None, sigma: float = 0.003) -> Comparison:
    """Two surfaces compared as they lie: what registration does is tested elsewhere."""
    grid = Grid(*SHAPE, PITCH, 0.0, 0.0)

    def scan(z: Floats, hour: int) -> Scan:
        good = np.isfinite(z)
        return Scan(
            grid,
            parse_instant(f"2026-01-01T{hour:02d}:00:00Z"),
            z.astype(np.float32),
            np.where(good, np.float32(sigma), np.float32(np.nan)),
            np.full(SHAPE, 128, np.uint8),
            np.where(good, 0, LEVEL_NONE).astype(np.uint8),
        )

    then, now = scan(before, 0), scan(after, 1)
    dz = now.height - then.height
    motion = Motion(np.eye(4), 0.0, 1.0, 1.0, 0.0, 0.0, "good")
    lod = np.where(np.isfinite(dz), np.float32(2.8 * sigma), np.float32(np.nan))
    everywhere = np.ones(SHAPE, dtype=np.bool_) if region is None else region
    return Comparison(then, now, Change(grid, then.time, dz, lod, motion), ~everywhere, everywhere)


def truth_of(profile: object, wall: Floats, cells: Mask) -> tuple[float, float, float]:
    """The definition, applied to a closed-form warp at the cells of a plate."""
    assert callable(profile)
    d = wall[cells]
    z = profile(d)
    rim, inner = (d > 0.05) & (d < 0.25), d > 0.6 * d.max()
    wide = (d > 0.05) & (d < 0.65)
    return (
        float(z[rim].mean() - z[inner].mean()),
        float(np.rad2deg(np.arctan(-np.polyfit(d[rim], z[rim], 1)[0]))),
        float(2 * np.polyfit(d[wide], z[wide], 2)[0]),
    )


def warped(
    amplitude: float, tilt: tuple[float, float], seed: int, *, hole: bool = False, opens: float = 0.0
) -> tuple[tuple[Plate, ...], tuple[float, float, float], float]:
    """Four rough plates whose rims lift by `amplitude` exp(-d / 0.8 mm), each tilted, with noise; what was found."""
    x, y, wall_then = crossed()
    _, _, wall = crossed(HALF + opens)
    relief = 0.3 * bumps(seed)(x, y)
    random = np.random.default_rng(seed)
    floor = 0.5 * np.clip(-wall_then / HALF, 0, 1), 0.5 * np.clip(-wall / (HALF + opens), 0, 1)

    def profile(d: Floats) -> Floats:
        return np.asarray(amplitude * np.exp(-d / DECAY), dtype=np.float64)

    lifted = profile(np.maximum(wall, 0)) + tilt[0] * (x - 2) + tilt[1] * (y - 2) - 0.03
    before = relief - floor[0] + random.normal(0, 0.003, SHAPE)
    after = relief + lifted - floor[1] + random.normal(0, 0.003, SHAPE)
    if hole:  # nothing is seen along the upright edge of the first plate: tilt no longer cancels over the rim
        after[:198, 160:200] = np.nan
    comparison = still(before, after)
    labels, found = find_plates(comparison, wall < 0, wall_then < 0)
    first = int(labels[100, 100])
    measured = np.isfinite(after)
    return found, truth_of(profile, wall, (labels == first) & measured), float(first)


@pytest.mark.parametrize("seed", [3, pytest.param(14, marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    ("amplitude", "tilt", "hole", "opens"),
    [
        (0.12, (0.0, 0.0), False, 0.0),
        (0.12, (0.02, -0.01), False, 0.0),
        (0.12, (0.02, -0.01), True, 0.0),
        (0.25, (0.0, 0.0), False, 0.06),
        (-0.1, (0.0, 0.01), False, 0.0),
        (0.0, (0.01, 0.0), False, 0.0),
    ],
    ids=["lift", "tilt", "missing edge", "opened", "down", "tilt alone"],
)
def test_known_warps(amplitude: float, tilt: tuple[float, float], hole: bool, opens: float, seed: int) -> None:
    found, (lift, angle, curvature), first = warped(amplitude, tilt, seed, hole=hole, opens=opens)
    assert len(found) == 4
    (plate,) = [one for one in found if one.label == first]
    print(
        f"lift {1000 * (plate.lift.value - lift):+.1f} um, angle {plate.angle.value - angle:+.2f} degrees, "
        f"curvature {plate.curvature.value - curvature:+.3f} per mm"
    )
    assert plate.lift.value == pytest.approx(lift, abs=0.005)
    assert plate.angle.value == pytest.approx(angle, abs=0.5)
    assert plate.curvature.value == pytest.approx(curvature, abs=0.03)
    assert plate.tilt_removed == (True, True)
    assert plate.edge_seen < 0.7 if hole else plate.edge_seen == 1.0
    assert plate.area.value == pytest.approx((4 - HALF - opens) ** 2, rel=0.02)


def test_numbers_are_as_sure_as_they_say() -> None:
    scores: dict[str, list[float]] = {"lift": [], "angle": [], "curvature": []}
    for seed in range(8):
        found, truth, first = warped(0.12, (0.01, 0.0), seed)
        (plate,) = [one for one in found if one.label == first]
        for name, value in zip(scores, truth, strict=True):
            measured = getattr(plate, name)
            scores[name].append((measured.value - value) / measured.sigma)
    for name, z in scores.items():
        print(name, np.round(np.sqrt(np.mean(np.square(z))), 2))
        assert np.sqrt(np.mean(np.square(z))) < 1.5, name


def test_one_straight_edge_tells_no_tilt_across_it() -> None:
    x, y, _ = crossed()
    wall = np.abs(x - 4) - 0.13  # 13 cells: what is crack ends where a cell does
    lifted = 0.12 * np.exp(-np.maximum(wall, 0) / DECAY) + 0.01 * (y - 4)
    flat = 0.3 * bumps(6)(x, y)
    _, found = find_plates(still(flat, flat + lifted), wall < 0, wall < 0)
    assert len(found) == 2
    for plate in found:
        assert sorted(plate.tilt_removed) == [False, True]
        # a ring of cells lies right at the band's limit: rounding must fall the same way
        exact = crack_distance(wall < 0, PITCH).astype(np.float64)
        lift, angle, _ = truth_of(lambda d: 0.12 * np.exp(-d / DECAY), exact, (wall > 0) & (x < 4))
        assert plate.lift.value == pytest.approx(lift, abs=0.001)
        assert plate.angle.value == pytest.approx(angle, abs=0.1)


def test_no_crack_no_plate() -> None:
    flat = 0.3 * bumps(6)(*crossed()[:2])
    nothing = np.zeros(SHAPE, dtype=np.bool_)
    labels, found = find_plates(still(flat, flat), nothing, nothing)
    assert found == ()
    assert (labels == 1).all()
    _, found = find_plates(still(flat, np.full(SHAPE, np.nan)), np.eye(400, dtype=np.bool_), nothing)
    assert found == ()
    assert np.isnan(rim_slope(np.array([np.nan, 1.0]), np.array([0.1, 0.2])))
    assert rim_slope(np.array([3.0, 2.0, 1.0]), np.array([0.0, 1.0, 2.0])) == pytest.approx(45)


@pytest.mark.parametrize("name", ["a", "b"])
def test_plates_of_the_soils(shared_data: Path, name: str) -> None:
    before, _, truth = soil_scan(shared_data, name, 0)
    after, crack, _ = soil_scan(shared_data, name, 1)
    comparison = compare(after, before)
    labels, found = find_plates(comparison, crack_mask(after), crack_mask(before))
    assert len(found) > 5
    # the warp goes by the distance to cracks outside the field, too: plates at its border are told from it less well
    wall = [np.maximum(0.0, truth["edge_distance"] - truth["width_mm"][t] / 2) for t in (0, 1)]
    warp = [truth["curl_lift_mm"][t] * np.exp(-wall[t] / 0.8) - truth["settlement_mm"][t] for t in (0, 1)]
    distance = crack_distance(crack, 0.01)
    lifts, angles = [], []
    for plate in found:
        mine = labels == plate.label
        d, dz = distance[mine], (warp[1] - warp[0])[mine]
        rim, inner = (d > 0.05) & (d < 0.25), d > 0.6 * d.max()
        lift = plate.lift.value - (dz[rim].mean() - dz[inner].mean())
        angle = plate.angle.value - rim_slope(dz[rim], d[rim])
        lifts.append(lift)
        angles.append(angle)
        if not (mine[0].any() or mine[-1].any() or mine[:, 0].any() or mine[:, -1].any()):
            assert abs(lift) < 0.005
            assert abs(angle) < max(0.5, 2 * plate.angle.sigma)  # of the smallest the rim is known less well
    areas = [plate.area.value for plate in found]
    print(
        f"soil {name}: {len(found)} plates, lift {1000 * np.average(lifts, weights=areas):+.1f} um "
        f"(worst {1000 * np.abs(lifts).max():.1f}), angle {np.average(angles, weights=areas):+.2f} degrees "
        f"(worst {np.abs(angles).max():.2f})"
    )
    assert abs(np.average(lifts, weights=areas)) < 0.005
    assert abs(np.average(angles, weights=areas)) < 0.5


def test_names_of_plates_that_shrink_break_and_join() -> None:
    def labels(*boxes: tuple[int, int, int, int]) -> npt.NDArray[np.int32]:
        field = np.zeros((100, 100), np.int32)
        for number, (top, bottom, left, right) in enumerate(boxes, start=1):
            field[top:bottom, left:right] = number
        return field

    first = name_plates(labels((0, 60, 0, 100), (62, 100, 0, 100)))
    assert dict(first.identity) == {1: 1, 2: 2}
    # both shrink, the order of size turns round, and the first breaks in two
    second = name_plates(labels((64, 100, 0, 100), (0, 58, 0, 55), (0, 58, 60, 100)), first.memory)
    assert dict(second.identity) == {1: 2, 2: 1, 3: 3}
    assert dict(second.broke_from) == {3: 1}
    # the crack between 1 and 3 is not found once: 3 joins 1 for that time, and is itself again
    third = name_plates(labels((0, 58, 0, 100), (64, 100, 0, 100)), second.memory)
    assert dict(third.identity) == {1: 1, 2: 2}
    assert dict(third.joined) == {3: 1}
    fourth = name_plates(labels((64, 100, 0, 100), (0, 58, 0, 55), (0, 58, 60, 100)), third.memory)
    assert dict(fourth.identity) == {1: 2, 2: 1, 3: 3}
    assert not fourth.broke_from
    # nothing seen, nothing forgotten
    blind = name_plates(labels(), fourth.memory)
    assert not blind.identity
    assert dict(name_plates(labels((0, 58, 0, 55)), blind.memory).identity) == {1: 1}


def test_the_drawing_of_the_docs_is_of_these_definitions() -> None:
    assert PICTURE.read_text(encoding="utf-8") == drawing()
