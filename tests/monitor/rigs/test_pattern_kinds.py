"""One scene measured with Gray code, stripes and phase shifting: each calibrates, and is as right as its sigma says."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from monitor.rigs import BOARD, SimulatedRig, calibration_captures
from pipelines import Calibration, Frames, PatternSet, PointMap, parse_instant
from pipelines.reconstruction import Board, calibrate, reconstruct
from pipelines.scenes import SCENES

from .known_optics import known_geometry

CAMERA = (640, 480)
NOON = parse_instant("2026-11-22T12:00:00Z")
KINDS = {
    "gray": PatternSet("gray", (608, 684)),
    "stripes": PatternSet("stripes", (608, 684)),
    "phase, 3 steps": PatternSet.from_mapping({"kind": "phase", "size": (608, 684), "steps": 3}),
    "phase, 4 steps": PatternSet.from_mapping({"kind": "phase", "size": (608, 684), "steps": 4}),
}
CHI = {"gray": (0.3, 1.3), "stripes": (0.5, 1.3), "phase, 3 steps": (0.8, 1.3), "phase, 4 steps": (0.8, 1.3)}
FAR = {"gray": 1e-3, "stripes": 5e-4, "phase, 3 steps": 5e-4, "phase, 4 steps": 5e-4}
"""Share of pixels beyond 100 um: at the walls of cracks, where one pixel sees both."""
SOIL_H = 72.0


def capture(kind: str, scene: str, **scene_options: float) -> Frames:
    rig = SimulatedRig(
        camera=CAMERA,
        scene=scene,
        scene_options=scene_options,
        drift_mm=0.0,
        started=str(NOON - np.timedelta64(int(SOIL_H), "h")) + "Z",
    )
    rig.open()
    return rig.capture(KINDS[kind], NOON)


def in_scene(points: PointMap, calibration: Calibration) -> npt.NDArray[np.float64]:
    measured: npt.NDArray[np.float64] = points.xyz[points.valid].astype(np.float64)
    return measured @ calibration.reference[:, :3].T + calibration.reference[:, 3]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_soil_is_measured_as_well_as_sigma_says(kind: str) -> None:
    calibration = known_geometry(CAMERA)
    frames = capture(kind, "soil")
    points = reconstruct(frames, calibration)
    x, y, z = in_scene(points, calibration).T
    error_um = 1000 * (z - SCENES["soil"]().at(x, y).height(SOIL_H))
    sigma_um = 1000 * points.sigma_z[points.valid]
    lit = frames.stack[0].astype(int) - frames.stack[1] > 12
    kept = points.valid.sum() / lit.sum()
    sd = 1.4826 * np.median(np.abs(error_um))
    chi = 1.4826 * np.median(np.abs(error_um / sigma_um))
    far = np.mean(np.abs(error_um) > 100)
    print(
        f"{kind}: {len(frames.stack)} frames, {100 * kept:.1f} % measured, robust sd {sd:.2f} um (sigma "
        f"{np.median(sigma_um):.2f} um, error over sigma {chi:.2f}), {100 * far:.4f} % beyond 100 um, bias "
        f"{np.median(error_um):+.2f} um"
    )
    assert kept > 0.95
    assert sd < 4
    assert far < FAR[kind]
    assert abs(np.median(error_um)) < 0.5
    assert CHI[kind][0] < chi < CHI[kind][1]


@pytest.mark.parametrize("kind", ["stripes", "phase, 4 steps"])
def test_each_kind_calibrates_the_rig_that_it_measures_with(kind: str) -> None:
    board = Board(BOARD.inner_corners, BOARD.square_mm)
    calibration = calibrate(calibration_captures({"camera": CAMERA}, KINDS[kind], NOON, 4), board)
    assert calibration.rms_px["stereo"] < 0.15
    plane = {"z_mm": 0.8, "slope_x": 0.06, "slope_y": -0.04}
    points = reconstruct(capture(kind, "plane", **plane), calibration)
    x, y, z = in_scene(points, calibration).T
    parts = np.column_stack([x, y, np.ones_like(x)])
    inside = np.hypot(x, y) < 4  # within the poses of the board
    found = np.linalg.lstsq(parts[inside], z[inside], rcond=None)[0]
    rest_um = 1000 * (z - parts @ found)[inside]
    print(f"{kind}: stereo rms {calibration.rms_px['stereo']:.3f} px, plane {rest_um.std():.2f} um, slopes {found[:2]}")
    assert rest_um.std() < 5
    # a board found from its other end turns the site frame by half a turn: slopes change sign together
    np.testing.assert_allclose(np.abs(found[:2]), [0.06, 0.04], atol=0.002)
    assert found[2] == pytest.approx(0.8, abs=0.02)
