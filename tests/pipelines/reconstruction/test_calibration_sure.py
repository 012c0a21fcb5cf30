"""How sure a calibration is, what it says of boards, and which poses it names as bad."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pipelines.reconstruction import Board, Calibration, calibrate
from pipelines.reconstruction.board_check import check_board, corner_points
from pipelines.reconstruction.bundle import Corners, _pair, adjust
from pipelines.reconstruction.corner_evidence import Fit, fit
from pipelines.reconstruction.pinhole import Floats, project, rotation_vector, undistort
from pipelines.reconstruction.solve import _rig, solve
from pipelines.reconstruction.stereo_start import PoseCorners, flat
from storage import read_capture, read_patterns

from .exact_rig import BOARD, TILTS, board_corners, make_rig

SIZES = ((640, 400), (608, 684))


def solved(poses: list[PoseCorners]) -> Calibration:
    return solve(poses, *SIZES, BOARD, 0, "")


@cache
def exact() -> Fit:
    return fit(board_corners(make_rig()), SIZES, ("none",))


@cache
def noisy() -> Calibration:
    return solved(drawn(0))


def drawn(seed: int) -> list[PoseCorners]:
    """Another draw of the same noise, on the same boards."""
    random = np.random.default_rng(100 + seed)
    return [
        replace(
            pose,
            camera=pose.camera + random.normal(0, 0.1, pose.camera.shape),
            projector=pose.projector + random.normal(0, 0.1, pose.projector.shape),
        )
        for pose in board_corners(make_rig())
    ]


@cache
def repeated() -> list[Calibration]:
    """The same boards calibrated again and again, from the exact rig on."""
    rigs = []
    for seed in range(16):
        solution = adjust(flat(drawn(seed)), exact().solution, SIZES, (0.1, 0.1))
        rigs.append(_rig(exact(), solution, 0, SIZES))
    return rigs


def test_derivatives_are_those_of_finite_differences() -> None:
    poses = board_corners(make_rig(), noise_px=0.3)
    corners: Corners = flat(poses)
    solution = exact().solution
    problem = _pair(corners, (0.2, 0.3))
    vector = solution.packed()
    _, normal, slope = problem.equations(vector, soft=False)
    J = np.empty((2 * 2 * len(corners.pose), len(vector)))
    for k in range(len(vector)):
        step = np.zeros_like(vector)
        step[k] = 1e-5 * max(1.0, abs(vector[k]))
        J[:, k] = (problem.errors(vector + step) - problem.errors(vector - step)).ravel() / (2 * step[k])
    size = np.sqrt(np.diag(normal))
    assert np.abs(normal - J.T @ J).max() < 1e-5 * np.abs(normal).max()
    assert np.abs((normal - J.T @ J) / np.outer(size, size)).max() < 1e-5
    assert np.abs((slope - J.T @ problem.errors(vector).ravel()) / size).max() < 1e-4


def test_sigma_is_the_scatter_of_repeated_calibrations() -> None:
    rigs = repeated()
    told = noisy().sigma
    assert told is not None
    found = {
        "camera fx": ([rig.camera.K[0, 0] for rig in rigs], told["camera"]["fx"]),
        "projector fy": ([rig.projector.K[1, 1] for rig in rigs], told["projector"]["fy"]),
        "projector cx": ([rig.projector.K[0, 2] for rig in rigs], told["projector"]["cx"]),
        "z of the projector": ([rig.t_mm[2] for rig in rigs], told["t_mm"][2]),
        "turn": ([float(rotation_vector(rig.R)[1]) for rig in rigs], np.radians(told["turn_deg"][1])),
    }
    for name, (values, sigma) in found.items():
        ratio = float(np.std(values, ddof=1)) / sigma
        print(f"{name}: scatter over sigma {ratio:.2f}")
        assert 0.6 < ratio < 1.5, name  # 16 draws tell a standard deviation to 18 %


def test_the_field_s_uncertainty_is_what_heights_do() -> None:
    rig = make_rig()
    rigs = repeated()
    told = noisy().sigma
    assert told is not None
    corners = np.concatenate([pose.camera for pose in board_corners(rig)])
    columns, rows = (np.linspace(corners[:, k].min(), corners[:, k].max(), n) for k, n in ((0, 12), (1, 9)))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = np.c_[undistort(rig.camera, pixels), np.ones(len(pixels))] * 50.0
    plane = rays @ rig.reference[:, :3].T + rig.reference[:, 3]
    flat_terms = np.c_[np.ones(len(plane)), plane[:, :2]]
    bows, scales, wide = [], [], []
    for each in rigs:
        low, middle, high = (seen_by(rig, each, plane + np.array([0, 0, z])) for z in (-0.4, 0.0, 0.4))
        left = middle[:, 2] - flat_terms @ np.linalg.lstsq(flat_terms, middle[:, 2], rcond=None)[0]
        bows.append(float(np.sqrt((left**2).mean())))
        scales.append(float((high[:, 2] - low[:, 2]).mean() / 0.8 - 1))
        turn = np.linalg.lstsq(flat_terms, middle[:, :2], rcond=None)[0][1:]
        wide.append(float(np.sqrt(abs(np.linalg.det(turn))) - 1))
    field = told["field"]
    seen = {
        "bow_um": 1000 * np.sqrt(np.mean(np.square(bows))),
        "height_scale_percent": 100 * np.sqrt(np.mean(np.square(scales))),
        "lateral_scale_percent": 100 * np.sqrt(np.mean(np.square(wide))),
    }
    for name, value in seen.items():
        print(f"{name}: told {field[name]:.4f}, seen {value:.4f}")
        assert 0.6 < value / field[name] < 1.6


def seen_by(true: Calibration, found: Calibration, site: Floats) -> Floats:
    """Where a calibration puts points of the true site frame, in its own site frame."""
    points = (site - true.reference[:, 3]) @ true.reference[:, :3]
    seen, lit = project(true.camera, points), project(true.projector, points @ true.R.T + true.t_mm)
    return corner_points(found, seen, lit) @ found.reference[:, :3].T + found.reference[:, 3]


def test_what_the_corners_leave_open_is_named() -> None:
    told = noisy().sigma
    assert told is not None
    assert [pose["name"] for pose in told["poses"]] == [f"pose {n}" for n in range(5)]
    text = " | ".join(told["weak"])
    assert "principal point known to ±" in text


def test_boards_are_measured_in_their_own_pose_and_held_out() -> None:
    rig = noisy()
    assert len(rig.squares) == len(rig.held_out) == len(TILTS)
    for own, out in zip(rig.squares, rig.held_out, strict=True):
        assert own.name == out.name
        assert own.square_mm == pytest.approx(0.9, abs=0.001)
        assert out.square_mm == pytest.approx(0.9, abs=0.002)
        assert own.squares == 110
    # A calibration from 3 poses has none to spare.
    assert solved(board_corners(make_rig(), 0.1)[:3]).held_out == ()


def test_a_held_out_board_of_another_size_betrays_itself() -> None:
    poses = board_corners(make_rig(), noise_px=0.05)
    check = check_board(noisy(), poses[2], BOARD.square_mm)
    assert check.square_mm == pytest.approx(0.9, abs=0.001)
    bent = poses[2].projector.copy()
    bent[:, 0] += 2.0 * np.linspace(-1, 1, 63) ** 2
    assert check_board(noisy(), replace(poses[2], projector=bent), 0.9).flatness_mm > 5 * check.flatness_mm


def damaged(pose: PoseCorners, how: str) -> PoseCorners:
    lit = pose.projector.copy()
    if how == "shifted":  # as of another pattern set: consistent in itself
        lit += (60.0, 0.0)
    elif how == "steps":  # two stripe frames exchanged
        lit[:, 0] += 32 * ((lit[:, 0] // 32) % 2) - 16
    elif how == "moved":
        lit += 5 * np.sin(pose.board @ np.array([[1.0, 0.4], [0.2, 1.0]]))
    return replace(pose, projector=lit)


@pytest.mark.parametrize(("how", "place"), [("shifted", 1), ("steps", 4), ("moved", 2)])
def test_a_damaged_pose_is_named_and_left_out_as_a_whole(how: str, place: int) -> None:
    poses = board_corners(make_rig(), noise_px=0.05)
    poses[place] = damaged(poses[place], how)
    found = solved(poses)
    assert [bool(pose.advice) for pose in found.poses] == [n == place for n in range(5)]
    assert found.poses[place].kept == 0
    assert "capture it again" in found.poses[place].advice
    assert found.poses[place].projector_px > 2
    assert found.rms_px["stereo"] == pytest.approx(0.05 * np.sqrt(2), rel=0.15)
    assert [check.name for check in found.held_out] == [f"pose {n}" for n in range(5) if n != place]


def test_too_few_good_poses_are_an_error_that_names_the_bad_one() -> None:
    poses = board_corners(make_rig(), noise_px=0.05)[:3]
    with pytest.raises(
        ValueError, match=r"pose 1: 55% of its decoded pixels do not lie on one plane.*capture it again"
    ):
        solved([poses[0], replace(poses[1], agreeing=0.45), poses[2]])
    with pytest.raises(ValueError, match=r"pose 0: .*heights are to count from its board"):
        solved([replace(poses[0], agreeing=0.3), *board_corners(make_rig(), noise_px=0.05)[1:]])


def test_a_real_pose_whose_frames_are_out_of_order_is_named(shared_data: Path) -> None:
    patterns = read_patterns(shared_data / "kamino410" / "patterns.yaml")
    poses = [read_capture(shared_data / "kamino410" / f"capture_{n}", patterns) for n in range(3)]
    stack = poses[1].stack.copy()
    stack[[4, 5, 10, 11]] = stack[[10, 11, 4, 5]]
    poses[1] = replace(poses[1], stack=stack)
    with pytest.raises(ValueError, match=r"second: .* of its decoded pixels do not lie on one plane.*capture it again"):
        calibrate(poses, Board((7, 9), 75.0), ["first", "second", "third"])


def test_the_same_corners_give_the_same_bits() -> None:
    again = solved(board_corners(make_rig(), noise_px=0.1))
    first = solved(board_corners(make_rig(), noise_px=0.1))
    assert again.to_json() == first.to_json()


def test_the_id_is_of_the_numbers_that_place_points() -> None:
    rig = noisy()
    bare = replace(rig, sigma=None, squares=(), held_out=(), poses=(), rms_px={}, software="another")
    assert bare.id == rig.id
    assert replace(rig, t_mm=rig.t_mm + 1e-9).id != rig.id
    read = Calibration.from_json(rig.to_json())
    assert (read.id, read.poses, read.squares, read.held_out) == (rig.id, rig.poses, rig.squares, rig.held_out)
    assert read.sigma == rig.sigma
    old = bare.as_mapping()
    for key in ("sigma", "squares", "held_out"):
        del old[key]
    assert Calibration.from_json(json.dumps(old)).id == rig.id
