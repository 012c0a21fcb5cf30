"""Small ticks with known values, for the tests of stores."""

from __future__ import annotations

import numpy as np

from pipelines import AlarmState, Calibration, Change, Event, Grid, Instant, Lens, Measurement, Motion, Scan, Tick

GRID = Grid(rows=20, columns=30, pitch_mm=0.05, x0_mm=-0.7, y0_mm=-0.4)
METRICS = {"net_volume": "mm3", "edge_lift": "mm"}
START = np.datetime64("2026-11-22T21:00:00", "ns")


def at(number: int) -> Instant:
    """The slot of scan `number`: one each six hours."""
    return START + np.timedelta64(6 * number, "h")


def surface(number: int, grid: Grid = GRID, calibration_id: str = "first") -> Scan:
    """A tilted surface that sinks by 10 um a scan (and is back after 1,000), with a hole in one corner."""
    rng = np.random.default_rng(number)
    y, x = np.meshgrid(grid.y_mm, grid.x_mm, indexing="ij")
    height = (0.3 * x - 0.1 * y - 0.01 * (number % 1000) + rng.normal(0, 0.003, grid.shape)).astype(np.float32)
    height[:3, :4] = np.nan
    sigma = np.where(np.isnan(height), np.nan, rng.uniform(0.002, 0.006, grid.shape)).astype(np.float32)
    level = np.where(np.isnan(height), 255, 1).astype(np.uint8)
    texture = rng.integers(0, 256, grid.shape).astype(np.uint8)
    late = np.timedelta64(1_500_000_007, "ns")
    return Scan(grid, at(number) + late, height, sigma, texture, level, calibration_id)


def change_of(scan: Scan, baseline: Scan) -> Change:
    """Their difference, with a motion whose every number differs."""
    matrix = np.eye(4)
    matrix[:3, 3] = 0.011, -0.022, 0.033
    motion = Motion(matrix, 0.0021, 0.93, 0.4, 0.0007, np.nan, "doubtful", "few stable cells")
    dz = scan.height - baseline.height
    return Change(
        scan.grid, baseline.time, dz, (1.96 * np.hypot(scan.sigma, baseline.sigma)).astype(np.float32), motion
    )


def tick(number: int, baseline: int | None = 0, calibration: str = "first", alarm: AlarmState = "ok") -> Tick:
    """What visit `number` yields; without a baseline, or as one, it has no change."""
    scan = surface(number, calibration_id=calibration)
    if baseline is None or baseline == number:
        return Tick(at(number), scan)
    metrics = {"net_volume": Measurement(-1.5 * number, 0.25), "edge_lift": Measurement(0.01 * number, np.nan)}
    change = change_of(scan, surface(baseline, calibration_id=calibration))
    return Tick(at(number), scan, change, metrics, {"edge_lift": alarm})


def failure(number: int) -> Tick:
    """A visit that yielded nothing."""
    return Tick(at(number), events=(Event(at(number), "failed", "the camera did not answer"),))


def calibration(scale: float = 1.0) -> Calibration:
    """A calibration whose id depends on `scale`."""
    lens = Lens((64, 48), np.diag([800.0 * scale, 800.0, 1.0]), np.zeros(5))
    rms = {"camera": 0.1, "projector": 0.2, "stereo": 0.15}
    return Calibration(lens, lens, np.eye(3), np.array([10.0, 0, 0]), np.eye(4)[:3], rms)
