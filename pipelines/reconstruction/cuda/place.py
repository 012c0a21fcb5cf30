"""Sub-pixel positions on the card: each pixel looks for the edges of its own cell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import cuda, float32

from ..cells import AxisCells
from ..edge_kernels import REACH, crossings, edges_between, levels_of
from ..frames import Frames
from ..kernels import NO_CELL
from ..light import Light
from ..line_pictures import line_pictures, raster
from ..pixel_maps import Decoded, Shared
from ..scatter_kernels import LINES, TILE, _add_bend, _limit, _root, _second, _sum_of, _unexplained, _usual, lags_across
from ..shared_error import shared_by_lines
from ..threshold import tilt_of
from .card import OnCard, cached, clear, empty, kernel, launch, up
from .gray import Steps

__all__ = ["Placed", "bring", "place"]

Floats = npt.NDArray[np.float32]


class Placed:
    """A decoded capture on the card, as `Decoded`."""

    def __init__(
        self,
        column: OnCard,
        row: OnCard,
        sigma_column: OnCard,
        sigma_row: OnCard,
        level: OnCard,
        shared: tuple[Shared, Shared],
    ) -> None:
        self.column, self.row, self.sigma_column, self.sigma_row = column, row, sigma_column, sigma_row
        self.level, self.shared = level, shared


def bring(decoded: Decoded) -> Placed:
    """Bring to the card what was decoded on the CPU."""
    return Placed(
        up(decoded.column), up(decoded.row), up(decoded.sigma_column), up(decoded.sigma_row), up(decoded.level),
        decoded.shared,
    )  # fmt: skip


def place(frames: Frames, found: Steps, light: Light) -> Placed:
    """Place each decoded pixel within its cell, as `subpixel.refine` does."""
    shape = found.contrast.shape
    size = found.contrast.size
    level = clear(size, np.uint8)
    places, shared = [], [Shared(), Shared()]
    for axis, cells in enumerate(found.axes):
        fine, spread = empty(shape, np.float32), empty(shape, np.float32)
        if cells is None:
            launch(_nowhere, size, fine.reshape(size), spread.reshape(size))
        else:
            tilt = tilt_of(axis, found.levels, light)
            shared[axis] = _between_edges(frames, found, axis, cells, light.noise, tilt, fine, spread)
            launch(_levels, size, found.steps[axis].reshape(size), level)
        places.append((fine, spread))
    (column, sigma_column), (row, sigma_row) = places
    return Placed(column, row, sigma_column, sigma_row, level.reshape(shape), (shared[0], shared[1]))


def _between_edges(
    frames: Frames,
    found: Steps,
    axis: int,
    cells: AxisCells,
    noise: float,
    tilt: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    fine: OnCard,
    spread: OnCard,
) -> Shared:
    steps = found.steps[axis]
    rows, columns = raster(steps.shape)
    coarse = empty((-(-steps.shape[0] // rows), -(-steps.shape[1] // columns)), np.uint16)
    launch(_sample, coarse.size, steps, rows, columns, coarse)
    down, given, reach = line_pictures(frames, frames.stack, axis, cells, coarse.copy_to_host(), noise, tilt)
    of_patterns = given.plus, given.minus, given.edge, given.centre, given.width
    plus, minus, edge, centre, width = cached((frames.patterns, axis), lambda: [up(each) for each in of_patterns])
    launch(
        _place, steps.size, found.stack, given.white, given.black, plus, minus, up(given.tilt), up(given.wave),
        edge, centre, width, up(given.unsure), given.noise, given.scale, steps, found.contrast, down, fine, spread,
    )  # fmt: skip
    return _settled(fine, spread, down, reach)


def _settled(fine: OnCard, spread: OnCard, down: bool, cell: int) -> Shared:
    """Variances to sigmas, in place, as `subpixel` does; medians of a few lines are taken on the CPU.

    Sums are taken as the CPU takes them: a thread per column of a band of tiles, then one per tile.
    """
    H, W = fine.shape
    bands, tiles = -(-H // TILE), -(-W // TILE)
    unseen, shared = _shared_by_lines(fine, spread, down, cell)
    lags = (cell, 0) if down else (0, cell)
    across = lags_across(*lags)
    limit, scatter = empty((bands, W), np.float32), empty((bands, W), np.float32)
    columns, sums = empty((bands, 3, W), np.float32), empty((bands, 3, tiles + 2), np.float32)
    launch(_no_limit, limit.size, limit)
    for out in (limit, scatter):  # what is far beyond the mean of the first time is an edge of the surface
        launch(_differ, limit.size, fine, spread, across, limit, columns)
        launch(_sum_tiles, bands * (tiles + 2), columns, sums)
        launch(_judge, bands * tiles, sums, out is limit, out)
    launch(_settle, fine.size, fine, spread, lags, scatter, np.float32(unseen))
    return shared


def _shared_by_lines(fine: OnCard, variance: OnCard, down: bool, cell: int) -> tuple[float, Shared]:
    """As `subpixel._shared_by_lines`, of lines that are picked on the card."""
    lines, length = fine.shape[::-1] if down else fine.shape

    def pick(at: npt.NDArray[np.int64], distance: int) -> tuple[Floats, Floats, Floats, Floats]:
        some = empty((4, len(at), length), np.float32)
        launch(_pick, len(at) * length, fine, variance, up(at), down, distance, some)
        before, here, after, own = some.copy_to_host()
        return before, here, after, own

    return shared_by_lines(pick, (lines, length), cell)


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
    stack,
    white,
    black,
    plus,
    minus,
    tilt,
    wave,
    edge,
    middle,
    wide,
    unsure,
    noise,
    scale,
    steps,
    contrast,
    down,
    fine,
    spread,
):
    """As `edge_kernels.along_rows` (or `along_columns`)."""
    H, W = steps.shape
    one, zero = np.float32(1), np.float32(0)
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
            _, first = edges_between(steps[i0 + (start - 1) * di, j0 + (start - 1) * dj], here)
            last, _ = edges_between(here, steps[i0 + stop * di, j0 + stop * dj])
            if first >= 0 and last >= 0:
                position, error = crossings(
                    stack, white, black, plus, minus, tilt, wave, contrast, scale, noise,
                    first, i0 + start * di, j0 + start * dj, di, dj,
                )  # fmt: skip
                known = position == position
                behind, value = np.float32(start) + position, edge[first]
                position, own = crossings(
                    stack, white, black, plus, minus, tilt, wave, contrast, scale, noise,
                    last, i0 + stop * di, j0 + stop * dj, di, dj,
                )  # fmt: skip
                length, rise = np.float32(stop) + position - behind, edge[last] - value
                if known and length > 0 and rise != 0:
                    filled = True
                    per = one / length
                    whole = rise * per * rise * per
                    e0, e1 = error * whole, own * whole
                    share = min(max((np.float32(m) - behind) * per, zero), one)
                    fine[i, j] = value + share * rise
                    spread[i, j] = (one - share) * (one - share) * e0 + share * share * e1
        if not filled:
            fine[i, j] = middle[here]
            spread[i, j] = -(wide[here] * wide[here]) * unsure[contrast[i, j]]


@kernel
def _pick(fine, variance, at, down, cell, some):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Positions of lines before, at and after `at`, and their variances there."""
    length = some.shape[2]
    for n in range(cuda.grid(1), at.size * length, cuda.gridsize(1)):
        line, k = n // length, n % length
        for part in range(4):
            other = at[line] + (part - 1) * cell if part < 3 else at[line]
            i, j = (k, other) if down else (other, k)
            some[part, line, k] = fine[i, j] if part < 3 else variance[i, j]


