"""Organisms followed through video: names, places, volumes, and what they eat, against the scene's truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from monitor.rigs.board_poses import BOARD, calibration_captures
from monitor.rigs.simulated import SimulatedRig
from pipelines import LEVEL_NONE, Grid, PatternSet, Scan, parse_instant
from pipelines.change import Sightings, bare_substrate, find_objects, follow_objects, update_substrate
from pipelines.reconstruction import Board, calibrate, footprint_grid, reconstruct, to_scan
from pipelines.scenes import Organisms

START = parse_instant("2026-01-01T00:00:00Z")
SECOND = np.timedelta64(1, "s")
NOISE = 0.003
Floats = npt.NDArray[np.float64]


def exact_scans(scene: Organisms, count: int, pitch: float) -> Iterator[Scan]:
    half = scene.side_mm / 2 + 0.5
    cells = round(2 * half / pitch)
    grid = Grid(cells, cells, pitch, -half + pitch / 2, -half + pitch / 2)
    ground = scene.at(grid.x_mm[None, :], grid.y_mm[:, None])
    random = np.random.default_rng(scene.seed)
    for second in range(count):
        height = ground.height(second / 3600) + random.normal(0, NOISE, grid.shape)
        yield scan_of(grid, height, second)


def scan_of(grid: Grid, height: Floats, second: int) -> Scan:
    good = np.isfinite(height)
    return Scan(
        grid,
        START + second * SECOND,
        height.astype(np.float32),
        np.where(good, np.float32(NOISE), np.float32(np.nan)),
        np.full(grid.shape, 128, np.uint8),
        np.where(good, 0, LEVEL_NONE).astype(np.uint8),
    )


@dataclass
class Judged:
    """Share of scans in which each organism bears its usual name; errors of place and volume of those by themselves."""

    kept: Floats
    place_mm: Floats
    volume: Floats

    def show(self) -> None:
        place, off = 1000 * self.place_mm, 100 * np.abs(self.volume)
        print(
            f"names kept {100 * self.kept.mean():.1f} % (worst {100 * self.kept.min():.0f} %), "
            f"place median {np.median(place):.1f} um, 95 % within {np.quantile(place, 0.95):.1f} um, "
            f"volume mean {100 * self.volume.mean():+.1f} %, median error {np.median(off):.1f} %"
        )


def judge(scene: Organisms, found: Sequence[Sightings], turn: Floats, shift: Floats) -> Judged:
    names: list[list[int]] = [[] for _ in range(scene.count)]
    place, volume = [], []
    for second, sightings in enumerate(found):
        truth = scene.creatures(second / 3600)
        seen = np.array([[s.object.x_mm, s.object.y_mm] for s in sightings.seen]).reshape(-1, 2) @ turn.T + shift
        for k in range(scene.count):
            off = np.hypot(seen[:, 0] - truth.x_mm[k], seen[:, 1] - truth.y_mm[k])
            if not off.size or off.min() > 0.25:
                names[k].append(0)
                continue
            sighting = sightings.seen[int(off.argmin())]
            names[k].append(sighting.identity)
            if not sighting.touches:
                place.append(off.min())
                volume.append(sighting.object.volume_mm3.value / truth.volume_mm3[k] - 1)
    kept = [max((n.count(name) for name in set(n) - {0}), default=0) / len(n) for n in names]
    return Judged(np.array(kept), np.array(place), np.array(volume))


@pytest.mark.parametrize("seed", [4, 8])
def test_a_minute_of_exact_surfaces(seed: int) -> None:
    scene = Organisms(seed=seed)
    scans = list(exact_scans(scene, 60, 0.04))
    bare = bare_substrate(scans)
    assert bare is not None
    found = list(follow_objects(scans, bare))
    judged = judge(scene, found, np.eye(2), np.zeros(2))
    judged.show()
    assert judged.kept.mean() >= 0.95
    assert np.quantile(judged.place_mm, 0.95) < 0.02
    assert abs(judged.volume.mean()) < 0.02
    assert np.median(np.abs(judged.volume)) < 0.05
    # what was eaten beneath them is in the substrate
    grid = scans[0].grid
    truth = scene.at(grid.x_mm[None, :], grid.y_mm[:, None]).substrate(59 / 3600)
    assert np.nanmean(np.abs(found[-1].substrate.level - truth)) < 0.002


def test_speed_and_contact() -> None:
    scene = Organisms(seed=4)
    scans = list(exact_scans(scene, 30, 0.04))
    found = list(follow_objects(scans, bare_substrate(list(exact_scans(scene, 60, 0.04)))))
    speeds = [s.speed_mm_s for sightings in found[1:] for s in sightings.seen if not s.touches]
    assert np.median(speeds) == pytest.approx(scene.speed_mm_s, rel=0.3)
    for sightings in found:
        touching = {s.identity: s.touches for s in sightings.seen}
        assert all(one in touching[other] for one, others in touching.items() for other in others)


def test_an_object_that_lay_there_from_the_first_is_seen_once_it_left() -> None:
    grid = Grid(80, 80, 0.05, 0.0, 0.0)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)

    def surface(at: float) -> Floats:
        return np.asarray(0.2 * np.clip(1 - ((x - at) ** 2 + (y - 2) ** 2) / 0.25, 0, None), dtype=np.float64)

    scans = [scan_of(grid, surface(0.8 + 0.2 * k), k) for k in range(12)]
    found = list(follow_objects(scans))
    assert not found[0].seen
    assert len(found[-1].seen) == 1
    assert found[-1].seen[0].object.volume_mm3.value == pytest.approx(np.pi * 0.25 * 0.2 / 2, rel=0.03)
    assert np.abs(found[-1].substrate.level[:, :20]).max() < 0.01


def test_the_substrate_sinks_bit_by_bit_and_one_error_does_not_sink_it() -> None:
    grid = Grid(20, 20, 0.05, 0.0, 0.0)
    now = update_substrate(None, scan_of(grid, np.zeros(grid.shape), 0))
    for second in range(1, 60):
        now = update_substrate(now, scan_of(grid, np.full(grid.shape, -0.001 * second), second))
    assert now.level.mean() == pytest.approx(-0.059, abs=0.006)
    hole = np.full(grid.shape, -0.059)
    hole[5, 5] = -0.5
    now = update_substrate(now, scan_of(grid, hole, 60))
    assert now.level[5, 5] > -0.07
    assert update_substrate(now, scan_of(grid, hole, 61)).level[5, 5] == np.float32(-0.5)


def test_a_side_that_was_not_seen_is_filled() -> None:
    grid = Grid(80, 80, 0.05, 0.0, 0.0)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    body = 0.3 * np.clip(1 - ((x - 2) / 0.6) ** 2 - ((y - 2) / 0.4) ** 2, 0, None)
    bare = update_substrate(None, scan_of(grid, np.zeros(grid.shape), 0))
    shadow = body.copy()
    shadow[(np.abs(x - 2.2) < 0.06) & (body > 0)] = np.nan
    truth = np.pi * 0.6 * 0.4 * 0.3 / 2
    # a bite that the substrate has lost already: 20 um beside the body are no part of it
    trail = body + 0.02 * ((np.abs(x - 1.2) < 0.25) & (np.abs(y - 2) < 0.25) & (body == 0))
    _, (found,) = find_objects(scan_of(grid, trail, 1), bare)
    assert (found.x_mm, found.y_mm) == pytest.approx((2, 2), abs=0.002)
    for surface, within in ((body, 0.02), (shadow, 0.06)):
        _, (found,) = find_objects(scan_of(grid, surface, 1), bare)
        assert found.volume_mm3.value == pytest.approx(truth, rel=within)
        assert (found.x_mm, found.y_mm) == pytest.approx((2, 2), abs=0.01)
        assert found.length_mm == pytest.approx(1.2, rel=0.06)
        assert abs(found.axis) < 0.05
        assert not found.at_border


@pytest.mark.soak
def test_a_minute_through_the_optics() -> None:
    """The simulated paper rig at 1 Hz; the site frame is laid over the scene by the organisms' own places."""
    scene, camera = Organisms(), (960, 720)
    patterns = PatternSet("gray", (608, 684))
    poses = calibration_captures({"camera": camera}, patterns, START, 4)
    calibration = calibrate(poses, Board(BOARD.inner_corners, BOARD.square_mm))
    rig = SimulatedRig(camera=camera, scene="organisms")
    rig.open()
    grid = footprint_grid(calibration)
    times = [START + second * SECOND for second in range(60)]
    scans = [to_scan(reconstruct(rig.capture(patterns, at), calibration), calibration, grid, at) for at in times]
    found = list(follow_objects(scans, bare_substrate(scans)))
    turn, shift = -np.eye(2), np.zeros(2)  # the image is turned by 180 degrees
    for _ in range(20):
        here, there = [], []
        for second in range(0, 60, 6):
            truth = scene.creatures(second / 3600)
            for sighting in found[second].seen:
                at = np.array([sighting.object.x_mm, sighting.object.y_mm])
                off = np.array([truth.x_mm, truth.y_mm]).T - (turn @ at + shift)
                nearest = int(np.hypot(*off.T).argmin())
                if np.hypot(*off[nearest]) < 0.2 and not sighting.touches:
                    here.append(at)
                    there.append([truth.x_mm[nearest], truth.y_mm[nearest]])
        a, b = np.array(here), np.array(there)
        u, _, vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
        turn = (u @ vt).T
        shift = b.mean(0) - turn @ a.mean(0)
    judged = judge(scene, found, turn, shift)
    judged.show()
    assert judged.kept.mean() >= 0.95
    assert np.quantile(judged.place_mm, 0.95) < 0.02
    assert abs(judged.volume.mean()) < 0.02
    assert np.median(np.abs(judged.volume)) < 0.05
