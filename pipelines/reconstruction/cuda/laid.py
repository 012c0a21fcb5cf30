"""Where each pixel lies on the grid, on the card: lone points left out, the site frame, cells, slopes, footprints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import cuda, float32

from ...grid import Grid
from ..clean import background_border
from ..clean_kernels import NEIGHBOURS, _near
from ..grid_kernels import drop_beyond
from ..gridding import field_mm
from ..height_doubt import doubt_mm
from ..lay_kernels import _differ, _note, to_site
from ..rig_model import Calibration
from ..surface import RASTER, USELESS, _usual
from .card import OnCard, empty, kernel, launch, pixelwise, up
from .points import add_doubt

__all__ = ["LaidOnCard", "lay"]

WIDE = 5  # a block of one pixel, and two to either side
SLOTS = 17 * WIDE
_differ_pixel = pixelwise(_differ, BLOCK=1, WIDE=WIDE)
_note_pixel = pixelwise(_note, BLOCK=1, WIDE=WIDE)


@dataclass(frozen=True, slots=True, eq=False)
class LaidOnCard:
    """As `surface.Laid`."""

    cell: OnCard
    above: OnCard
    sigma: OnCard
    local: OnCard
    slope: OnCard


def lay(planes: OnCard, calibration: Calibration, grid: Grid, *, background: bool) -> LaidOnCard:
    """Clean the points (4, row, column) and lay them on the grid; the planes are worked on in place.

    A background is looked for on the CPU, in a raster of the points.
    """
    shape = planes.shape[1:]
    size = shape[0] * shape[1]
    keep = empty(shape, np.bool_)
    launch(_keep, size, planes, np.float32(USELESS * field_mm(calibration)), keep)
    farthest = np.inf
    if not background:
        step = max(1, min(shape) // RASTER)
        some = empty((3, -(-shape[0] // step), -(-shape[1] // step)), np.float32)
        launch(_some, some.size // 3, planes, keep, step, some)
        farthest = background_border(some.copy_to_host())
    add_doubt(planes[3], doubt_mm(calibration), -1.0)  # what is left are errors that means make less
    reference = up(calibration.reference)
    launch(_to_site, size, planes, keep, reference)
    laid = LaidOnCard(
        empty(shape, np.int32), empty(shape, np.float32), empty(shape, np.float32),
        empty((*shape, 4), np.int8), empty((*shape, 2), np.int16),
    )  # fmt: skip
    place = (grid.x0_mm, grid.y0_mm, grid.pitch_mm)
    launch(
        _lay, size, planes, place, grid.shape, _usual(calibration, grid),
        laid.cell, laid.above, laid.sigma, laid.local, laid.slope,
    )  # fmt: skip
    if np.isfinite(farthest):
        launch(_drop, size, farthest, reference, place, grid.columns, laid.cell, laid.above, laid.local)
    return laid


@kernel
def _keep(planes, limit, keep):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """As `clean_kernels.keep_dense`."""
    x, y, z, s = planes[0], planes[1], planes[2], planes[3]
    W = z.shape[1]
    for n in range(cuda.grid(1), z.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        keep[i, j] = s[i, j] <= limit and _near(x, y, z, s, i, j) > NEIGHBOURS  # false for NaN


@kernel
def _some(planes, keep, step, some):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = some.shape[2]
    for n in range(cuda.grid(1), some.shape[1] * W, cuda.gridsize(1)):
        i, j = n // W, n % W
        for axis in range(3):
            some[axis, i, j] = planes[axis, i * step, j * step]
        if not keep[i * step, j * step]:
            some[2, i, j] = np.float32(np.nan)


@kernel
def _to_site(planes, keep, reference):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = keep.shape[1]
    for n in range(cuda.grid(1), keep.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        to_site(planes[:, i : i + 1, j : j + 1], keep[i : i + 1, j : j + 1], reference, 0, 1)


@kernel
def _lay(planes, place, shape, usual, cell, above, sigma, local, slope):  # type: ignore[no-untyped-def]  # a kernel
    """As `lay_kernels.lay`; where there is no point, only the cell is noted: none."""
    H, W = cell.shape
    for n in range(cuda.grid(1), cell.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        cell[i, j] = -1
        if planes[2, i, j] != planes[2, i, j]:  # NaN is not itself
            continue
        block = cuda.local.array(SLOTS, float32)
        for a in range(3):
            for b in range(3):
                k, m = i - 1 + a, j - 1 + b
                inside = 0 <= k < H and 0 <= m < W
                for axis in range(3):
                    block[(3 * a + axis) * WIDE + 1 + b] = planes[axis, k, m] if inside else np.float32(np.nan)
        _differ_pixel(block, 1, place, usual)
        _note_pixel(
            block, planes[3, i, j : j + 1], shape, cell[i, j : j + 1], above[i, j : j + 1],
            sigma[i, j : j + 1], local[i, j : j + 1], slope[i, j : j + 1],
        )  # fmt: skip


@kernel
def _drop(farthest, reference, place, columns, cell, above, local):  # type: ignore[no-untyped-def]  # a kernel
    W = cell.shape[1]
    for n in range(cuda.grid(1), cell.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        drop_beyond(
            farthest, reference, place, columns, cell[i : i + 1, j : j + 1], above[i : i + 1, j : j + 1],
            local[i : i + 1, j : j + 1],
        )  # fmt: skip
