"""How small raw frames become, and at what cost, beside other codecs: simulated, and real captures if there.

``python -m tests.benchmarks.bench_raw_frames`` prints the table.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numcodecs import Blosc

from configs import load_campaign
from monitor.recipe import read_pattern_set
from monitor.rigs import make_rig
from storage import read_capture

ROOT = Path(__file__).resolve().parents[2]
Stack = npt.NDArray[np.uint8]


def left(stack: Stack) -> Stack:
    """Subtract each pixel's left neighbour, modulo 256."""
    found: Stack = np.diff(stack, axis=-1, prepend=np.uint8(0))
    return found


def before(stack: Stack) -> Stack:
    """Subtract the frame before, modulo 256."""
    found: Stack = np.diff(stack, axis=0, prepend=stack[:1] * 0)
    return found


WAYS: tuple[tuple[str, Callable[[Stack], Stack], int], ...] = (
    ("bit planes (bitshuffle)", lambda stack: stack, Blosc.BITSHUFFLE),
    ("as they are", lambda stack: stack, Blosc.NOSHUFFLE),
    ("less the frame before", before, Blosc.NOSHUFFLE),
    ("less the left neighbour (ours)", left, Blosc.NOSHUFFLE),
)


def main() -> None:
    """Print the table."""
    campaign = load_campaign(ROOT / "configs" / "demo.yaml")
    rig = make_rig(campaign.rig.name, dict(campaign.rig.options))
    rig.open()
    start = np.datetime64("2026-01-01T00:00:00", "ns")
    stacks: dict[str, Any] = {"simulated rig": rig.capture(read_pattern_set(campaign), start).stack}
    rig.close()
    shared = ROOT.parent / "shared" / "data"
    for name, folder in (("path-traced", "rendered/t0"), ("real", "kamino410/capture_0")):
        if (shared / folder).is_dir():
            try:
                stacks[name] = read_capture(shared / folder).stack
            except ValueError:
                from storage import read_patterns

                stacks[name] = read_capture(shared / folder, read_patterns(shared / "kamino410/patterns.yaml")).stack
    print("raw frames: share of their bytes that is left, by zstd level 1; CPU time a byte to pack and to unpack")
    for name, stack in stacks.items():
        for way, change, shuffle in WAYS:
            codec = Blosc("zstd", 1, shuffle)
            began = time.process_time()
            packed = [codec.encode(np.ascontiguousarray(frame)) for frame in change(stack)]
            pack = time.process_time() - began
            began = time.process_time()
            for each in packed:
                codec.decode(each)
            unpack = time.process_time() - began
            share = sum(map(len, packed)) / stack.nbytes
            print(
                f"  {name:<14} {way:<31} {100 * share:5.1f} %  {1e9 * pack / stack.nbytes:5.1f} ns "
                f"{1e9 * unpack / stack.nbytes:5.1f} ns"
            )


if __name__ == "__main__":
    main()
