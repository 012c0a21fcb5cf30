"""Change and metrics, everything and the video recipe, at two sizes, beside the floor of one difference."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from pipelines import LEVEL_NONE, Grid, Scan, parse_instant
from pipelines.change import METRICS, Substrate, bare_substrate, compare, find_objects, measure
from pipelines.scenes import Soil

SIZES = ((1000, 1000, 1.0), (1440, 2560, 4.0))
"""Rows, columns, and what change and every metric may take on two cores, s."""
VIDEO = "net_volume", "gained_volume", "lost_volume", "covered"
VIDEO_S = 0.3
SIDE_MM = 9.0
RUNS = 3


def scan_at(rows: int, columns: int, hours: float) -> Scan:
    """A cracked soil of 9 mm height with 3 um of noise."""
    pitch = SIDE_MM / rows
    grid = Grid(rows, columns, pitch, -columns * pitch / 2, -SIDE_MM / 2)
    height = Soil(side_mm=columns * pitch + 1).at(grid.x_mm[None, :], grid.y_mm[:, None]).height(hours)
    height += np.random.default_rng(int(hours)).normal(0, 0.003, grid.shape)
    texture = np.clip(128 + 400 * height, 0, 255).astype(np.uint8)
    level = np.full(grid.shape, 0, np.uint8)
    level[~np.isfinite(height)] = LEVEL_NONE
    at = parse_instant("2026-01-01T00:00:00Z") + np.timedelta64(int(hours), "h")
    return Scan(grid, at, height.astype(np.float32), np.full(grid.shape, 0.003, np.float32), texture, level)


def cpu_seconds(job: Callable[[], object]) -> tuple[float, float]:
    """Least CPU and least wall seconds of some runs, after one that compiles and fills caches."""
    job()
    taken = []
    for _ in range(RUNS):
        cpu, wall = time.process_time(), time.perf_counter()
        job()
        taken.append((time.process_time() - cpu, time.perf_counter() - wall))
    return min(cpu for cpu, _ in taken), min(wall for _, wall in taken)


def _measured(after: Scan, before: Scan, names: tuple[str, ...]) -> object:
    return measure(compare(after, before), names)


def _video(after: Scan, before: Scan, bare: Substrate) -> object:
    return _measured(after, before, VIDEO), find_objects(after, bare)


def main() -> None:
    """Print the figures; a machine that does other things too shows in wall, not in CPU seconds."""
    print("change and metrics (CPU s; what it may take is wall on 2 idle cores)")
    for rows, columns, may in SIZES:
        before, after = scan_at(rows, columns, 24.0), scan_at(rows, columns, 72.0)
        floor, _ = cpu_seconds(partial(np.subtract, after.height, before.height))
        alone, _ = cpu_seconds(partial(compare, after, before))
        everything, wall = cpu_seconds(partial(_measured, after, before, tuple(METRICS)))
        bare = bare_substrate([before])
        assert bare is not None
        recipe, recipe_wall = cpu_seconds(partial(_video, after, before, bare))
        limit = f" (may take {VIDEO_S} s)" if rows > 1000 else ""
        print(
            f"  {rows} x {columns}: everything {everything:.2f} CPU s, {wall:.2f} s wall (may take {may:.1f} s), "
            f"of which registration and difference {alone:.2f}; video recipe {recipe:.2f} CPU s, "
            f"{recipe_wall:.2f} s wall{limit}; one difference {1000 * floor:.1f} ms"
        )


if __name__ == "__main__":
    main()
