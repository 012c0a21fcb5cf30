"""Sub-pixel positions: pattern minus inverse crosses zero at the edges of a cell; between them it is linear."""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs
from .cells import AxisCells, Cells
from .decode import decode
from .edge_kernels import along_columns, along_rows
from .frames import Frames
from .light import Light, read_light
from .line_pictures import Stack, every, line_pictures
from .local_integration import integrate
from .pixel_maps import Decoded
from .scatter_kernels import TILE, settle
from .threshold import tilt_of

__all__ = ["locate", "refine", "shared_by", "telling_lines"]

SETTLED = 8 * TILE  # image rows whose uncertainties are settled at once: whole tiles, whatever the number of cores
LINES = 6  # of the image, that tell what neighbouring lines share
FEW = 200
RUNS = 24  # of 64 pixels, which the light is read from

HalfSteps = npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float32]


def locate(frames: Frames, *, local_integration: bool = False) -> Decoded:
    """Decode a capture and place each pixel within its cell: `decode`, then `refine`; `integrate` if asked for."""
    light = read_light(frames, RUNS)
    cells = decode(frames, noise=light.noise)
    found = refine(frames, cells, light)
    return integrate(frames, cells, found, light) if local_integration else found


def refine(frames: Frames, decoded: Decoded, light: Light | None = None) -> Decoded:
    """Place each decoded pixel within its cell.

    Along the image direction in which an axis grows faster, the two edges of the pixel's cell are where the bit that
    flips there crosses zero, to a fraction of a camera pixel; between them the position is linear. Pixels without an
    edge on both sides keep the middle of their cell and its sigma. Stripes and phase sets are placed by `decode`
    already and left alone.

    Sigma is what the frames' noise does to the edges, what the profile of an edge leaves open (`edge_kernels`), and
    what the positions themselves show: how they scatter from line to line, and how they bend along a line.

    White stripes look wider than black ones through gamma and blur. Pattern minus inverse does not know it: at the end
    of a stripe both are as bright, whatever the curve. Without inverses `decode` has measured the level of the edges.

    Parameters
    ----------
    frames : Frames
    decoded : Decoded
        Of these frames.
    light : Light, optional
        Of these frames; read from them if absent.

    Returns
    -------
    Decoded
        With arrays of its own: the frames need not be kept.
    """
    if not isinstance(decoded, Cells):
        return decoded
    light = light or read_light(frames, RUNS)
    found: list[tuple[Floats, Floats]] = []
    for number, cells in enumerate(decoded.axes):
        place, sigma = (np.empty(frames.stack.shape[1:], np.float32) for _ in range(2))
        if cells is None:
            place[:] = sigma[:] = np.nan
        else:
            _between_edges(frames, number, cells, decoded, light, place, sigma)
        found.append((place, sigma))
    (column, sigma_column), (row, sigma_row) = found
    return Decoded(
        column, row, sigma_column, sigma_row, decoded.level.copy(), decoded.texture.copy(), decoded.contrast.copy()
    )


def _between_edges(
    frames: Frames,
    axis: int,
    cells: AxisCells,
    decoded: Cells,
    light: Light,
    place: Floats,
    sigma: Floats,
) -> None:
    """Fill the positions and sigmas of one axis."""
    steps = decoded.steps[axis]
    tilt = tilt_of(axis, decoded.levels, light)
    stack = cast(Stack, np.ascontiguousarray(frames.stack))
    down, pictures, reach = line_pictures(frames, stack, axis, cells, every(steps), light.noise, tilt)
    run = along_columns if down else along_rows

    def slab(first: int, last: int) -> None:
        run(pictures, steps, decoded.contrast, first, last, place, sigma)

    in_slabs(steps.shape[1 if down else 0], slab)
    lags = (reach, 0) if down else (0, reach)
    shared = np.float32(_shared_by_lines(place, sigma, down, reach))
    in_slabs(len(steps), lambda first, last: settle(place, sigma, *lags, shared, first, last), step=SETTLED)


def _shared_by_lines(place: Floats, variance: Floats, down: bool, cell: int) -> float:
    """Read `shared_by` off the lines of an image that `telling_lines` names."""
    if down:
        place, variance = place.T, variance.T
    at = telling_lines(place.shape, cell)
    return shared_by(place[at - cell], place[at], place[at + cell], variance[at], cell) if len(at) else 0.0


def telling_lines(shape: tuple[int, ...], cell: int) -> npt.NDArray[np.int64]:
    """Which lines, of so many of such a length, tell what neighbouring ones share; none in a small image."""
    lines, length = shape
    if cell < 1 or lines <= 2 * cell or length <= 2 * cell:
        return np.empty(0, np.int64)
    return np.linspace(cell, lines - cell - 1, min(LINES, lines - 2 * cell)).astype(np.int64)


def shared_by(before: Floats, here: Floats, after: Floats, variance: Floats, cell: int) -> float:
    """Variance of positions that neighbouring lines share, projector px squared: what moves an edge all along.

    Sharper edges than the pixels resolve, and light that flickers, displace an edge in all lines alike where it runs
    across them. Second differences along the lines show it, over a cell, and those across do not; relief is in both.
    Errors of single edges show with six times the variance of positions across the lines, but along them with
    6 - 8 r(d) + 2 r(2 d), as positions d cells apart have edges in common: r is a cubic B-spline, for between edges
    positions are linear. What is missing of noise, as the variances say it or as it is seen across if that is less, is
    added. Medians, of the whole capture: surfaces break off.

    Parameters
    ----------
    before, here, after : ndarray of float32, shape (line, px)
        Positions along some lines, and along those a cell to either side, projector px.
    variance : ndarray of float32, shape (line, px)
        Of `here`, negative where there was no edge on both sides.
    cell : int
        Camera px.
    """
    here = np.where(variance > 0, here, np.float32(np.nan))
    along = np.abs(here[:, : -2 * cell] - 2 * here[:, cell:-cell] + here[:, 2 * cell :])
    across = np.abs(before - 2 * here + after)[:, cell:-cell]
    known = np.isfinite(along) & np.isfinite(across)
    if known.sum() < FEW:
        return 0.0
    a, b = (float(np.median(values[known])) / 0.6745 for values in (along, across))
    noise = min(float(np.median(variance[:, cell:-cell][known])), b * b / 6)
    step = float(np.median(np.abs(here[:, 2 * cell :] - here[:, : -2 * cell])[known])) / 2
    shown = 6 - 8 * _in_common(step) + 2 * _in_common(2 * step)
    return max(a * a - b * b + (6 - shown) * noise, 0.0) / shown


def _in_common(apart: float) -> float:
    """Correlation of positions that lie so many cells apart on a line."""
    return max(0.0, 1 - 1.5 * apart**2 + 0.75 * apart**3) if apart < 1 else max(0.0, 2 - apart) ** 3 / 4
