"""Decode the three kinds of pattern sets beside reading the same bytes: CPU seconds, least of several runs."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pipelines import Frames, PatternSet
from pipelines.reconstruction import locate

from .bench_decode import cpu_seconds, read_floor

CAMERAS = ((640, 480), (2560, 1440))
KINDS = {
    "Gray code": PatternSet("gray", (608, 684)),
    "stripes of Table 1": PatternSet("stripes", (608, 684)),
    "phase, 3 steps": PatternSet.from_mapping({"kind": "phase", "size": (608, 684), "steps": 3}),
    "phase, 8 steps": PatternSet.from_mapping({"kind": "phase", "size": (608, 684), "steps": 8}),
}


def capture(patterns: PatternSet, camera: tuple[int, int]) -> Frames:
    """Give a smooth surface's capture, blurred by 0.6 projector px, with 2 counts of noise."""
    columns, rows = camera
    column = np.broadcast_to(np.linspace(5, patterns.size[0] - 6, columns), (rows, columns))
    row = np.broadcast_to(np.linspace(5, patterns.size[1] - 6, rows)[:, np.newaxis], (rows, columns))
    rng = np.random.default_rng(1)
    stack = np.empty((len(patterns.roles), rows, columns), np.uint8)
    for frame, image, role in zip(stack, patterns.images(), patterns.roles, strict=True):
        line = (image[:, 0] if role.axis == "rows" else image[0]) / 255.0
        fine = gaussian_filter1d(np.repeat(line, 8), 0.6 * 8, mode="nearest")
        place = row if role.axis == "rows" else column
        seen = np.interp((place + 0.5) * 8 - 0.5, np.arange(fine.size), fine)
        frame[:] = np.rint(20 + 150 * seen + 2 * rng.standard_normal((rows, columns), np.float32)).clip(0, 255)
    return Frames(stack, np.datetime64("2026-01-01T00:00:00", "ns"), patterns)


def main() -> None:
    """Print the table."""
    print(
        "decode and place both axes to sub-pixel (decode + refine), CPU time of all threads; the first makes the tables"
    )
    for camera in CAMERAS:
        for name, patterns in KINDS.items():
            frames = capture(patterns, camera)
            words = frames.stack.reshape(-1).view(np.uint64)
            start = time.process_time()
            locate(frames)
            first = time.process_time() - start
            seconds = cpu_seconds(partial(locate, frames), runs=3)
            floor = cpu_seconds(partial(read_floor, words))
            print(
                f"  {camera[0]}x{camera[1]} {name:<20} {len(frames.stack):3d} frames {1e3 * seconds:8.1f} ms "
                f"{seconds / floor:7.1f} x read; the first {first:5.2f} s"
            )


if __name__ == "__main__":
    main()
