"""How exact a height map is, by truth: the simulated rig of the paper at full size, calibrated from its own board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from monitor.rigs import BOARD, SimulatedRig, calibration_captures
from pipelines import Calibration, Frames, PatternSet, Scan, parse_instant
from pipelines.reconstruction import Board, calibrate, footprint_grid, scan_frames

PATTERNS = PatternSet("gray", (608, 684))
NOON = parse_instant("2026-11-22T12:00:00Z")
FULL, POSES = (2560, 1440), 5
REPEATS = 20
FIELD_MM = 4.5  # half the side of what is judged: the paper's 10 mm less the rim
TOP_MM = 2.5
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Accuracy:
    """Errors against truth: standard deviations, um, in cells of a camera pixel; biases, um; scale, a share."""

    plane_sd_um: float
    plane_over_sigma: float
    step_bias_um: float
    lateral_scale: float


def calibrated(camera: tuple[int, int], poses: int = POSES) -> Calibration:
    """Calibrate the rig from captures of its board."""
    frames = calibration_captures({"camera": camera}, PATTERNS, NOON, poses)
    return calibrate(frames, Board(BOARD.inner_corners, BOARD.square_mm))


def captured(camera: tuple[int, int], scene: str, minute: int = 0, **options: float) -> Frames:
    """Take one capture of a scene that lies still."""
    start = "2026-11-22T00:00:00Z"
    rig = SimulatedRig(camera=camera, scene=scene, scene_options=options, started=start, drift_mm=0.0)
    rig.open()
    return rig.capture(PATTERNS, NOON + np.timedelta64(minute, "m"))


def plane_through(scan: Scan, cells: npt.NDArray[np.bool_]) -> Floats:
    """Height, at every cell, of the plane that fits some cells best, mm."""
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    everywhere = np.stack([x, y, np.ones_like(x)], axis=-1)
    terms, height = everywhere[cells], scan.height[cells].astype(np.float64)
    good = np.ones(len(height), np.bool_)
    for _ in range(3):
        fit, *_ = np.linalg.lstsq(terms[good], height[good], rcond=None)
        off = height - terms @ fit
        good = np.abs(off) < 5 * robust_sd(off)
    plane: Floats = everywhere @ fit
    return plane


def robust_sd(values: Floats) -> float:
    """1.4826 times the median distance from the median."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def middle(scan: Scan) -> npt.NDArray[np.bool_]:
    """Measured cells of the field that is judged."""
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    inside: npt.NDArray[np.bool_] = np.isfinite(scan.height) & (np.maximum(np.abs(x), np.abs(y)) < FIELD_MM)
    return inside


def measure(camera: tuple[int, int], rig: Calibration) -> Accuracy:
    """Scan a plane and a star that stands on it; measure the board's squares in poses that the calibration left out."""
    grid = footprint_grid(rig)
    plane = scan_frames(captured(camera, "plane"), rig, grid)
    cells = middle(plane)
    off = (plane.height - plane_through(plane, cells))[cells]
    star = scan_frames(captured(camera, "star", background_mm=0.0), rig, grid)
    roof = middle(star) & (star.height > 0.5 * TOP_MM)
    ground = plane_through(star, middle(star) & (star.height < 0.5 * TOP_MM))
    squares = [check.square_mm for check in rig.held_out]
    return Accuracy(
        1e3 * float(off.std()),
        robust_sd(off / plane.sigma[cells]),
        1e3 * (float(np.median((star.height - ground)[roof])) - TOP_MM),
        float(np.mean(squares)) / BOARD.square_mm - 1,
    )


def repeats(camera: tuple[int, int], rig: Calibration, count: int = REPEATS) -> tuple[float, float]:
    """Scan one plane again and again: the median cell's standard deviation, um, and that over its sigma."""
    grid = footprint_grid(rig)
    scans = [scan_frames(captured(camera, "plane", n), rig, grid) for n in range(count)]
    stack = np.stack([scan.height for scan in scans])
    keep = np.isfinite(stack).all(axis=0)
    heights = stack[:, keep] - np.median(stack[:, keep], axis=1, keepdims=True)
    spread = heights.std(axis=0, ddof=1)
    return 1e3 * float(np.median(spread)), float(np.median(spread / scans[0].sigma[keep]))


def main() -> None:
    """Print the table."""
    rig = calibrated(FULL)
    found = measure(FULL, rig)
    print(
        f"simulated rig of the paper, {FULL[0]}x{FULL[1]}, calibrated from {POSES} poses of its board, one cell a pixel"
    )
    print(f"  plane, sd of all cells about the best plane    {found.plane_sd_um:8.2f} um    bar 2")
    print(f"  the same over sigma, robust                    {found.plane_over_sigma:8.2f}")
    print(f"  step of {TOP_MM} mm, bias                         {found.step_bias_um:8.2f} um    bar 2")
    print(f"  lateral scale, board's squares in poses left out {100 * found.lateral_scale:+6.3f} %    bar 0.1")
    small = (960, 720)
    spread, share = repeats(small, calibrated(small))
    print(
        f"  {REPEATS} scans of one plane at {small[0]}x{small[1]}, sd of a cell  {spread:8.2f} um, {share:.2f} of sigma"
    )


if __name__ == "__main__":
    main()