@kernel
def _no_limit(limit):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = limit.shape[1]
    for n in range(cuda.grid(1), limit.size, cuda.gridsize(1)):
        limit[n // W, n % W] = np.float32(1)  # beyond a cell it is an edge of the surface for sure


@kernel
def _differ(fine, spread, across, limit, columns):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Second differences of a column of a band of tiles: their sum, the noise in them, and how many they are."""
    H, W = fine.shape
    down, along = across
    for n in range(cuda.grid(1), limit.size, cuda.gridsize(1)):
        band, a = n // W, n % W
        b, c = a + along, a + 2 * along
        for part in range(3):
            columns[band, part, a] = np.float32(0)
        if c >= W:
            continue
        for i in range(band * TILE + down, min((band + 1) * TILE, H) - down, LINES):
            _second(
                fine[i - down, a : a + 1], fine[i, b : b + 1], fine[i + down, c : c + 1],
                spread[i - down, a : a + 1], spread[i, b : b + 1], spread[i + down, c : c + 1],
                limit[band, a : a + 1],
                columns[band, 0, a : a + 1], columns[band, 1, a : a + 1], columns[band, 2, a : a + 1],
            )  # fmt: skip


@kernel
def _sum_tiles(columns, sums):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Sums of each tile, and none of the tiles that are not there, at either end of a band."""
    tiles, W = sums.shape[2], columns.shape[2]
    for n in range(cuda.grid(1), sums.shape[0] * tiles, cuda.gridsize(1)):
        band, t = n // tiles, n % tiles
        first, last = max(t - 1, 0) * TILE, min(t * TILE, W)
        there = 0 < t < tiles - 1
        for part in range(3):
            sums[band, part, t] = _sum_of(columns[band, part, first:last]) if there else np.float32(0)


@kernel
def _judge(sums, first_time, out):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill the limits, or the scatter, of each tile's columns."""
    tiles, W = sums.shape[2] - 2, out.shape[1]
    for n in range(cuda.grid(1), sums.shape[0] * tiles, cuda.gridsize(1)):
        band, t = n // tiles, n % tiles
        # single is named where it is: in the simulator what a function gives is a number of Python's, hence double
        total, noise, count = _sum_of(sums[band, 0]), _sum_of(sums[band, 1]), _sum_of(sums[band, 2])
        mean, own = _usual(sums[band], t, (np.float32(total), np.float32(noise), np.float32(count)))
        told = _limit(np.float32(mean)) if first_time else _unexplained(np.float32(mean), np.float32(own))
        for a in range(t * TILE, min((t + 1) * TILE, W)):
            out[band, a] = told


@kernel
def _settle(fine, spread, lags, scatter, shared):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """As `edge_kernels.settle`, of what the tiles told."""
    H, W = fine.shape
    di, dj = lags
    for n in range(cuda.grid(1), fine.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        more = cuda.local.array(1, float32)
        own = spread[i, j : j + 1]
        more[0] = scatter[i // TILE, j] + shared
        if di <= i < H - di and dj <= j < W - dj:
            before, after = fine[i - di, j - dj : j - dj + 1], fine[i + di, j + dj : j + dj + 1]
            _add_bend(before, fine[i, j : j + 1], after, more, own)
        else:
            _root(more, own)
