"""Calibration recovers a rig in closed form, whatever turns, mirrors or counts the board from its other end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.reconstruction import Board, Calibration, Decoded, Lens, calibrate_decoded
from pipelines.reconstruction.pinhole import Floats, distort, project, rotation, rotation_vector, undistort
from pipelines.reconstruction.solve import solve
from pipelines.reconstruction.stereo_start import PoseCorners

from .exact_rig import BOARD, board_corners, make_rig

W, H = 640, 400


def solved(poses: list[PoseCorners], mirrored: str = "auto", reference: int = 0) -> Calibration:
    return solve(poses, (W, H), (608, 684), BOARD, reference, "", mirrored)


@cache
def plain(noise_px: float) -> Calibration:
    return solved(board_corners(make_rig(), noise_px))


def site_points(found: Calibration, pose: PoseCorners) -> Floats:
    """The corners of a pose in the site frame, triangulated from what both devices see of them."""
    seen, lit = undistort(found.camera, pose.camera), undistort(found.projector, pose.projector)
    points = []
    for (u, v), (x, y) in zip(seen, lit, strict=True):
        ray = np.array([u, v, 1.0])
        d, t = found.R @ ray, found.t_mm
        a = np.array([d[0] - x * d[2], d[1] - y * d[2]])
        b = np.array([t[0] - x * t[2], t[1] - y * t[2]])
        points.append(ray * -(a @ b) / (a @ a))
    return np.array(points) @ found.reference[:, :3].T + found.reference[:, 3]


def test_recovers_an_exact_rig() -> None:
    rig = make_rig()
    found = plain(0.0)
    assert found.rms_px["stereo"] < 1e-4
    assert_allclose(found.camera.K, rig.camera.K, rtol=1e-5, atol=0.02)
    assert_allclose(found.projector.K, rig.projector.K, rtol=1e-5, atol=0.02)
    assert_allclose(found.R, rig.R, rtol=0, atol=1e-5)
    assert_allclose(found.t_mm, rig.t_mm, rtol=0, atol=1e-3)
    assert [pose.kept for pose in found.poses] == [63] * 5
    assert found.camera.dist[4] == 0 == found.projector.dist[4]


def test_rms_is_that_of_opencv() -> None:
    rig = make_rig()
    poses = board_corners(rig, noise_px=0.2)
    found = solved(poses)
    # 0.2 px in each of two coordinates, less what 52 parameters take of 1260 numbers.
    assert found.rms_px["stereo"] == pytest.approx(0.2 * np.sqrt(2) * np.sqrt(1 - 52 / 1260), rel=0.06)
    both = (found.rms_px["camera"] ** 2 + found.rms_px["projector"] ** 2) / 2
    assert found.rms_px["stereo"] == pytest.approx(np.sqrt(both))


def half_turn(size: tuple[int, int]) -> Callable[[Floats], Floats]:
    return lambda px: np.array(size) - 1 - px


def mirror(columns: int) -> Callable[[Floats], Floats]:
    return lambda px: np.stack([columns - 1 - px[:, 0], px[:, 1]], axis=1)


def same(px: Floats) -> Floats:
    return px


@pytest.mark.parametrize(
    ("camera", "projector", "told", "camera_mirrored", "projector_mirrored"),
    [
        (half_turn((W, H)), same, "auto", False, False),
        (same, half_turn((608, 684)), "auto", False, False),
        (mirror(W), same, "auto", True, False),
        (same, mirror(608), "projector", False, True),
        (same, mirror(608), "auto", True, False),  # which of the two cannot be known: the camera is assumed
        (mirror(W), half_turn((608, 684)), "auto", True, False),
    ],
)
def test_inversion_and_mirrors_are_found(
    camera: Callable[[Floats], Floats],
    projector: Callable[[Floats], Floats],
    told: str,
    camera_mirrored: bool,
    projector_mirrored: bool,
) -> None:
    poses = board_corners(make_rig(), noise_px=0.05)
    straight = plain(0.05)
    turned = [replace(pose, camera=camera(pose.camera), projector=projector(pose.projector)) for pose in poses]
    found = solved(turned, told)
    assert (found.camera.mirrored, found.projector.mirrored) == (camera_mirrored, projector_mirrored)
    assert found.rms_px["stereo"] == pytest.approx(straight.rms_px["stereo"], rel=0.01)
    assert np.linalg.det(found.R) == pytest.approx(1)
    for before, after in zip(poses, turned, strict=True):
        a, b = site_points(straight, before), site_points(found, after)
        assert b[:, 2] == pytest.approx(a[:, 2], abs=0.003)  # the same heights: 0.05 px are 3 um here
        assert np.linalg.norm(b[0] - b[-1]) == pytest.approx(np.linalg.norm(a[0] - a[-1]), abs=0.003)


def test_a_mirrored_camera_sees_the_same_world_not_its_mirror_image() -> None:
    poses = board_corners(make_rig())
    found = solved(turned(poses))
    both = ((plain(0.0), poses), (found, turned(poses)))
    a, b = (np.concatenate([site_points(rig, pose) for pose in seen]) for rig, seen in both)
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    assert np.linalg.det(np.linalg.lstsq(a, b, rcond=None)[0]) == pytest.approx(1, abs=1e-3)


def turned(poses: list[PoseCorners]) -> list[PoseCorners]:
    return [replace(pose, camera=mirror(W)(pose.camera)) for pose in poses]


@pytest.mark.parametrize("ends", ["reversed", "columns", "rows", "each pose another"])
def test_the_end_that_corners_are_counted_from_changes_nothing(ends: str) -> None:
    poses = board_corners(make_rig(), noise_px=0.05)
    straight = plain(0.05)
    columns, rows = BOARD.inner_corners
    lattice = np.arange(columns * rows).reshape(rows, columns)
    orders = {
        "reversed": [lattice[::-1, ::-1]] * 5,
        "columns": [lattice[:, ::-1]] * 5,
        "rows": [lattice[::-1]] * 5,
        "each pose another": [lattice, lattice[::-1, ::-1], lattice[:, ::-1], lattice[::-1], lattice],
    }[ends]
    other = [
        replace(pose, camera=pose.camera[order.ravel()], projector=pose.projector[order.ravel()])
        for pose, order in zip(poses, orders, strict=True)
    ]
    found = solved(other)
    assert_allclose(found.reference, straight.reference, rtol=0, atol=1e-5)
    assert_allclose(found.camera.K, straight.camera.K, rtol=1e-5)
    assert_allclose(found.t_mm, straight.t_mm, rtol=0, atol=1e-3)


def test_outlying_corners_are_rejected_and_named() -> None:
    poses = board_corners(make_rig(), noise_px=0.05)
    moved = poses[2].projector.copy()
    moved[17] += (4.0, -3.0)
    gone = poses[3].projector.copy()
    gone[5] = np.nan
    poses[2], poses[3] = replace(poses[2], projector=moved), replace(poses[3], projector=gone)
    found = solved(poses)
    assert [pose.kept for pose in found.poses][2:4] == [62, 62]
    assert sum(pose.kept for pose in found.poses) >= 0.95 * 315
    for number, corner in ((2, 17), (3, 5)):
        assert found.poses[number].rejected == (tuple(poses[number].camera[corner].round(1)),)


def test_rejection_goes_by_evidence_not_to_a_quota() -> None:
    random = np.random.default_rng(3)
    poses = board_corners(make_rig(), noise_px=0.02)
    wild = [replace(pose, projector=pose.projector.copy()) for pose in poses]
    for pose in wild:
        pose.projector[random.choice(63, 10, replace=False)] += 2.0
    assert [pose.kept for pose in solved(wild).poses] == [53] * 5
    # Errors with long tails, nowhere a gross one: nothing to reject.
    tails = board_corners(make_rig())
    for pose in tails:
        pose.camera[:] += 0.05 * random.laplace(size=pose.camera.shape)
        pose.projector[:] += 0.05 * random.laplace(size=pose.projector.shape)
    assert sum(pose.kept for pose in solved(tails).poses) >= 0.98 * 315


def test_site_frame_is_right_handed_looks_at_the_camera_and_follows_the_reference_pose() -> None:
    poses = board_corners(make_rig())
    for reference in (0, 3):
        found = solved(poses, reference=reference)
        M = found.reference[:, :3]
        assert np.linalg.det(M) == pytest.approx(1)
        assert M[2, 2] < 0 < M[0, 0]
        origin = -M.T @ found.reference[:, 3]
        assert origin[:2] == pytest.approx([0, 0], abs=1e-9)  # on the camera's axis
        assert site_points(found, poses[reference])[:, 2] == pytest.approx(0, abs=1e-4)


def test_rotation_vectors_and_distortion_go_both_ways() -> None:
    vector = np.array([0.3, -1.2, 0.4])
    assert rotation_vector(rotation(vector)) == pytest.approx(vector)
    lens = make_rig().camera
    pixels = np.random.default_rng(1).uniform(0, 400, (50, 2))
    rays = np.c_[undistort(lens, pixels), np.ones(50)]
    assert project(lens, rays) == pytest.approx(pixels, abs=1e-9)
    x, y = distort(rays[:, 0], rays[:, 1], np.zeros(5))
    assert np.allclose([x, y], rays[:, :2].T)


def test_a_lens_of_negative_focal_length_is_a_mirror() -> None:
    lens = make_rig().camera
    mirrored = Lens(lens.size, lens.K * np.array([[-1, 1, 1], [1, 1, 1], [1, 1, 1]]), lens.dist)
    assert mirrored.mirrored
    assert not lens.mirrored
    assert project(mirrored, np.array([1.0, 0, 50]))[0] < project(mirrored, np.array([-1.0, 0, 50]))[0]


def blank(size: tuple[int, int] = (200, 150)) -> Decoded:
    gap = np.full(size[::-1], np.nan, np.float32)
    grey = np.full(size[::-1], 90, np.uint8)
    return Decoded(gap, gap, gap, gap, grey, grey, grey)


def test_what_a_beginner_does_wrong_is_said_in_one_line() -> None:
    board = Board((9, 7), 0.9)
    with pytest.raises(ValueError, match=r"2 poses given .*at least 3 are needed"):
        calibrate_decoded([blank()] * 2, (608, 684), board)
    with pytest.raises(ValueError, match="tilt b: images of 100x150, but tilt a has 200x150"):
        calibrate_decoded([chessboard(), blank((100, 150)), blank()], (608, 684), board, ["tilt a", "tilt b", "tilt c"])
    with pytest.raises(ValueError, match="pose 0: no board of 9x7 inner corners found"):
        calibrate_decoded([blank()] * 3, (608, 684), board)
    with pytest.raises(ValueError, match=r"pose 0: no board of 8x6 .* looks like 9x7: give --board 9x7"):
        calibrate_decoded([chessboard()] * 3, (608, 684), Board((8, 6), 1.0))
    with pytest.raises(ValueError, match="only 0 of 63 corners are decoded"):
        calibrate_decoded([chessboard()] * 3, (608, 684), board)
    with pytest.raises(ValueError, match="a board of 6x7 squares has 5x6 inner corners"):
        Board((2, 7), 1.0)
    with pytest.raises(ValueError, match="positive number of mm"):
        Board((5, 7), 0.0)


def chessboard() -> Decoded:
    tiles = np.indices((8, 10)).sum(axis=0) % 2
    picture = np.pad(np.kron(tiles, np.full((15, 15), 160)), ((15, 15), (25, 25)), constant_values=1) + 40
    picture[picture == 41] = 200
    return replace(blank(), texture=picture.astype(np.uint8))
