"""The paper's star, from frames to a height map by the rig's own calibration: height, volume, and not a cell lost."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import minimize

from monitor.rigs import BOARD, SimulatedRig, calibration_captures
from pipelines import Calibration, PatternSet, Scan, parse_instant
from pipelines.reconstruction import Board, calibrate, footprint_grid, scan_frames
from pipelines.scenes import Star

PATTERNS = PatternSet("gray", (608, 684))
NOON = parse_instant("2026-11-22T12:00:00Z")
CAMERA, FULL = (960, 720), (2560, 1440)
BLACK = {"background_mm": 0.0, "background_reflects": 0.004}
Floats = npt.NDArray[np.float64]


@cache
def rig_calibration(camera: tuple[int, int]) -> Calibration:
    board = Board(BOARD.inner_corners, BOARD.square_mm)
    return calibrate(calibration_captures({"camera": camera}, PATTERNS, NOON, 4), board)


def scan_star(camera: tuple[int, int], **options: Any) -> Scan:
    rig = SimulatedRig(camera=camera, scene="star", scene_options=options)
    rig.open()
    calibration = rig_calibration(camera)
    return scan_frames(rig.capture(PATTERNS, NOON), calibration, footprint_grid(calibration))


def laid_over(star: Star, scan: Scan) -> tuple[Floats, Floats]:
    """Where the scan's cells lie on the star, found from the measured outline alone: turn and shift, x and y."""
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    few = (slice(1, None, 3), slice(1, None, 3))
    measured = np.isfinite(scan.height)[few]

    def placed(x: Floats, y: Floats, turn: float, right: float, up: float) -> tuple[Floats, Floats]:
        c, s = np.cos(turn), np.sin(turn)
        return c * (x - right) - s * (y - up), s * (x - right) + c * (y - up)

    def misfit(guess: Floats) -> float:
        off = (star.outline(*placed(x[few], y[few], *guess)) - 1) * star.edge_distance_mm
        return float(np.abs(np.clip(off, -0.1, 0.1) / 0.1 + np.where(measured, 1.0, -1.0)).mean())

    middle = [float(x[few][measured].mean()), float(y[few][measured].mean())]
    starts = [np.array([turn, *middle]) for turn in np.arange(0, 2 * np.pi / star.tips, np.pi / 36)]
    best = minimize(misfit, min(starts, key=misfit), method="Nelder-Mead", options={"xatol": 2e-4, "fatol": 1e-6})
    return placed(x, y, *best.x)


STARS = pytest.mark.parametrize(
    "options",
    [{}, {"rim_mm": 1.0}, BLACK, {"rim_mm": 1.0, **BLACK}],
    ids=[
        "flat roof high above a background",
        "ridged roof high above a background",
        "flat on black",
        "ridged on black",
    ],
)


@STARS
def test_the_star_of_the_paper(options: dict[str, Any]) -> None:
    judge(CAMERA, options)


@pytest.mark.soak
@STARS
def test_the_star_of_the_paper_at_full_size(options: dict[str, Any]) -> None:
    judge(FULL, options)


def judge(camera: tuple[int, int], options: dict[str, Any]) -> None:
    star, scan = Star(**options), scan_star(camera, **options)
    x, y = laid_over(star, scan)
    inside_mm = (1 - star.outline(x, y)) * star.edge_distance_mm
    truth = star.rim + (star.height_mm - star.rim) * inside_mm / star.edge_distance_mm
    measured = np.isfinite(scan.height)
    error = scan.height - truth
    within = inside_mm > 1.5 * scan.grid.pitch_mm  # a camera pixel and a cell: nearer, a cell is half a star's
    lost = int(np.count_nonzero(within & ~measured))
    height_um = 1000 * float(np.median(error[within & measured]))
    top = star.height_mm + float(np.median(error[inside_mm > 0.9 * star.edge_distance_mm]))
    volume = float(np.nansum(scan.height)) * scan.grid.pitch_mm**2
    background = int(np.count_nonzero(measured & (inside_mm < -5 * scan.grid.pitch_mm)))
    print(
        f"star {options}: height {height_um:+.2f} um (median), top {top:.4f} mm, volume {volume:.3f} mm3 of "
        f"{star.volume_mm3:.3f} ({100 * (volume / star.volume_mm3 - 1):+.2f} %), "
        f"{lost} of {np.count_nonzero(within)} cells lost, {background} cells of the background left"
    )
    assert abs(height_um) < 5
    assert top == pytest.approx(star.height_mm, abs=0.005)
    assert volume == pytest.approx(star.volume_mm3, rel=0.01)
    assert lost == 0
    assert background < 1e-4 * scan.height.size
