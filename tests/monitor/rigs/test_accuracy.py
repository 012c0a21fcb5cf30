"""The paper's rig, simulated with fewer pixels: plane, step, lateral scale; `bench_accuracy` prints the full size."""

from __future__ import annotations

from tests.benchmarks.bench_accuracy import calibrated, measure

CAMERA = (960, 720)


def test_plane_step_and_scale_are_within_the_bars() -> None:
    found = measure(CAMERA, calibrated(CAMERA))
    print(found)
    assert found.plane_sd_um <= 2
    assert found.plane_over_sigma <= 1.2  # sigma must not promise more than there is
    assert abs(found.step_bias_um) <= 2
    assert abs(found.lateral_scale) <= 1e-3
