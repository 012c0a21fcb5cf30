"""Frames of 2560x1440 to a height map, step by step: time on two cores, memory over the frames, and a peer."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from pipelines import Frames, Instant, PatternSet
from pipelines.reconstruction import (
    Calibration,
    Decoded,
    decode,
    footprint_grid,
    scan_decoded,
    scan_frames,
    to_scan,
    triangulate,
)
from pipelines.reconstruction.clean import reject_mixed
from pipelines.reconstruction.pinhole import project, undistort
from pipelines.reconstruction.subpixel import refine
from tests.benchmarks.bench_decode import read_floor
from tests.pipelines.reconstruction.exact_rig import Floats, make_rig

COLUMNS, ROWS = 2560, 1440
CORES = 2
RUNS = 7
NOISE = 1.5  # grey values
BLUR_PX = 3  # camera px that the optics smear over, as a box


def relief(x: Floats, y: Floats) -> Floats:
    """Waves of soil size with a crack across them."""
    waves = 0.25 * np.sin(1.1 * x) * np.cos(0.9 * y) + 0.02 * np.sin(9 * x + 5 * y)
    return np.where(np.abs(x - 0.3 * y - 1) < 0.15, waves - 0.6, waves)


def capture(rig: Calibration, seed: int = 1) -> Frames:
    """What the rig's camera sees of the relief, blurred, with noise. Made to be reconstructed, not to judge errors."""
    patterns = PatternSet("gray", rig.projector.size)
    pixels = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).astype(np.float64)
    rays = np.concatenate([undistort(rig.camera, pixels), np.ones((ROWS, COLUMNS, 1))], axis=-1)
    turned = rays @ rig.reference[:, :3].T
    depth = np.full((ROWS, COLUMNS), -rig.reference[2, 3] / rig.reference[2, 2])
    for _ in range(3):  # the camera looks nearly straight down: this converges at once
        site = turned * depth[..., None] + rig.reference[:, 3]
        depth += (site[..., 2] - relief(site[..., 0], site[..., 1])) / -turned[..., 2]
    lit_at = project(rig.projector, rays * depth[..., None] @ rig.R.T + rig.t_mm)
    column, row = np.rint(lit_at[..., 0]).astype(int), np.rint(lit_at[..., 1]).astype(int)
    wide, high = patterns.size
    lit = (column >= 0) & (column < wide) & (row >= 0) & (row < high)
    column, row = np.where(lit, column, 0), np.where(lit, row, 0)
    random = np.random.default_rng(seed)
    noise = random.normal(0, NOISE, (ROWS, COLUMNS)).astype(np.float32)
    stack = np.empty((len(patterns.roles), ROWS, COLUMNS), np.uint8)
    for frame, image in zip(stack, patterns.images(), strict=True):
        light = np.where(lit, image[row, column], 0).astype(np.float32)
        frame[:] = 20 + 0.6 * uniform_filter(light, BLUR_PX) + np.roll(noise, int(random.integers(ROWS)), axis=0)
    return Frames(stack, Instant("2026-01-01T00:00:00", "ns"), patterns)


@dataclass(frozen=True)
class Took:
    """Least time of several runs, seconds."""

    wall: float
    cpu: float


def least(work: Callable[[], object], runs: int = RUNS) -> Took:
    """Least wall and CPU time; the first run, which compiles and fills tables, is not counted."""
    work()
    wall = cpu = float("inf")
    for _ in range(runs):
        start, busy = time.perf_counter(), time.process_time()
        work()
        wall, cpu = min(wall, time.perf_counter() - start), min(cpu, time.process_time() - busy)
    return Took(wall, cpu)


def opencv_triangulate(decoded: Decoded, rig: Calibration) -> npt.NDArray[np.float32]:
    """The same points by OpenCV: undistortPoints for both devices, then triangulatePoints."""
    import cv2

    known = np.isfinite(decoded.column) & np.isfinite(decoded.row)
    rows, columns = np.nonzero(known)
    seen = np.stack([columns, rows], axis=1).astype(np.float32)
    lit = np.stack([decoded.column[known], decoded.row[known]], axis=1)
    eye = cv2.undistortPoints(seen[:, None], rig.camera.K, rig.camera.dist)[:, 0].T
    lamp = cv2.undistortPoints(lit[:, None], rig.projector.K, rig.projector.dist)[:, 0].T
    points = cv2.triangulatePoints(np.eye(3, 4), np.c_[rig.R, rig.t_mm], eye, lamp)
    found: npt.NDArray[np.float32] = (points[:3] / points[3]).T
    return found


def show_memory() -> None:
    """Print how much memory one scan takes over the frames and the tables of the calibration, in a fresh process."""
    rig = make_rig((COLUMNS, ROWS))
    frames, grid = capture(rig), footprint_grid(rig)
    scan_frames(frames, rig, grid)  # compiled code and tables are there now
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far belongs to what made the frames
    before = _status_mib("VmRSS")
    scan_frames(frames, rig, grid)
    print(f"{_status_mib('VmHWM') - before:.0f}")


def _status_mib(name: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))


def main() -> None:
    """Print the table."""
    numba.config.NUMBA_NUM_THREADS = min(CORES, numba.config.NUMBA_NUM_THREADS)
    rig = make_rig((COLUMNS, ROWS))
    frames, grid = capture(rig), footprint_grid(rig)
    decoded = decode(frames)
    fine = refine(frames, decoded)
    raw = triangulate(fine, rig)
    words = frames.stack.reshape(-1).view(np.uint64)
    floor = least(lambda: read_floor(words))
    steps = {
        "decode, both axes": lambda: decode(frames),
        "sub-pixel, both axes": lambda: refine(frames, decoded),
        "triangulate": lambda: triangulate(fine, rig),
        "mixed pixels": lambda: reject_mixed(raw),
        "clean up and grid": lambda: to_scan(raw, rig, grid, frames.time),
        "points to height map in bands": lambda: scan_decoded(fine, rig, grid, frames.time),
        "the whole way, in memory": lambda: scan_frames(frames, rig, grid),
    }
    print(
        f"a scan from 42 frames of {COLUMNS}x{ROWS} ({frames.stack.nbytes / 1e6:.0f} MB), {CORES} cores; "
        f"grid {grid.rows}x{grid.columns}; least of {RUNS} runs"
    )
    print(f"  {'':<34}{'wall':>9}{'CPU':>13}")
    _line("read the bytes (sum, the floor)", floor, floor)
    for name, work in steps.items():
        _line(name, least(work), floor)
    peer = least(lambda: opencv_triangulate(fine, rig), runs=1)
    _line("OpenCV undistort + triangulatePoints", peer, floor)
    told = subprocess.run(
        [sys.executable, "-c", "from tests.benchmarks.bench_reconstruct import show_memory; show_memory()"],
        capture_output=True,
        text=True,
        check=True,
    )
    print(f"  memory over the frames (and the calibration's tables), at its highest: {told.stdout.strip()} MiB")


def _line(name: str, took: Took, floor: Took) -> None:
    print(f"  {name:<34}{1e3 * took.wall:7.1f} ms{1e3 * took.cpu:10.1f} ms{took.wall / floor.wall:8.2f} x read")


if __name__ == "__main__":
    main()
