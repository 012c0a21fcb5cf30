"""The simulated rig against geometry worked out independently of it, and against what its optics must do."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from configs import CaptureError, DeviceUnavailable, InputError
from monitor.rigs import BOARD, SimulatedRig, calibration_captures, make_rig
from monitor.rigs.optics_model import ANGLE_DEG, Device, paper_optics, small_motion
from pipelines import Calibration, Frames, PatternSet, parse_instant
from pipelines.reconstruction import decode, triangulate
from pipelines.scenes import SCENES

PATTERNS = PatternSet("gray", (608, 684))
COARSE = PatternSet("gray", (608, 684), bits=(5, 3))
WET = parse_instant("2026-01-01T00:00:00Z")
DRY = parse_instant("2026-01-04T00:00:00Z")
STARTED = "2026-01-01T00:00:00Z"


def capture(patterns: PatternSet = COARSE, at: np.datetime64 = WET, **options: Any) -> Frames:
    rig = SimulatedRig(**{"camera": (320, 240), "started": STARTED, **options})
    rig.open()
    return rig.capture(patterns, at)


def height_errors(frames: Frames, scene: str, elapsed_h: float, **scene_options: float) -> npt.NDArray[np.float64]:
    """Decode and triangulate with the known geometry; height less the scene's, mm, per camera pixel."""
    optics = paper_optics(frames.image_size)
    camera, projector = optics.camera, optics.projector
    turn = projector.R @ camera.R.T
    known = Calibration(
        camera.lens, projector.lens, turn, projector.t_mm - turn @ camera.t_mm, np.eye(3, 4), {"stereo": 0.0}
    )
    points = triangulate(decode(frames), known).xyz.astype(np.float64)
    x, y, z = np.moveaxis((points - camera.t_mm) @ camera.R, -1, 0)
    seen = np.isfinite(z)
    errors = np.full(z.shape, np.nan)
    errors[seen] = z[seen] - SCENES[scene](**scene_options).at(x[seen], y[seen]).height(elapsed_h)
    return errors


@pytest.mark.parametrize("plane", [{}, {"z_mm": 1.2, "slope_x": 0.08, "slope_y": -0.05}])
def test_a_plane_is_measured_where_it_is(plane: dict[str, float]) -> None:
    frames = capture(PATTERNS, camera=(640, 480), scene="plane", scene_options=plane, drift_mm=0.0)
    errors = height_errors(frames, "plane", 0.0, **plane)
    seen = np.isfinite(errors)
    assert seen.mean() > 0.97
    assert abs(errors[seen].mean()) < 0.5e-3
    # integer columns are right to 1/sqrt(12) px; a column is 26 um wide on the object: 12.5 um of height, no less
    assert 9e-3 < errors[seen].std() < 16e-3


def test_soil_is_measured_where_it_is_and_gross_errors_are_at_its_walls() -> None:
    frames = capture(PATTERNS, at=DRY, camera=(960, 720), drift_mm=0.0)
    errors = height_errors(frames, "soil", 72.0)
    seen = np.isfinite(errors)
    assert 0.85 < seen.mean() < 0.97  # shadows hide crack floors
    assert abs(np.median(errors[seen])) < 1e-3
    assert 1.4826 * np.median(np.abs(errors[seen])) < 20e-3
    assert (np.abs(errors[seen]) > 0.1).mean() < 0.01


def test_same_visit_same_frames_and_another_visit_others() -> None:
    first, again = capture(), capture()
    assert np.array_equal(first.stack, again.stack)
    later = capture(at=WET + np.timedelta64(1, "s"))
    assert (later.stack[0] != first.stack[0]).mean() > 0.3  # noise, flicker and where the sample lies
    assert abs(float(later.stack[0].mean()) - float(first.stack[0].mean())) < 12


def test_noise_is_shot_noise() -> None:
    patterns = PatternSet("gray", (608, 684), bits=(10, 0))
    stacks = [capture(patterns, scene="plane", flicker=0.0, drift_mm=0.0, seed=seed).stack[0] for seed in (1, 2)]
    first, second = (stack[100:140, 100:220].astype(float) for stack in stacks)
    level = first.mean()
    assert (first - second).std() / np.sqrt(2) == pytest.approx(np.sqrt(level * 255 / 9000 + 0.36 + 1 / 12), rel=0.08)


def test_light_flickers_from_frame_to_frame() -> None:
    frames = capture(scene="plane", flicker=0.02).stack.astype(float)
    white = frames[0, 100:140, 100:220].mean()
    pairs = [frames[n : n + 2, 100:140, 100:220].sum(axis=0).mean() for n in range(2, len(frames), 2)]
    assert 0.002 < np.std(pairs) / white < 0.05


