"""What neighbouring lines of an image share of their errors: read off positions, and carried to heights."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .pinhole import project
from .pixel_maps import Shared
from .rig_model import Calibration
from .sight import in_front, on_plane

__all__ = ["Pick", "carrier", "left_by_mean", "shared_by_lines", "shared_mm2"]

LINES = 6  # of the image, that tell what neighbouring lines share
FEW = 200
PART = 5  # one in so many samples tells how phases go on
STEP_MM = 0.01  # of height, over which the projector's px per mm are taken
LEAST_GROWTH = 1e-3  # projector px per camera px

FARTHER = 1, 2, 4, 8  # cells over which second differences are taken
AS_SMOOTH = 2.0  # times the mean square over a cell: beyond, relief shows over that distance

Floats = npt.NDArray[np.float32]
Pick = Callable[[npt.NDArray[np.int64], int], tuple[Floats, Floats, Floats, Floats]]


def shared_mm2(shared: tuple[Shared, Shared], calibration: Calibration) -> Shared:
    """What lines share of distances, mm squared, from what they share of column and row (px squared).

    By how far a place on the projector moves with the distance in the middle of the image, along the axis that carries
    the parallax; how steep the surface is does not matter there.
    """
    px_per_mm = _parallax(calibration)
    axis = int(np.argmax(px_per_mm))
    if not px_per_mm[axis] > 0:
        return Shared()
    per_px2 = 1 / float(px_per_mm[axis]) ** 2
    return Shared(shared[axis].within * per_px2, shared[axis].beside * per_px2)


def carrier(calibration: Calibration) -> int:
    """Which axis of the projector tells distances: 0 for columns, 1 for rows."""
    return int(np.argmax(_parallax(calibration)))


def _parallax(calibration: Calibration) -> npt.NDArray[np.float64]:
    """Projector px, along columns and rows, per mm of distance from the camera; 0 where the projector sees nothing."""
    middle = np.array(calibration.camera.size) / 2
    points = np.stack([on_plane(calibration.camera, calibration.reference, middle, h) for h in (0.0, STEP_MM)])
    lit = points @ calibration.R.T + calibration.t_mm
    if not in_front(calibration.projector, lit).all():
        return np.zeros(2)
    places = project(calibration.projector, lit)
    moved: npt.NDArray[np.float64] = np.abs((places[1] - places[0]) / (points[1, 2] - points[0, 2]))
    return moved


def left_by_mean(side_px: float, apart: float, here: Floats, aside: Floats, below: Floats) -> float:
    """Share of a variance that lines share which is left in the mean of a cell.

    An edge is off by what depends on where it lies between two pixels. Its phase there goes on by the edge's shift from
    line to line, and along the lines by what the distance of two edges is off whole pixels: over a cell by so much
    that a mean over it leaves sinc^2 of it. Other than that edges err independently, as `apart` says.

    Parameters
    ----------
    side_px : float
        Side of a cell, camera px.
    apart : float
        Points along a line that are worth one.
    here, aside, below : ndarray of float32
        Positions at a raster of pixels, and at the next ones along and down the image.
    """
    lines = max(side_px, 1.0)
    alone = 1 / (1 + (lines - 1) / apart)
    growth, shift = (np.ravel(beside - here)[::PART] for beside in (aside, below))
    known = np.isfinite(growth) & np.isfinite(shift)
    growth, shift = np.abs(growth[known]), np.abs(shift[known])
    if not growth.size:
        return 1.0
    if np.median(shift) > np.median(growth):
        growth, shift = shift, growth
    turns = _off_whole(growth), shift / np.maximum(growth, LEAST_GROWTH)
    left = [alone + (1 - alone) * np.sinc(lines * turn) ** 2 for turn in turns]
    return float(np.mean(left[0] * left[1]))


def shared_by_lines(pick: Pick, shape: tuple[int, int], cell: int) -> tuple[float, Shared]:
    """Variance of positions that neighbouring lines share, projector px squared: what moves an edge all along.

    Sharper edges than the pixels resolve, and light that flickers, displace an edge in all lines alike where it runs
    across them. Second differences along the lines show it, over a cell, and those across do not; relief is in both.
    Errors of single edges show with six times the variance of positions across the lines, but along them with
    6 - 8 r(d) + 2 r(2 d), as positions d cells apart have edges in common: r is a cubic B-spline, for between edges
    positions are linear. What is missing of noise, as the variances say it or as it is seen across if that is less, is
    added. Medians, of the whole capture: surfaces break off.

    Where cells are nearly whole pixels wide, edges a cell apart lie alike in their pixels and are off alike: farther
    ones are looked at too, as long as the surface is as smooth over that distance as over a cell. There the same error,
    a wave of the edges' phase, shows with 6 - 8 cos(t) + 2 cos(2 t), t being what the phase goes on by.

    Parameters
    ----------
    pick : callable
        Of numbers of lines and a distance in lines: positions along these lines, along those so far before and behind
        them, and the variances of the first, negative where there was no edge on both sides; each (line, px).
    shape : (int, int)
        Lines, px.
    cell : int
        Camera px.

    Returns
    -------
    unseen : float
        What lines share beyond the variances.
    shared : Shared
        Within: that, and what of the variances does not scatter across the lines, as the profile of an edge is the same
        in all of them. Beside: what only farther edges tell.
    """
    unseen = said = noise = smooth = most = bound = 0.0
    shows = False
    for distance in (cell * times for times in FARTHER):
        first, at = distance == cell, telling_lines(shape, distance)
        told = differences(*pick(at, distance), distance, even=not first) if len(at) else None
        if told is None:
            break
        if first:
            said, noise, smooth = told.variance, min(told.variance, told.across / 6), AS_SMOOTH * told.across
        bare = told.along - told.apart * noise
        relief = told.across - 6 * noise
        if first:
            unseen = most = max(bare - relief, 0.0) / told.apart
        elif told.across <= smooth:
            most = max(most, (bare - relief) / max(told.apart, told.in_phase))
        bound, shows = max(bound, bare / told.apart), told.in_phase > told.apart
        if shows:
            break
    within = unseen + said - noise
    return unseen, Shared(min(within, bound) if shows else within, max(most - within, 0.0))


def telling_lines(shape: tuple[int, int], cell: int) -> npt.NDArray[np.int64]:
    """Which lines, of so many of such a length, tell what neighbouring ones share; none in a small image."""
    lines, length = shape
    if cell < 1 or lines <= 2 * cell or length <= 2 * cell:
        return np.empty(0, np.int64)
    return np.linspace(cell, lines - cell - 1, min(LINES, lines - 2 * cell)).astype(np.int64)


class Differences(NamedTuple):
    """Mean squares of second differences by their medians, the variance that is said, and what errors show in them."""

    along: float
    across: float
    variance: float
    apart: float
    in_phase: float


def differences(
    before: Floats, here: Floats, after: Floats, variance: Floats, distance: int, *, even: bool
) -> Differences | None:
    """Compare second differences along lines and across them, over so many px; None where too little is known.

    `even` leaves out what all have in common: over many px lenses bend straight lines.
    """
    here = np.where(variance > 0, here, np.float32(np.nan))
    along = here[:, : -2 * distance] - 2 * here[:, distance:-distance] + here[:, 2 * distance :]
    across = (before - 2 * here + after)[:, distance:-distance]
    known = np.isfinite(along) & np.isfinite(across)
    if known.sum() < FEW:
        return None
    a, b = (_spread(values[known], float(np.median(values[known])) if even else 0.0) for values in (along, across))
    apart = np.abs(here[:, 2 * distance :] - here[:, : -2 * distance])[known]
    step = float(np.median(apart)) / 2
    turn = 2 * np.pi * distance * _off_whole(apart / (2 * distance))
    return Differences(
        a * a,
        b * b,
        float(np.median(variance[:, distance:-distance][known])),
        6 - 8 * _in_common(step) + 2 * _in_common(2 * step),
        float(np.mean(6 - 8 * np.cos(turn) + 2 * np.cos(2 * turn))),
    )


def _spread(values: Floats, mean: float) -> float:
    """Standard deviation by the median, as surfaces break off."""
    return float(np.median(np.abs(values - np.float32(mean)))) / 0.6745


def _off_whole(growth: Floats) -> Floats:
    """By how much the phase of edges goes on per camera px, turns, where cells are 1 / growth px wide."""
    growth = np.maximum(growth, np.float32(LEAST_GROWTH))
    return np.asarray(1 - growth * np.rint(1 / growth), np.float32)


def _in_common(apart: float) -> float:
    """Correlation of positions that lie so many cells apart on a line."""
    return max(0.0, 1 - 1.5 * apart**2 + 0.75 * apart**3) if apart < 1 else max(0.0, 2 - apart) ** 3 / 4
