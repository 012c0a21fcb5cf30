"""The paper's board of 6x7 squares of 0.7 mm, symmetric boards, ends and mirrors: drawn, found and calibrated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipelines.reconstruction import Board, Calibration, Decoded, calibrate_decoded
from pipelines.reconstruction.calibration import Mirrored
from pipelines.reconstruction.pinhole import Floats, project, rotation
from pipelines.reconstruction.sight import sight

from .exact_rig import make_rig, turned

SIZE = (640, 400)
PAPER = Board.of_squares((6, 7), 0.7)
SYMMETRIC = Board((6, 6), 0.6)  # equal sides, equal colours at both ends
TILTS = ((0.0, 0.0), (0.3, 0.1), (-0.25, 0.25), (0.1, -0.35))


def seen(board: Board, n: int, turned: bool = False) -> Decoded:
    """What both devices see of the drawn board, tilted; or of the same board laid the other way round."""
    rig = make_rig(SIZE)
    R, t = rotation(np.array([*TILTS[n], 0.08 * n + (np.pi if turned else 0.0)])), np.array([0.2 * n - 0.3, 0.1, 50.0])
    pixels = np.stack(np.meshgrid(*(np.arange(side) for side in SIZE)), axis=-1).astype(np.float64)
    picture = np.zeros(pixels.shape[:2])
    for du in (-0.25, 0.25):  # each pixel is the mean of four points in it
        for dv in (-0.25, 0.25):
            flat = on_board(rig, R, t, pixels + np.array([du, dv]))
            squares = np.array(board.inner_corners) + 1
            place = flat / board.square_mm + squares / 2
            inside = ((place >= 0) & (place < squares)).all(axis=-1)
            dark = inside & (np.floor(place).sum(axis=-1) % 2 == 0)
            picture += np.where(dark, 40.0, 200.0) / 4
    picture += np.random.default_rng(n).normal(0, 1, picture.shape)
    start, ray = sight(rig.camera, pixels)
    points = start + ray * ((R[:, 2] @ t) / (ray @ R[:, 2]))[..., None]
    lit = project(rig.projector, points @ rig.R.T + rig.t_mm)
    lit += np.random.default_rng(9 + n).normal(0, 0.05, lit.shape)
    column, row = np.moveaxis(lit.astype(np.float32), -1, 0)
    sigma, level = np.full(column.shape, 0.05, np.float32), np.zeros(column.shape, np.uint8)
    return Decoded(column, row, sigma, sigma, level, picture.astype(np.uint8), np.full_like(level, 150))


def on_board(rig: Calibration, R: Floats, t: Floats, pixels: Floats) -> Floats:
    start, ray = sight(rig.camera, pixels)
    points = start + ray * ((R[:, 2] @ t) / (ray @ R[:, 2]))[..., None]
    return (points - t) @ R[:, :2]


@cache
def captures(board: Board) -> tuple[Decoded, ...]:
    return tuple(seen(board, n) for n in range(len(TILTS)))


@cache
def straight(board: Board) -> Calibration:
    return calibrate_decoded(captures(board), (608, 684), board)


@pytest.mark.parametrize("board", [PAPER, SYMMETRIC, Board((6, 5), 0.7)], ids=["paper", "symmetric", "other order"])
def test_small_boards_calibrate_the_rig(board: Board) -> None:
    found = calibrate_decoded(captures(board), (608, 684), board)
    print(f"{board.size_text}: {dict(found.rms_px)}, {[pose.found for pose in found.poses]}")
    assert found.rms_px["stereo"] < 0.15
    assert [pose.found for pose in found.poses] == [board.inner_corners[0] * board.inner_corners[1]] * len(TILTS)
    for check in found.squares:
        assert check.square_mm == pytest.approx(board.square_mm, rel=2e-3)
    assert not found.camera.mirrored
    assert not found.projector.mirrored


@pytest.mark.parametrize("board", [PAPER, SYMMETRIC], ids=["paper", "symmetric"])
def test_a_board_laid_the_other_way_round_changes_nothing(board: Board) -> None:
    """Its corners are then found from the other end, or with the other colour first."""
    turned = [seen(board, n, turned=n % 2 == 1) for n in range(len(TILTS))]
    found = calibrate_decoded(turned, (608, 684), board)
    assert found.rms_px["stereo"] == pytest.approx(straight(board).rms_px["stereo"], abs=0.02)
    assert pytest.approx(straight(board).R, abs=0.03) == found.R  # a small board leaves the principal points open
    assert found.camera.K[0, 0] == pytest.approx(straight(board).camera.K[0, 0], rel=0.02)


@pytest.mark.parametrize(
    ("camera", "projector", "told"),
    [(True, False, "auto"), (False, True, "projector"), (True, True, "both")],
    ids=["camera", "projector", "both"],
)
def test_mirrored_optics_with_the_paper_s_board(camera: bool, projector: bool, told: Mirrored) -> None:
    here = [mirrored(each, camera, projector) for each in captures(PAPER)]
    found = calibrate_decoded(here, (608, 684), PAPER, mirrored=told)
    assert (found.camera.mirrored, found.projector.mirrored) == (camera, projector)
    assert found.rms_px["stereo"] == pytest.approx(straight(PAPER).rms_px["stereo"], abs=0.02)
    assert np.linalg.det(found.R) == pytest.approx(1)
    for check in found.squares:
        assert check.square_mm == pytest.approx(0.7, rel=2e-3)


def mirrored(decoded: Decoded, camera: bool, projector: bool) -> Decoded:
    if projector:
        decoded = replace(decoded, column=607 - decoded.column)
    if camera:
        decoded = turned(decoded, np.s_[:, ::-1])
    return decoded
