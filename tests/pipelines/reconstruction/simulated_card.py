"""Prints what differs between the CPU and numba's simulator of a GPU: run with ``NUMBA_ENABLE_CUDASIM=1``.

The simulator runs kernels in Python. What they call of the CPU's compiled functions is given plain arrays, as a GPU's
compiler would give it its own: so the formulas run compiled, with numba's types.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numba.cuda.simulator import kernel

from pipelines.reconstruction import device
from pipelines.reconstruction.scatter_kernels import settle
from pipelines.reconstruction.subpixel import _shared_by_lines
from tests.pipelines.reconstruction.both_devices import Difference, _difference, both, scenes

SIZE = 40, 30
CELL = 3  # camera px, of `settled`
LEFT_OUT = "one axis, 16 bits"  # its types alone take five seconds to compile


def main() -> None:
    """One line per array: scene, way, array, share of equal values, values."""
    kernel.FakeWithinKernelCUDAArray = lambda fake: fake._ary
    kernel.BlockManager.run = _run
    for scene in scenes(*SIZE):
        if scene.name != LEFT_OUT:
            for way, found in both(scene, device("cpu"), device("cuda")):
                for each in found:
                    _tell(scene.name, way, each)
    for way, each in settled():
        _tell("lines that share an error", way, each)


def _tell(scene: str, way: str, found: Difference) -> None:
    print(scene, way, found.what, found.same, found.measured, sep="; ")


def settled() -> Iterator[tuple[str, Difference]]:
    """Sigmas of positions that are off in all lines alike, along rows and down columns: the captures show none."""
    from pipelines.reconstruction.cuda import card, place

    random = np.random.default_rng(3)
    rows, columns = 53, 90  # tiles are cut off at both ends
    off = random.normal(0, 0.1, columns) + random.normal(0, 0.05, (rows, columns))
    along = (np.arange(columns) / CELL + off).astype(np.float32)
    variance = np.where(random.random((rows, columns)) < 0.95, 1e-3, -1e-3).astype(np.float32)
    along[:, columns // 2 :] += np.float32(4)
    along[20:24], variance[20:24] = np.nan, np.nan
    for down in (False, True):
        fine, spread = (np.ascontiguousarray(each.T if down else each) for each in (along, variance))
        on_card = card.up(fine), card.up(spread)
        unseen, shared = _shared_by_lines(fine, spread, down, CELL)
        assert 0 < unseen <= shared.within
        settle(fine, spread, *((CELL, 0) if down else (0, CELL)), np.float32(unseen), 0, len(fine))
        assert place._settled(*on_card, down, CELL) == shared
        yield "down" if down else "along", _difference("sigma", spread, on_card[1].copy_to_host())


def _run(block: kernel.BlockManager, grid_point: tuple[int, ...], *args: Any) -> None:
    """Run a block of one thread and wait for its end; the simulator's own way asks all the time whether it has come."""
    assert block._block_dim == (1, 1, 1)
    thread = kernel.BlockThread(lambda: block._f(*args), block, grid_point, (0, 0, 0), block._debug)
    thread.start()
    thread.join()
    if thread.exception:
        raise thread.exception[0].with_traceback(thread.exception[1])


if __name__ == "__main__":
    main()