def test_a_bright_scene_saturates_and_a_black_frame_is_not_black() -> None:
    frames = capture(scene="board", exposure_ms=12.0)
    assert (frames.stack[0] == 255).mean() > 0.3
    assert 2 < np.median(frames.stack[1]) < 25  # room light, black leak, black level


def test_the_image_is_turned_by_180_degrees() -> None:
    optics = paper_optics((320, 240))
    place = np.array([2.0, 1.0, 0.0])
    camera_x, camera_y, _ = optics.camera.R @ place + optics.camera.t_mm
    assert camera_x < 0  # +x of the scene is to the left
    assert camera_y > 0  # +y of the scene is below
    axes = [device.R.T @ [0.0, 0.0, 1.0] for device in (optics.camera, optics.projector)]
    assert np.rad2deg(np.arccos(axes[0] @ axes[1])) == pytest.approx(ANGLE_DEG, abs=0.5)


def test_rays_undo_the_lens() -> None:
    import cv2

    camera = paper_optics((640, 480)).camera
    rays = camera.rays().astype(np.float64)
    points = np.concatenate([rays, np.ones((480, 640, 1))], axis=-1)[::60, ::60].reshape(-1, 3)
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.lens.K, camera.lens.dist)
    rows, columns = np.mgrid[0:480:60, 0:640:60]
    assert np.allclose(pixels[:, 0], np.stack([columns.ravel(), rows.ravel()], axis=1), atol=2e-3)


def test_a_moved_device_sees_the_moved_scene() -> None:
    camera = paper_optics((64, 64)).camera
    motion = small_motion((5.0, -3.0, 2.0), (0.1, 0.2, 0.3))
    place = np.array([1.0, -2.0, 0.5])
    moved: Device = camera.moved(motion)
    world = motion[:, :3] @ place + motion[:, 3]
    assert np.allclose(moved.R @ place + moved.t_mm, camera.R @ world + camera.t_mm)


def test_out_of_focus_stripes_lose_contrast() -> None:
    patterns = PatternSet("gray", (608, 684), bits=(10, 0))

    def contrast(z_mm: float) -> float:
        stack = capture(patterns, camera=(960, 720), scene="plane", scene_options={"z_mm": z_mm}, flicker=0.0).stack
        finest, inverse = (stack[frame, 300:420, 400:560].astype(float) for frame in (-2, -1))
        return float(np.abs(finest - inverse).mean() / (finest + inverse).mean())

    sharp, blurred = contrast(0.0), contrast(2.8)
    assert blurred < 0.93 * sharp
    assert blurred > 0.3 * sharp  # +-3 mm is still within the depth of field


def test_cracks_open_and_throw_shadows() -> None:
    wet, dry = (capture(at=at, camera=(640, 480)).stack for at in (WET, DRY))
    dark = [((stack[0].astype(int) - stack[1]) < 15).mean() for stack in (wet, dry)]
    assert dark[1] > dark[0] + 0.03


def test_pace_is_time_lapse() -> None:
    hour = WET + np.timedelta64(1, "h")
    lapse = capture(at=hour, pace=72.0).stack[0].astype(float)
    slow, dry = capture(at=hour).stack[0].astype(float), capture(at=DRY).stack[0].astype(float)
    assert np.abs(lapse - dry).mean() < 0.5 * np.abs(slow - dry).mean()


def test_faults_on_request() -> None:
    rig = SimulatedRig(camera=(64, 64), faults={1: "dropped", 2: "unplugged"})
    rig.open()
    rig.capture(COARSE, WET)
    with pytest.raises(CaptureError, match="dropped"):
        rig.capture(COARSE, WET)
    with pytest.raises(DeviceUnavailable, match="plugged"):
        rig.capture(COARSE, WET)
    rig.capture(COARSE, WET)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scene": "sand"}, "scene: no scene 'sand'; there are soil"),
        ({"scene_options": {"colour": 1}}, "scene_options: .*colour"),
        ({"camera": [640]}, "camera: must be two numbers"),
        ({"camera": [10, 10]}, "camera: must be two numbers"),
        ({"pace": 0}, "pace: must be above 0"),
        ({"flicker": -1}, "flicker: must not be below 0"),
        ({"started": "yesterday"}, "started: 'yesterday' is not a time"),
        ({"faults": {0: "fire"}}, "faults: no fault 'fire'"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make_rig("simulated", options)


def test_board_is_shown_whole_in_each_pose() -> None:
    import cv2

    captures = calibration_captures({"camera": (480, 360), "faults": {0: "dropped"}}, COARSE, WET, 9)
    assert len({frames.time for frames in captures}) == 9
    for frames in captures:
        assert (frames.stack[0] == 255).mean() < 0.01
        found, _ = cv2.findChessboardCorners(frames.stack[0], BOARD.inner_corners)
        assert found
    with pytest.raises(ValueError, match="3 to 9"):
        calibration_captures({}, COARSE, WET, 2)
