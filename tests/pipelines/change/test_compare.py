"""A scan that was shifted, tilted and lifted comes back onto its baseline, and says how sure it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import Scan
from pipelines.change import apply_motion, register
from tests.pipelines.change.scans import bumps, sampled, scan_of

SURFACE = bumps()


def moved_pair(
    dx: float, dy: float, dz: float, a: float, b: float, noise: float = 0.002, seed: int = 0
) -> tuple[Scan, Scan]:
    random = np.random.default_rng(seed)
    before = sampled(SURFACE)
    now = sampled(lambda x, y: SURFACE(x - dx, y - dy) + dz + a * (x - 2) + b * (y - 1.6))
    return (
        scan_of(before + random.normal(0, noise, before.shape)),
        scan_of(now + random.normal(0, noise, now.shape), hour=1),
    )


@settings(max_examples=15, deadline=None)
@given(
    st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.2, 0.2), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005)
)
def test_a_known_motion_is_found(dx: float, dy: float, dz: float, a: float, b: float) -> None:
    baseline, scan = moved_pair(dx, dy, dz, a, b)
    motion = register(scan, baseline)
    assert motion.verdict == "good", motion.reason
    # where the middle of the field goes
    x, y, z = (motion.matrix @ [2, 1.6, 0, 1])[:3] - [2, 1.6, 0]
    assert abs(x + dx) < 0.0006
    assert abs(y + dy) < 0.0006
    assert abs(z + dz) < 0.0006
    assert motion.matrix[2, 0] == pytest.approx(-a, abs=2e-4)
    assert motion.matrix[2, 1] == pytest.approx(-b, abs=2e-4)
    moved = apply_motion(scan, motion)
    assert np.nanmedian(np.abs(moved.height - baseline.height)) < 0.0025
