"""One visit of the simulated rig, 42 frames: CPU seconds of one thread, beside copying as many bytes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import count

import numpy as np
import numpy.typing as npt

from monitor.rigs import SimulatedRig
from pipelines import PatternSet, parse_instant
from tests.benchmarks.bench_decode import cpu_seconds

START = parse_instant("2026-01-01T00:00:00Z")
PATTERNS = PatternSet("gray", (608, 684))
SIZES = ((480, 360), (640, 480), (960, 720))


def main() -> None:
    """Print the table."""
    print("simulated rig, 42 frames, CPU s            visit   memcpy")
    for size in SIZES:
        rig = SimulatedRig(camera=size, started="2026-01-01T00:00:00Z")
        rig.open()
        visit = partial(_visit, rig, count())
        copy = visit().copy
        print(f"  {size[0]}x{size[1]:<30} {cpu_seconds(visit, 4):8.3f} {cpu_seconds(copy, 4):8.4f}")


def _visit(rig: SimulatedRig, hours: Iterator[int]) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    return rig.capture(PATTERNS, START + np.timedelta64(next(hours), "h")).stack


if __name__ == "__main__":
    main()
