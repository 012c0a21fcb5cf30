"""Sub-pixel positions on the card: each pixel looks for the edges of its own cell."""

from __future__ import annotations

import numpy as np
from numba import cuda

from ..cells import AxisCells
from ..edge_kernels import REACH, _add_bend, _crossings, _edges_between, _root, _wider, levels_of
from ..frames import Frames
from ..kernels import NO_CELL
from ..light import read_light
from ..patterns import AXES
from ..pixel_maps import Decoded
from ..subpixel import RUNS, line_pictures, raster
from ..threshold import edge_levels
from .card import OnCard, cached, clear, empty, kernel, launch, up
from .gray import Steps

__all__ = ["Placed", "bring", "place"]


class Placed:
    """A decoded capture on the card, as `Decoded`."""

    def __init__(self, column: OnCard, row: OnCard, sigma_column: OnCard, sigma_row: OnCard, level: OnCard) -> None:
        self.column, self.row, self.sigma_column, self.sigma_row = column, row, sigma_column, sigma_row
        self.level = level


def bring(decoded: Decoded) -> Placed:
    """Bring to the card what was decoded on the CPU."""
    return Placed(
        up(decoded.column), up(decoded.row), up(decoded.sigma_column), up(decoded.sigma_row), up(decoded.level)
    )


def place(frames: Frames, found: Steps) -> Placed:
    """Place each decoded pixel within its cell, as `subpixel.refine` does; the light is read on the CPU."""
    light = read_light(frames, RUNS)
    shape = found.contrast.shape
    size = found.contrast.size
    level = clear(size, np.uint8)
    places = []
    for axis, cells in enumerate(found.axes):
        fine, spread = empty(shape, np.float32), empty(shape, np.float32)
        if cells is None:
            launch(_nowhere, size, fine.reshape(size), spread.reshape(size))
        else:
            _between_edges(frames, found, axis, cells, light.noise, light.tilt[axis], fine, spread)
            launch(_levels, size, found.steps[axis].reshape(size), level)
        places.append((fine, spread))
    return Placed(places[0][0], places[1][0], places[0][1], places[1][1], level.reshape(shape))


def _between_edges(
    frames: Frames,
    found: Steps,
    axis: int,
    cells: AxisCells,
    noise: float,
    tilt: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    fine: OnCard,
    spread: OnCard,
) -> None:
    steps = found.steps[axis]
    rows, columns = raster(steps.shape)
    coarse = empty((-(-steps.shape[0] // rows), -(-steps.shape[1] // columns)), np.uint16)
    launch(_sample, coarse.size, steps, rows, columns, coarse)
    if not frames.patterns.complementary:
        tilt = edge_levels(frames, AXES[axis], cells, steps.copy_to_host())
    down, given, reach = line_pictures(frames, frames.stack, axis, cells, coarse.copy_to_host(), noise, tilt)
    of_patterns = given.plus, given.minus, given.edge, given.centre, given.width
    plus, minus, edge, centre, width = cached((frames.patterns, axis), lambda: [up(each) for each in of_patterns])
    launch(
        _place, steps.size, found.stack, given.white, given.black, plus, minus, up(given.tilt),
        edge, centre, width, up(given.unsure), given.noise, given.flat, steps, found.contrast, down, fine, spread,
    )  # fmt: skip
    launch(_bend, steps.size, fine, spread, down, reach)


@kernel
def _nowhere(fine, spread):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(cuda.grid(1), fine.size, cuda.gridsize(1)):
        fine[n] = np.float32(np.nan)
        spread[n] = np.float32(np.nan)


@kernel
def _levels(steps, level):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(cuda.grid(1), level.size, cuda.gridsize(1)):
        levels_of(steps[n : n + 1], level[n : n + 1])


@kernel
def _sample(steps, rows, columns, coarse):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(cuda.grid(1), coarse.size, cuda.gridsize(1)):
        i, j = n // coarse.shape[1], n % coarse.shape[1]
        coarse[i, j] = steps[i * rows, j * columns]


@kernel
def _place(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack, white, black, plus, minus, tilt, edge, middle, wide, unsure, noise, flat, steps, contrast, down, fine, spread
):
    """As `edge_kernels.along_rows` (or `along_columns`), with the variance left in `spread`."""
    H, W = steps.shape
    one = np.float32(1)
    di, dj = (1, 0) if down else (0, 1)
    end = H if down else W
    for n in range(cuda.grid(1), steps.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        m = i if down else j
        i0, j0 = i - m * di, j - m * dj  # where the line begins
        here = steps[i, j]
        start, stop = m, m + 1
        if here != NO_CELL:
            while start > 0 and m - start <= REACH and steps[i0 + (start - 1) * di, j0 + (start - 1) * dj] == here:
                start -= 1
            while stop < end and stop - start <= REACH and steps[i0 + stop * di, j0 + stop * dj] == here:
                stop += 1
        filled = False
        if here != NO_CELL and start > 0 and stop < end and stop - start <= REACH:
            _, first = _edges_between(steps[i0 + (start - 1) * di, j0 + (start - 1) * dj], here)
            last, _ = _edges_between(here, steps[i0 + stop * di, j0 + stop * dj])
            if first >= 0 and last >= 0:
                position, inverse = _crossings(
                    stack, white, black, plus, minus, tilt, contrast, first, i0 + start * di, j0 + start * dj, di, dj
                )
                known = position == position
                behind, value, error = np.float32(start) + position, edge[first], noise * inverse
                position, inverse = _crossings(
                    stack, white, black, plus, minus, tilt, contrast, last, i0 + stop * di, j0 + stop * dj, di, dj
                )
                ahead = np.float32(stop) + position
                length, rise = ahead - behind, edge[last] - value
                if known and length > 0 and rise != 0:
                    filled = True
                    per = one / length
                    e0, e1 = error * rise * per, noise * inverse * rise * per
                    share = min(max((np.float32(m) - behind) * per, np.float32(0)), one)
                    fine[i, j] = value + share * rise
                    spread[i, j] = ((one - share) * e0) ** 2 + (share * e1) ** 2 + flat * _wider(here)
        if not filled:
            fine[i, j] = middle[here]
            spread[i, j] = wide[here] * wide[here] * unsure[contrast[i, j]]


@kernel
def _bend(fine, spread, down, cells):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Variances to sigmas, in place."""
    H, W = fine.shape
    di, dj = (cells, 0) if down else (0, cells)
    for n in range(cuda.grid(1), fine.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        own = spread[i, j : j + 1]
        if di <= i < H - di and dj <= j < W - dj:
            before, after = fine[i - di, j - dj : j - dj + 1], fine[i + di, j + dj : j + dj + 1]
            _add_bend(before, fine[i, j : j + 1], after, own, own)
        else:
            _root(own, own)
