"""Error over sigma, of points and of cells some pixels wide, on the simulated rig: where sigma is true, and where not.

``python -m tests.benchmarks.bench_sigma``; ``--rows 480`` measures one camera. Truth is the scene's closed form at the
places that the pixels see, so that what a cell hides counts in neither.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from monitor.rigs import SimulatedRig
from pipelines import PatternSet, Scan, parse_instant
from pipelines.reconstruction import Calibration, footprint_grid, reconstruct, to_scan
from pipelines.scenes import SCENES
from tests.monitor.rigs.known_optics import known_geometry

NOON = parse_instant("2026-11-22T12:00:00Z")
PATTERNS = PatternSet("gray", (608, 684))
PROJECTOR_PX_MM = 0.02602
FIELD_MM = 11.2
"""Height of what the camera sees."""
CELLS = 1, 2, 4, 8
"""Widths of cells, camera pixels."""
BINS = 8
ROWS = 240, 432, 480, 720
SUBJECTS: tuple[tuple[str, float, Mapping[str, float], int], ...] = (
    ("plane", 0.0, {"z_mm": -0.3, "slope_x": 0.13, "slope_y": -0.02}, 5),
    ("plane", 0.0, {"z_mm": 0.8, "slope_x": 0.02, "slope_y": -0.1}, 77),
    ("soil", 48.0, {"seed": 23}, 41),
)
"""Scene, age in hours, its options, and the seed of the rig's noise."""
WITHIN_MM = 4.8
"""Half the side of the soil: the holder around it is flat and does not count."""

Values = npt.NDArray[np.float64]


def robust_sd(values: Values) -> float:
    """Standard deviation as the median of absolute deviations has it."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def ratio(error: Values, sigma: Values) -> str:
    """Robust error over sigma of all, and of the lowest and highest of bins of sigma."""
    off = error / sigma
    of_bins = [robust_sd(off[part]) for part in np.array_split(np.argsort(sigma), BINS)]
    return f"{robust_sd(off):.2f} ({min(of_bins):.2f} to {max(of_bins):.2f})"


def compared(scan: Scan, true: Scan, inner: bool) -> str:
    """The same of a scan's cells."""
    off = scan.height.astype(np.float64) - true.height
    use = np.isfinite(off)
    if inner:
        use &= (np.abs(scan.grid.x_mm[None, :]) < WITHIN_MM) & (np.abs(scan.grid.y_mm[:, None]) < WITHIN_MM)
    return ratio(off[use], scan.sigma[use].astype(np.float64))


def measure(rows: int, scene: str, age_h: float, options: Mapping[str, float], seed: int) -> None:
    """Print a line for one camera and scene."""
    size, started = (rows * 4 // 3, rows), f"{NOON - np.timedelta64(int(age_h), 'h')}Z"
    rig = SimulatedRig(camera=size, scene=scene, scene_options=options, drift_mm=0.0, seed=seed, started=started)
    rig.open()
    calibration: Calibration = known_geometry(size)
    points = reconstruct(rig.capture(PATTERNS, NOON), calibration)
    turn, offset = calibration.reference[:, :3], calibration.reference[:, 3]
    site = points.xyz.astype(np.float64) @ turn.T + offset
    seen = points.valid
    measured = site[seen][:, 2].copy()
    site[seen, 2] = SCENES[scene](**options).at(site[seen][:, 0], site[seen][:, 1]).height(age_h)
    of_points = ratio(measured - site[seen][:, 2], points.sigma_z[seen].astype(np.float64))
    exact = replace(points, xyz=((site - offset) @ turn).astype(np.float32))
    pixel_mm = FIELD_MM / rows
    words = [f"points {of_points}"]
    for wide in CELLS:
        grid = footprint_grid(calibration, pixel_mm * wide)
        scan, true = (to_scan(one, calibration, grid, NOON) for one in (points, exact))
        words.append(f"{wide} px {compared(scan, true, scene == 'soil')}")
    print(f"{scene}, projector px of {PROJECTOR_PX_MM / pixel_mm:.2f} camera px: {', '.join(words)}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="*", default=ROWS, help="of the camera")
    print(
        f"robust error over sigma: all (lowest to highest of {BINS} bins of sigma); cells by their width in camera px"
    )
    for rows in parser.parse_args().rows:
        for scene, age_h, options, seed in SUBJECTS:
            measure(rows, scene, age_h, options, seed)


if __name__ == "__main__":
    main()
