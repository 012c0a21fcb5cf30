"""Decode 42 frames of 2560x1440 beside reading the same bytes: CPU seconds of one thread, least of several runs."""

from __future__ import annotations

import os
import subprocess
import tempfile
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
    told = opencv_decode(frames)
    if told is None:
        print(f"  OpenCV GrayCodePattern.decode: name a Python with opencv-contrib-python in {PEER} to see it")
        return
    seconds, column, row = told
    ours = figures["decode, into arrays of the last capture (video)"]
    print(
        f"  {'OpenCV GrayCodePattern.decode (all threads)':<50} {1e3 * seconds:8.1f} ms {seconds / floor:7.2f} x read"
    )
    both = np.isfinite(room.column) & np.isfinite(room.row) & (column > 0) & (row > 0)
    same = (room.column == column) & (room.row == row)
    print(
        f"  OpenCV takes {seconds / ours:.0f} times as long; codes are equal in {100 * same[both].mean():.4f} % of the "
        f"{100 * both.mean():.1f} % of pixels where both are valid"
    )


PEER = "MICRORELIEF_OPENCV_CONTRIB_PYTHON"
"""Names an interpreter that has opencv-contrib-python: it cannot be installed beside our own opencv-python."""

PEER_PROGRAM = """
import sys, time
import cv2, numpy as np
folder, columns, rows = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
stack = np.load(folder + "/frames.npy")
peer = cv2.structured_light.GrayCodePattern.create(columns, rows)
peer.setWhiteThreshold(5)
patterns, white, black = list(stack[2:]), stack[0], stack[1]
best = float("inf")
for turn in range(3):
    start = time.process_time()
    # its decoder takes the rays of two cameras; the same camera twice is the same work twice
    done, disparity = peer.decode([patterns, patterns], None, [black, black], [white, white])
    best = min(best, (time.process_time() - start) / 2)
place = np.zeros((2, *white.shape), np.int32)
for i in range(0, white.shape[0], 24):
    for j in range(0, white.shape[1], 24):
        bad, at = peer.getProjPixel(patterns, j, i)
        place[:, i, j] = (0, 0) if bad else at
np.save(folder + "/place.npy", place)
print(best)
"""


def opencv_decode(frames: Frames) -> tuple[float, npt.NDArray[np.int32], npt.NDArray[np.int32]] | None:
    """CPU seconds of OpenCV's decoder for the same frames, and its columns and rows where they were asked for (else 0).

    None where no interpreter is named that has it.
    """
    python = os.environ.get(PEER)
    if not python:
        return None
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/frames.npy", frames.stack)
        size = [str(side) for side in frames.patterns.size]
        done = subprocess.run([python, "-c", PEER_PROGRAM, folder, *size], capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{PEER}={python}: {done.stderr.strip().splitlines()[-1]}")
        column, row = np.load(f"{folder}/place.npy")
    return float(done.stdout), column, row


if __name__ == "__main__":
    main()
