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
from .pixel_maps import Decoded, Shared
from .scatter_kernels import TILE, settle
from .shared_error import shared_by_lines
from .threshold import tilt_of

__all__ = ["locate", "refine"]

SETTLED = 8 * TILE  # image rows whose uncertainties are settled at once: whole tiles, whatever the number of cores
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
    found: list[tuple[Floats, Floats, Shared]] = []
    for number, cells in enumerate(decoded.axes):
        place, sigma, shared = *(np.empty(frames.stack.shape[1:], np.float32) for _ in range(2)), Shared()
        if cells is None:
            place[:] = sigma[:] = np.nan
        else:
            shared = _between_edges(frames, number, cells, decoded, light, place, sigma)
        found.append((place, sigma, shared))
    (column, sigma_column, shared_column), (row, sigma_row, shared_row) = found
    return Decoded(
        column,
        row,
        sigma_column,
        sigma_row,
        decoded.level.copy(),
        decoded.texture.copy(),
        decoded.contrast.copy(),
        (shared_column, shared_row),
    )


def _between_edges(
    frames: Frames,
    axis: int,
    cells: AxisCells,
    decoded: Cells,
    light: Light,
    place: Floats,
    sigma: Floats,
) -> Shared:
    """Fill the positions and sigmas of one axis; give what its lines share."""
    steps = decoded.steps[axis]
    tilt = tilt_of(axis, decoded.levels, light)
    stack = cast(Stack, np.ascontiguousarray(frames.stack))
    down, pictures, reach = line_pictures(frames, stack, axis, cells, every(steps), light.noise, tilt)
    run = along_columns if down else along_rows

    def slab(first: int, last: int) -> None:
        run(pictures, steps, decoded.contrast, first, last, place, sigma)

    in_slabs(steps.shape[1 if down else 0], slab)
    lags = (reach, 0) if down else (0, reach)
    unseen, shared = _shared_by_lines(place, sigma, down, reach)
    more = np.float32(unseen)
    in_slabs(len(steps), lambda first, last: settle(place, sigma, *lags, more, first, last), step=SETTLED)
    return shared


def _shared_by_lines(place: Floats, variance: Floats, down: bool, cell: int) -> tuple[float, Shared]:
    """As `shared_by_lines`, of an image."""
    if down:
        place, variance = place.T, variance.T
    return shared_by_lines(
        lambda at, distance: (place[at - distance], place[at], place[at + distance], variance[at]), place.shape, cell
    )
