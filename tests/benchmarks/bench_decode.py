"""Decode 42 frames of 2560x1440 beside reading the same bytes: CPU seconds of one thread, least of several runs."""

from __future__ import annotations

import time
from collections.abc import Callable

import numba
import numpy as np
import numpy.typing as npt

from pipelines import Frames, PatternSet
from pipelines.reconstruction import decode

ROWS, COLUMNS = 1440, 2560
RUNS = 9


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def read_floor(words: npt.NDArray[np.uint64]) -> np.uint64:
    """Read every byte once: a sum over 8-byte words, which is what the memory can do."""
    total = np.uint64(0)
    for i in range(words.size):
        total += words[i]
    return total


def capture(seed: int = 1) -> Frames:
    """Give a capture of a smooth surface with noise, as large as the paper's camera."""
    patterns = PatternSet("gray", (608, 684))
    images = patterns.images()
    column = (np.arange(COLUMNS) * 608 // COLUMNS)[np.newaxis, :]
    row = (np.arange(ROWS) * 684 // ROWS)[:, np.newaxis]
    rng = np.random.default_rng(seed)
    noise = rng.integers(-3, 4, (ROWS, COLUMNS))
    stack = np.empty((len(images), ROWS, COLUMNS), np.uint8)
    for frame, image in zip(stack, images, strict=True):
        frame[:] = 20 + 0.6 * image[row, column] + np.roll(noise, int(rng.integers(0, ROWS)), axis=0)
    return Frames(stack, np.datetime64("2026-01-01T00:00:00", "ns"), patterns)


def cpu_seconds(work: Callable[[], object], runs: int = RUNS) -> float:
    """Least CPU time of several runs; the first, which compiles, is not counted."""
    work()
    best = float("inf")
    for _ in range(runs):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return best


def main() -> None:
    """Print the table."""
    frames = capture()
    words = frames.stack.reshape(-1).view(np.uint64)
    room = decode(frames)
    figures = {
        "read the bytes (sum, the floor)": cpu_seconds(lambda: read_floor(words)),
        "numpy max of the bytes": cpu_seconds(lambda: frames.stack.max()),
        "decode, into arrays of the last capture (video)": cpu_seconds(lambda: decode(frames, into=room)),
        "decode, into new arrays": cpu_seconds(lambda: decode(frames)),
    }
    floor = figures["read the bytes (sum, the floor)"]
    print(f"decode 42 frames of {COLUMNS}x{ROWS} ({frames.stack.nbytes / 1e6:.0f} MB), CPU time of one thread")
    for name, seconds in figures.items():
        print(f"  {name:<50} {1e3 * seconds:8.1f} ms {seconds / floor:7.2f} x read")
    peer = opencv_seconds(frames)
    if peer is None:
        print("  OpenCV GrayCodePattern.decode                      not installed (needs opencv-contrib-python)")
    else:
        print(f"  {'OpenCV GrayCodePattern.decode':<50} {1e3 * peer:8.1f} ms {peer / floor:7.2f} x read")


def opencv_seconds(frames: Frames) -> float | None:
    """CPU time of OpenCV's decoder on the same frames; None where OpenCV comes without it."""
    import cv2

    if not hasattr(cv2, "structured_light"):
        return None
    peer = cv2.structured_light.GrayCodePattern.create(*frames.patterns.size)
    lit = [np.asarray(frame) for frame in frames.stack[2:]]
    black, white = [frames.stack[1]], [frames.stack[0]]
    return cpu_seconds(lambda: peer.decode([lit], np.zeros_like(lit[0]), black, white), runs=1)


if __name__ == "__main__":
    main()
