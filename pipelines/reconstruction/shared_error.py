"""What neighbouring lines of an image share of their errors: read off positions, and carried to heights."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .pinhole import project
from .rig_model import Calibration
from .sight import on_plane

__all__ = ["carrier", "left_by_mean", "shared_by", "shared_mm2", "telling_lines"]

LINES = 6  # of the image, that tell what neighbouring lines share
FEW = 200
STEP_MM = 0.01  # of height, over which the projector's px per mm are taken
LEAST_GROWTH = 1e-3  # projector px per camera px

Floats = npt.NDArray[np.float32]


def shared_mm2(shared: tuple[float, float], calibration: Calibration) -> float:
    """Variance of distances that lines share, mm squared, from those of column and row (px squared).

    By how far a place on the projector moves with the distance in the middle of the image, along the axis that carries
    the parallax; how steep the surface is does not matter there.
    """
    px_per_mm = _parallax(calibration)
    axis = carrier(calibration)
    return shared[axis] / float(px_per_mm[axis]) ** 2


def carrier(calibration: Calibration) -> int:
    """Which axis of the projector tells distances: 0 for columns, 1 for rows."""
    return int(np.argmax(_parallax(calibration)))


def _parallax(calibration: Calibration) -> npt.NDArray[np.float64]:
    """Projector px, along columns and rows, per mm of distance from the camera."""
    middle = np.array(calibration.camera.size) / 2
    points = np.stack([on_plane(calibration.camera, calibration.reference, middle, h) for h in (0.0, STEP_MM)])
    places = project(calibration.projector, points @ calibration.R.T + calibration.t_mm)
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
    growth, shift = aside - here, below - here
    known = np.isfinite(growth) & np.isfinite(shift)
    growth, shift = np.abs(growth[known]), np.abs(shift[known])
    if not growth.size:
        return 1.0
    if np.median(shift) > np.median(growth):
        growth, shift = shift, growth
    growth = np.maximum(growth, LEAST_GROWTH)
    left = [alone + (1 - alone) * np.sinc(lines * turn) ** 2
            for turn in (1 - growth * np.rint(1 / growth), shift / growth)]  # fmt: skip
    return float(np.mean(left[0] * left[1]))


def telling_lines(shape: tuple[int, ...], cell: int) -> npt.NDArray[np.int64]:
    """Which lines, of so many of such a length, tell what neighbouring ones share; none in a small image."""
    lines, length = shape
    if cell < 1 or lines <= 2 * cell or length <= 2 * cell:
        return np.empty(0, np.int64)
    return np.linspace(cell, lines - cell - 1, min(LINES, lines - 2 * cell)).astype(np.int64)


def shared_by(before: Floats, here: Floats, after: Floats, variance: Floats, cell: int) -> tuple[float, float]:
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

    Returns
    -------
    unseen, whole : float
        What lines share beyond the variances, and with it what of the variances does not scatter across the lines: the
        profile of the edge is the same in all of them.
    """
    here = np.where(variance > 0, here, np.float32(np.nan))
    along = np.abs(here[:, : -2 * cell] - 2 * here[:, cell:-cell] + here[:, 2 * cell :])
    across = np.abs(before - 2 * here + after)[:, cell:-cell]
    known = np.isfinite(along) & np.isfinite(across)
    if known.sum() < FEW:
        return 0.0, 0.0
    a, b = (float(np.median(values[known])) / 0.6745 for values in (along, across))
    said = float(np.median(variance[:, cell:-cell][known]))
    noise = min(said, b * b / 6)
    step = float(np.median(np.abs(here[:, 2 * cell :] - here[:, : -2 * cell])[known])) / 2
    shown = 6 - 8 * _in_common(step) + 2 * _in_common(2 * step)
    unseen = max(a * a - b * b + (6 - shown) * noise, 0.0) / shown
    return unseen, unseen + said - noise


def _in_common(apart: float) -> float:
    """Correlation of positions that lie so many cells apart on a line."""
    return max(0.0, 1 - 1.5 * apart**2 + 0.75 * apart**3) if apart < 1 else max(0.0, 2 - apart) ** 3 / 4
