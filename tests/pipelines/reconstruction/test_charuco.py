"""ChArUco boards: rendered through lenses, seen in part, in a mirror, and described wrongly."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from pipelines.reconstruction import Calibration, CharucoBoard, Decoded, calibrate_decoded
from pipelines.reconstruction.corner_search import find_board
from pipelines.reconstruction.pinhole import project, rotation, undistort

from .exact_rig import make_rig, turned

SIZE = (960, 600)
BOARD = CharucoBoard((9, 6), 1.0, 0.7, "DICT_4X4_50")
# Tilt about x and y, and where the board's middle lies (mm): it leaves the image in the last two.
PLACES = (
    (0.0, 0.05, 0.0, 0.0),
    (0.35, 0.1, 0.3, 0.1),
    (-0.3, 0.3, -0.4, 0.0),
    (0.1, -0.4, 3.4, 1.0),
    (-0.2, -0.2, -4, 1),
)


@cache
def seen(place: int) -> Decoded:
    """What camera and projector see of the board in this place."""
    rig = make_rig(SIZE)
    a, b, x, y = PLACES[place]
    R, t = rotation(np.array([a, b, 0.05 * place])), np.array([x, y, 50.0])
    pixels = np.stack(np.meshgrid(*(np.arange(n) for n in SIZE)), axis=-1).astype(np.float64)
    rays = np.concatenate([undistort(rig.camera, pixels), np.ones((*pixels.shape[:2], 1))], axis=-1)
    points = rays * ((R[:, 2] @ t) / (rays @ R[:, 2]))[..., None]
    flat = (points - t) @ R[:, :2] + np.array([4.5, 3.0])  # mm on the board, from its corner
    scale = 60
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard((9, 6), 1.0, 0.7, dictionary).generateImage((9 * scale, 6 * scale), marginSize=0)
    where = (flat * scale - 0.5).astype(np.float32)
    picture = cv2.remap(drawn, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderValue=255)
    picture = cv2.GaussianBlur((40 + picture * 0.7).astype(np.uint8), (0, 0), 0.8)
    lit = project(rig.projector, points @ rig.R.T + rig.t_mm)
    outside = ((lit < 0) | (lit > np.array([607, 683]))).any(axis=-1)
    lit[outside] = np.nan
    noise = np.random.default_rng(place).normal(0, 0.05, lit.shape)
    column, row = np.moveaxis((lit + noise).astype(np.float32), -1, 0)
    sigma = np.where(outside, np.nan, 0.05).astype(np.float32)
    level = np.where(outside, 255, 0).astype(np.uint8)
    return Decoded(column, row, sigma, sigma.copy(), level, np.asarray(picture, np.uint8), np.full_like(level, 150))


@cache
def calibrated() -> Calibration:
    return calibrate_decoded([seen(n) for n in range(5)], (608, 684), BOARD)


def test_a_board_that_is_seen_in_part_calibrates_the_rig() -> None:
    rig, found = make_rig(SIZE), calibrated()
    counts = [pose.found for pose in found.poses]
    assert counts[0] == 40
    assert min(counts[3:]) < 40  # these leave the image
    assert found.rms_px["stereo"] < 0.2
    assert found.camera.K[0, 0] == pytest.approx(rig.camera.K[0, 0], rel=0.01)
    for check in found.squares:
        assert check.square_mm == pytest.approx(1.0, abs=0.002)
    assert not found.camera.mirrored
    assert not found.projector.mirrored
    assert found.board == {
        "kind": "charuco",
        "inner_corners": [8, 5],
        "square_mm": 1.0,
        "marker_mm": 0.7,
        "dictionary": "DICT_4X4_50",
    }


def test_markers_tell_which_device_is_mirrored() -> None:
    camera = [turned(seen(n), np.s_[:, ::-1]) for n in range(3)]
    found = calibrate_decoded(camera, (608, 684), BOARD)
    assert (found.camera.mirrored, found.projector.mirrored) == (True, False)
    projector = [replace(seen(n), column=607 - seen(n).column) for n in range(3)]
    found = calibrate_decoded(projector, (608, 684), BOARD)
    assert (found.camera.mirrored, found.projector.mirrored) == (False, True)
    with pytest.raises(ValueError, match="pose 0 shows the board in a mirror, pose 1 does not"):
        calibrate_decoded([camera[0], seen(1), seen(2)], (608, 684), BOARD)


def test_corners_are_found_where_they_are() -> None:
    rig = make_rig(SIZE)
    here = find_board(seen(1).texture, BOARD, "tilted")
    a, b, x, y = PLACES[1]
    R, t = rotation(np.array([a, b, 0.05])), np.array([x, y, 50.0])
    flat = here.lattice + 1.0 - np.array([4.5, 3.0])
    true = project(rig.camera, np.c_[flat, np.zeros(len(flat))] @ R.T + t)
    off = np.linalg.norm(here.corners - true, axis=1)
    assert np.median(off) < 0.1
    assert off.max() < 0.5


@pytest.mark.parametrize(
    ("board", "message"),
    [
        (replace(BOARD, dictionary="DICT_6X6_50"), "no marker of DICT_6X6_50 is seen: is it the board's dictionary"),
        (replace(BOARD, dictionary="4x4"), "no marker dictionary '4x4'; there are DICT_4X4_100, "),
        (replace(BOARD, squares=(6, 9)), "6x9 squares: .* markers are seen, but only .* of 40 corners"),
    ],
)
def test_a_board_described_wrongly_is_told_in_one_line(board: CharucoBoard, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        find_board(seen(0).texture, board, "flat")


def test_a_board_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="must be smaller than its square"):
        CharucoBoard((7, 5), 1.0, 1.2, "DICT_4X4_50")
    with pytest.raises(ValueError, match="at least 3x3"):
        CharucoBoard((7, 2), 1.0, 0.7, "DICT_4X4_50")
