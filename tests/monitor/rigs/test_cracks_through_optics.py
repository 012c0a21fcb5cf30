"""Cracks of known width, depth and tips seen through the simulated rig's optics: how well each is measured there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from monitor.rigs import SimulatedRig, simulated
from pipelines import Grid, PatternSet, Scan, parse_instant
from pipelines.change import CrackSighting, follow_cracks
from pipelines.reconstruction import scan_frames
from pipelines.scenes import SCENES

from .cracked_ground import CRACKS, CrackedGround
from .known_optics import known_geometry

CAMERA = (960, 720)
NOON = parse_instant("2026-11-22T12:00:00Z")
GRAY = PatternSet("gray", (608, 684))
GRID = Grid(420, 520, 0.02, -5.19, -4.19)
HOURS = 8


@cache
def scans(seed: int) -> tuple[Scan, ...]:
    """At 0 and 8 hours."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "SCENES", {**SCENES, "cracked": CrackedGround})
        rig = SimulatedRig(
            camera=CAMERA,
            scene="cracked",
            scene_options={"seed": seed},
            drift_mm=0.0,
            seed=41 + seed,
            started="2026-11-22T12:00:00Z",
        )
        rig.open()
        times = [NOON + np.timedelta64(hour, "h") for hour in (0, HOURS)]
        return tuple(scan_frames(rig.capture(GRAY, at), known_geometry(CAMERA), GRID) for at in times)


def nearest(found: tuple[CrackSighting, ...], number: int) -> CrackSighting:
    """The longest of those whose widest place lies on a known crack."""
    crack = CRACKS[number]

    def on_it(one: CrackSighting) -> bool:
        x, y = one.size.widest_mm
        return float(crack.away(np.array(x), np.array(y), HOURS)) < crack.width

    near = [one for one in found if on_it(one)]
    return max(near, key=lambda one: one.size.length.value)


def judge(seed: int) -> None:
    _, after = follow_cracks(scans(seed))
    assert len(after.cracks) == len(CRACKS)
    for number, crack in enumerate(CRACKS):
        one = nearest(after.cracks, number)
        size, long = one.size, crack.length(HOURS)
        width_off = size.width.value - crack.width
        ends = np.array([[tip.x_mm, tip.y_mm] for tip in one.tips])
        off = [float(np.hypot(*(ends - tip).T).min()) for tip in crack.tips(HOURS)]
        speed = max(tip.speed.value for tip in one.tips if np.isfinite(tip.speed.value))
        print(
            f"seed {seed}, {crack.width} mm: width {1000 * width_off:+.1f} um, sigma {1000 * size.width.sigma:.1f}; "
            f"length {100 * (size.length.value / long - 1):+.1f} %; depth {1000 * size.depth.value:.0f} of "
            f"{1000 * crack.depth:.0f} um, {100 * size.seen:.0f} % seen; tips {1000 * off[0]:.0f} and "
            f"{1000 * off[1]:.0f} um off, {speed:+.3f} mm/h"
        )
        assert abs(width_off) <= 0.3 * GRID.pitch_mm
        assert abs(width_off) <= 2 * size.width.sigma
        assert size.length.value == pytest.approx(long, rel=0.05)
        assert max(off) <= crack.width, "an end is round"
        assert speed == pytest.approx(crack.growth, abs=0.03)
        if crack.depth < crack.width:
            assert size.depth.value == pytest.approx(crack.depth, rel=0.06)
            assert size.seen > 0.8
        else:  # at least
            assert 0.85 * crack.depth < size.depth.value < crack.depth
            assert size.seen < 0.6


def test_cracks_through_the_optics() -> None:
    judge(0)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1, 6))
def test_cracks_through_the_optics_of_other_ground(seed: int) -> None:
    judge(seed)
