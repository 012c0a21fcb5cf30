"""Telecentric and nearly telecentric lenses: the model is chosen by evidence, heights are right and know how sure."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipelines import Grid, parse_instant
from pipelines.reconstruction import (
    Calibration,
    describe_calibration,
    footprint_grid,
    scan_decoded,
    to_scan,
    triangulate,
)
from pipelines.reconstruction.pinhole import Floats
from pipelines.reconstruction.solve import solve

from .telecentric_rig import BOARD, FAR, SIZES, TILTS, corners_of, make_rig, see, seen_by

NOON = parse_instant("2026-11-22T12:00:00Z")
NOISE_PX = 0.05


@cache
def found(
    camera: float, projector: float, poses: int = 5, seed: int = 1, side: int = 1, told: str = "auto"
) -> Calibration:
    corners = corners_of(make_rig(camera, projector, side), NOISE_PX, seed, TILTS[:poses])
    return solve(corners, *SIZES, BOARD, 0, "", side=told)


def measured(true: Calibration, rig: Calibration) -> tuple[float, float, Floats]:
    """Scale of heights and of lengths, and height errors in the plane z = 0 over the field."""
    x, y = np.meshgrid(np.linspace(-4, 4, 9), np.linspace(-2.4, 2.4, 7))
    low, middle, high = (
        seen_by(true, rig, np.stack([x, y, np.full_like(x, z)], axis=-1).reshape(-1, 3)) for z in (-0.5, 0.0, 0.5)
    )
    rise = float((high - low)[:, 2].mean())
    return rise, float(np.linalg.norm(middle[8] - middle[0]) / 8), middle[:, 2]


@pytest.mark.parametrize(
    ("camera", "projector", "models"),
    [
        (FAR, FAR, ("affine", "affine")),
        (FAR, 3, ("affine", "pinhole")),
        (3, FAR, ("pinhole", "affine")),
        (50, 50, ("pinhole", "pinhole")),  # nearly telecentric: widths of the field
        (200, 100, (None, None)),  # either will do: what decides is the noise
        (5, 9, ("pinhole", "pinhole")),
    ],
)
def test_the_model_is_chosen_by_evidence_and_scales_are_right(
    camera: float, projector: float, models: tuple[str | None, str | None]
) -> None:
    rig = found(camera, projector, told="right")
    rise, wide, heights = measured(make_rig(camera, projector), rig)
    assert rig.sigma is not None
    told = rig.sigma["field"]["height_scale_percent"]
    print(
        f"{camera}, {projector}: {rig.camera.model}, {rig.projector.model}; scale {rise:.5f} ±{told:.3f} %, {wide:.5f}"
    )
    for lens, model in zip((rig.camera, rig.projector), models, strict=True):
        assert model in (None, lens.model)
    assert rise == pytest.approx(1, abs=0.001)
    assert wide == pytest.approx(1, abs=0.001)
    assert abs(rise - 1) < 4 * told / 100
    assert np.abs(heights).max() < 0.003
    assert rig.rms_px["stereo"] == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.06)
    assert rig.notes == ()


@pytest.mark.parametrize("seed", range(3))
def test_three_poses_are_enough(seed: int) -> None:
    rig = found(FAR, FAR, poses=3, seed=seed, told="right")
    rise, wide, _ = measured(make_rig(), rig)
    assert (rig.camera.model, rig.projector.model) == ("affine", "affine")
    assert rise == pytest.approx(1, abs=0.002)
    assert wide == pytest.approx(1, abs=0.001)


def test_two_telecentric_lenses_cannot_tell_heights_from_depths_and_say_so() -> None:
    """Mirrored in depth, with the projector on the other side, the same boards look the same."""
    assumed, told = found(FAR, FAR, side=-1), found(FAR, FAR, side=-1, told="left")
    assert measured(make_rig(side=-1), told)[0] == pytest.approx(1, abs=0.001)
    assert measured(make_rig(side=-1), assumed)[0] == pytest.approx(-1, abs=0.001)
    assert assumed.rms_px["stereo"] == pytest.approx(told.rms_px["stereo"], rel=1e-4)
    assert "cannot tell heights from depths" in assumed.notes[0]
    assert "if it does not, give --projector-side left" in "\n".join(describe_calibration(assumed))
    assert told.notes == ()


def test_where_the_corners_tell_the_side_a_contradiction_is_refused() -> None:
    with pytest.raises(ValueError, match="--projector-side left: the corners say that it stands right of the camera"):
        found(FAR, 3, told="left")


def test_a_mirrored_telecentric_camera_is_found() -> None:
    poses = [
        replace(pose, camera=np.array([SIZES[0][0] - 1, 0]) + pose.camera * np.array([-1, 1]))
        for pose in corners_of(make_rig(), NOISE_PX, 1, TILTS[:5])
    ]
    rig = solve(poses, *SIZES, BOARD, 0, "", side="left")  # in a mirror, right is left
    assert rig.camera.mirrored
    assert not rig.projector.mirrored
    assert rig.camera.parallel
    assert rig.rms_px["stereo"] == pytest.approx(found(FAR, FAR).rms_px["stereo"], rel=0.01)
    with pytest.raises(ValueError, match="the optics mirror otherwise than --mirrored says"):
        solve([replace(pose) for pose in poses], *SIZES, BOARD, 0, "", mirrored="none")


def test_the_file_keeps_the_model() -> None:
    rig = found(FAR, 3)
    again = Calibration.from_json(rig.to_json())
    assert (again.camera.model, again.projector.model) == ("affine", "pinhole")
    assert again.id == rig.id
    assert '"model"' not in found(5, 9).to_json()  # as before there were two
    # Its frame begins where its axis meets the reference plane.
    assert rig.reference[:, 3] == pytest.approx(0, abs=1e-9)


def test_a_bad_pose_is_named_with_affine_lenses_too() -> None:
    poses = corners_of(make_rig(), NOISE_PX, 1, TILTS[:5])
    off = np.array([40.0, 0]) * np.sin(poses[2].board[:, :1])
    poses[2] = replace(poses[2], projector=poses[2].projector + off, agreeing=0.4)
    rig = solve(poses, *SIZES, BOARD, 0, "", side="right")
    assert [bool(pose.advice) for pose in rig.poses] == [n == 2 for n in range(5)]
    assert rig.poses[2].projector_px > 2
    assert rig.poses[2].camera_px < 0.2


def bumps(x: Floats, y: Floats) -> Floats:
    return 0.3 * np.cos(x) * np.sin(0.8 * y) + 0.05 * x


@pytest.mark.parametrize(("camera", "projector"), [(FAR, FAR), (FAR, 3), (3, FAR)])
def test_triangulation_is_exact_and_sigma_is_what_noise_does(camera: float, projector: float) -> None:
    true = make_rig(camera, projector)
    decoded, points = see(true, bumps, 0.0)
    exact = triangulate(
        replace(decoded, sigma_column=decoded.sigma_column + 0.05, sigma_row=decoded.sigma_row + 0.05), true
    )
    assert exact.valid.mean() > 0.9
    assert np.abs(exact.xyz - points)[exact.valid].max() < 2e-4
    decoded, points = see(true, bumps, 0.05)
    noisy = triangulate(decoded, true)
    ratio = ((noisy.xyz[..., 2] - points[..., 2]) / noisy.sigma_z)[noisy.valid]
    assert ratio.std() == pytest.approx(1, abs=0.02)
    off = decoded.row.copy()
    off[100:120, 200:260] += 16  # leaves the epipolar line
    assert not triangulate(replace(decoded, row=off), true).valid[100:120, 200:260].any()
    gap = np.full_like(off, np.nan)
    alone = triangulate(replace(decoded, row=gap, sigma_row=gap), true)  # the axis that carries the parallax
    assert alone.valid.mean() > 0.9
    assert np.nanmedian(np.abs(alone.xyz[..., 2] - points[..., 2])) < 0.003
    assert np.nanmax(np.abs(alone.projector[..., 1] - decoded.row)) < 1
    column = decoded.column.copy()
    column[100:120, 200:260] = np.nan
    assert not triangulate(replace(decoded, column=column), true).valid[100:120, 200:260].any()


@pytest.mark.parametrize(("camera", "projector"), [(FAR, FAR), (FAR, 3), (3, FAR), (50, 50)])
def test_the_whole_way_to_a_height_map(camera: float, projector: float) -> None:
    rig, true = found(camera, projector, told="right"), make_rig(camera, projector)
    decoded, _ = see(true, bumps, 0.05)
    points = triangulate(decoded, rig)
    pitch = footprint_grid(rig).pitch_mm
    assert pitch == 0.02  # 10 mm / 480 px
    scan = to_scan(points, rig, Grid(120, 190, 0.04, -3.78, -2.38), NOON)
    assert scan.coverage > 0.98
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    # The site frame begins where the found axis meets the board: lateral offset and turn of the found frame aside.
    shift = seen_by(true, rig, np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    turn = np.arctan2(*(shift[1] - shift[0])[[1, 0]])
    dx, dy = x - shift[0, 0], y - shift[0, 1]
    error = scan.height - bumps(np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx)
    ratio = (error / scan.sigma)[np.isfinite(error)]
    chi = float(np.sqrt((ratio**2).mean()))
    print(f"{camera}, {projector}: height error {1000 * np.nanstd(error):.2f} um, over sigma {chi:.2f}")
    assert chi == pytest.approx(1, abs=0.3)


def test_images_of_another_size_are_refused() -> None:
    rig = make_rig()
    decoded, _ = see(rig, bumps, 0.0)
    columns, rows = rig.camera.size
    taller = replace(rig, camera=replace(rig.camera, size=(columns, rows + 8)))
    with pytest.raises(
        ValueError, match=f"images of {columns}x{rows}, but the calibration is for {columns}x{rows + 8}"
    ):
        triangulate(decoded, taller)
    with pytest.raises(ValueError, match="images of"):
        scan_decoded(decoded, taller, Grid(10, 10, 0.1, 0.0, 0.0), parse_instant("2026-01-01T00:00:00Z"))
