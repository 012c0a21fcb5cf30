"""Change and metrics, everything by part, and the video recipe, at two sizes, beside the floor of reading the maps."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial

import numpy as np

from monitor.steady_process import SteadyProcess
from pipelines import LEVEL_NONE, Grid, Motion, Scan, parse_instant
from pipelines.change import METRICS, Substrate, bare_substrate, compare, find_objects, measure, register
from pipelines.scenes import Soil

SIZES = ((1000, 1000, 1.0), (1440, 2560, 4.0))
"""Rows, columns, and what change and every metric may take on two cores, s."""
VIDEO = "net_volume", "gained_volume", "lost_volume", "covered"
VIDEO_S = 0.3
VIDEO_SIZE = SIZES[1][:2]
PARTS = {
    "volumes": ("net_volume", "gained_volume", "lost_volume"),
    "crack mask, lines, openings": ("crack_area", "crack_length", "crack_opening"),
    "the same and depths": ("crack_depth", "crack_volume", "crack_seen"),
    "crack mask and edge lift": ("edge_lift",),
    "crack mask and plates": tuple(name for name in METRICS if name.startswith(("plate_", "curl_"))),
}
"""What is asked for alone; each part computes what it shares with others again."""
SIDE_MM = 9.0
RUNS = 2


def scan_at(rows: int, columns: int, hours: float) -> Scan:
    """A cracked soil of 9 mm height with 3 um of noise; more columns than rows are the first ones mirrored."""
    pitch = SIDE_MM / rows
    grid = Grid(rows, columns, pitch, -columns * pitch / 2, -SIDE_MM / 2)
    soil = Soil(side_mm=SIDE_MM + 1).at(grid.y_mm[None, :], grid.y_mm[:, None]).height(hours)
    height = np.pad(soil, ((0, 0), (0, columns - rows)), mode="symmetric")
    height += np.random.default_rng(round(3600 * hours)).normal(0, 0.003, grid.shape)
    texture = np.clip(128 + 400 * np.nan_to_num(height), 0, 255).astype(np.uint8)
    level = np.full(grid.shape, 0, np.uint8)
    level[~np.isfinite(height)] = LEVEL_NONE
    at = parse_instant("2026-01-01T00:00:00Z") + np.timedelta64(round(3600 * hours), "s")
    return Scan(grid, at, height.astype(np.float32), np.full(grid.shape, 0.003, np.float32), texture, level)


def timed(job: Callable[[], object]) -> tuple[float, float]:
    """Least CPU and least wall seconds of some runs, after one that compiles and fills caches."""
    job()
    taken = []
    for _ in range(RUNS):
        cpu, wall = time.process_time(), time.perf_counter()
        job()
        taken.append((time.process_time() - cpu, time.perf_counter() - wall))
    return min(cpu for cpu, _ in taken), min(wall for _, wall in taken)


def show(what: str, job: Callable[[], object], bar: float | None = None) -> None:
    """Print one line."""
    cpu, wall = timed(job)
    print(f"  {what:<30} {cpu:7.3f} {wall:7.3f}" + ("" if bar is None else f"   may take {bar:.1f}"), flush=True)


def _read(*scans: Scan) -> object:
    return [np.nanmax(array) for scan in scans for array in (scan.height, scan.sigma, scan.texture, scan.level)]


def _everything(after: Scan, before: Scan, names: tuple[str, ...]) -> object:
    return measure(compare(after, before), names)


def _video(after: Scan, before: Scan, bare: Substrate, near: Motion | None) -> object:
    """Difference, volumes and objects of a scan whose neighbour's motion is known, or none's."""
    return measure(compare(after, before, near=near), VIDEO), find_objects(after, bare)


def main() -> None:
    """Print the figures; what else the machine does shows in wall, not in CPU seconds.

    `--parts` adds the parts; a number of rows leaves the other size out.
    """
    asked = [size for size in SIZES if str(size[0]) in sys.argv] or SIZES
    for rows, columns, bar in asked:
        print(f"{rows} x {columns}                      CPU s  wall s")
        before, after = scan_at(rows, columns, 24.0), scan_at(rows, columns, 72.0)
        show("floor: read both scans", partial(_read, after, before))
        show("change and every metric", partial(_everything, after, before, tuple(METRICS)), bar)
        if (rows, columns) == VIDEO_SIZE:
            bare = bare_substrate([before])
            assert bare is not None
            second, third = (scan_at(rows, columns, 24.0 + seconds / 3600) for seconds in (1, 2))
            near = register(second, before)
            assert near.verdict == "good", near.reason
            with closing(SteadyProcess()):  # as `microrelief video` runs
                show("video recipe", partial(_video, third, before, bare, near), VIDEO_S)
                show("the same, searched in full", partial(_video, third, before, bare, None))
        if "--parts" in sys.argv:
            show("compare", partial(compare, after, before))
            comparison = compare(after, before)
            for part, names in PARTS.items():
                show(part, partial(measure, comparison, names))


if __name__ == "__main__":
    main()
