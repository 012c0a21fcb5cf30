"""Where a crack's wall meets the rim on a profile from its middle outward, to a fraction of a cell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs

__all__ = ["RIM_CELLS", "STEP", "crack_edges"]

Floats = npt.NDArray[np.float64]

STEP = 0.5
"""Distance of samples along a profile, cells."""
RIM_CELLS = 1.0, 5.0
"""The rim is the median height between these distances outside the mask's edge, cells."""
DROP_SHARE = 0.05
"""Where the surface is this share of the crack's depth below its own rim, the wall is still seen."""
DROP_SIGMAS = 3.0
INNER, OUTER = 5, 4
"""The missing area is summed from so many samples before the first that reaches the rim to so many beyond: further
than a cell's mean and the interpolation smear a vertical wall."""
WALL = 2
"""Samples to either side of the inner point that tell how steep the wall is there."""
ABRUPT = 0.42, 0.56
"""Of the depth, what a wall falls within one cell: below the first it is seen as it is, above the second it is
steeper than cells can show."""
NARROW = 4.5
"""In half a crack of fewer cells a steep wall and a bent one look alike: the mean of both is taken."""
SMEAR = 1 / 12 + 1 / 6
"""Variance of where one sample's surface lies, cells squared: of a cell's mean, and of interpolation on average."""
SMEARED_AREA = SMEAR / 2 + STEP**2 / 12
"""By so much times the slope at the inner point is the area beyond it seen too large: what lies inside is smeared
across it; and the sum over samples is a trapezoid's."""
SMEARED_GAP = SMEAR + float(np.mean(np.square(np.arange(-WALL, WALL + 1) * STEP)))
"""By so much times the wall's bend is the gap at the inner point seen too small: the mean over the samples about it."""
LEAST_CELLS = 0.15
"""Standard uncertainty of an edge that no noise explains: how the raster lies to it, and the wall's own bend."""


PROFILES = 512
"""So many profiles at once stay in the processor's cache."""


def crack_edges(
    z: npt.NDArray[np.float32] | Floats, inside: npt.NDArray[np.bool_], floor: Floats, sigma_z: float
) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    """Find the edge along each profile.

    Cells are means over their area and profiles are interpolated, so a vertical wall is seen as a ramp; no level on
    the ramp is the wall's place for all shapes of crack. What averaging keeps is the area. From a point well inside,
    where the surface lies g below the rim and rises by s per cell, to one well outside, the area D is missing below
    the rim. A wall that can be followed is a parabola through that point with that slope, which meets the rim at

        L = 2 D / (2 g / 3 + sqrt(4 g^2 / 9 - 2 s D / 3))

    cells further out: exact for straight walls and for parabolic floors. Cells and samples smear what they see, by a
    variance of 1/4 cell squared: across the inner point comes 7/48 s of area, and g is seen 3/4 c smaller where
    the wall is bent by c = (g - s L) / L^2; both are given back. A wall that falls most of the depth within
    one cell is vertical for all that cells can tell, and then L = D / g. In between, and in cracks of a few cells
    where the two look alike, both are averaged, and their difference is part of the uncertainty.

    Parameters
    ----------
    z : ndarray of float64, shape (profile, sample)
        Heights from the middle of the crack outward, `STEP` cells apart, mm; NaN where not measured.
    inside : ndarray of bool, shape (profile, sample)
        Samples in the crack's mask.
    floor : ndarray of float64, shape (profile,)
        Lowest height of the crack on the whole profile, mm; infinite where nothing was seen.
    sigma_z : float
        Standard uncertainty of a height, mm.

    Returns
    -------
    edge, sigma : ndarray of float64, shape (profile,)
        Distance from the middle and its standard uncertainty, cells; NaN where there is no edge.
    crossed : ndarray of bool, shape (profile,)
        The surface was seen to cross; otherwise measurement just begins at the edge.
    """

    def part(first: int, last: int) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
        return _edges(z[first:last], inside[first:last], floor[first:last], sigma_z)

    some = in_slabs(len(z), part, step=PROFILES)
    edge, sigma, crossed = (np.concatenate(each) for each in zip(*some, strict=True))
    return edge, sigma, crossed


def _edges(
    z: npt.NDArray[np.float32] | Floats, inside: npt.NDArray[np.bool_], floor: Floats, sigma_z: float
) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    count, samples = z.shape
    lead = np.arange(samples)
    take = np.arange(count)
    # first sample at which the ray has left the mask
    left = np.where((~inside).any(axis=1), np.argmax(~inside, axis=1), samples)
    beyond = (lead >= (left + RIM_CELLS[0] / STEP)[:, None]) & (lead <= (left + RIM_CELLS[1] / STEP)[:, None])
    on_rim = beyond & ~inside & np.isfinite(z)
    known = on_rim.sum(axis=1) >= 3
    middle, tilt = _lie_of(z, on_rim)
    rim = np.full(count, np.nan)
    rim[known] = _medians(z[known], on_rim[known])
    depth = np.where(np.isfinite(floor), rim - floor, 0.0)
    level = rim - np.maximum(DROP_SHARE * depth, DROP_SIGMAS * sigma_z)
    up = np.isfinite(z) & (z >= level[:, None]) & (lead >= (left - 4 / STEP)[:, None])
    found = up.any(axis=1) & known
    first = np.argmax(up, axis=1)
    before = np.maximum(first - 1, 0)
    low, high = z[take, before], z[take, first]
    crossed = np.isfinite(low) & (low < level) & (first > 0)
    share = np.where(crossed, (level - low) / np.where(crossed, high - low, 1.0), 0.5)
    edge = (before + share) * STEP
    # where measurement just begins, the edge is somewhere in a cell
    sigma = np.where(crossed, np.minimum(sigma_z / np.maximum(high - low, 1e-9) * STEP, 1.0), 1 / np.sqrt(12))
    # a plate that curls is highest at its edge, and beyond nothing is missing of it
    sloped = tilt[:, None] * np.maximum(lead - first[:, None], 0)
    by_area, spread = _by_area(z - sloped, first, rim + tilt * (first - middle), depth, sigma_z)
    better = crossed & np.isfinite(by_area)
    edge, sigma = np.where(better, by_area, edge), np.where(better, spread, sigma)
    edge[~found] = np.nan
    return edge, np.where(found, sigma, np.nan), crossed


def _medians(z: npt.NDArray[np.float32] | Floats, use: npt.NDArray[np.bool_]) -> npt.NDArray[np.floating]:
    """Median of each row's used values; every row has some."""
    ranked = np.sort(np.where(use, z, np.inf), axis=1)  # what is not used comes last
    count, take = use.sum(axis=1), np.arange(len(z))
    middle: npt.NDArray[np.floating] = (ranked[take, (count - 1) // 2] + ranked[take, count // 2]) / 2
    return middle


def _lie_of(z: npt.NDArray[np.float32] | Floats, on_rim: npt.NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Middle of the rim's samples, and by how much the rim rises from one to the next (least squares)."""
    lead = np.arange(z.shape[1])
    count = np.maximum(on_rim.sum(axis=1), 1)
    middle = np.where(on_rim, lead, 0).sum(axis=1) / count
    away = np.where(on_rim, lead - middle[:, None], 0.0)
    lever = (away**2).sum(axis=1)
    return middle, (away * np.where(on_rim, z, 0.0)).sum(axis=1) / np.where(lever > 0, lever, 1.0)


def _by_area(
    z: npt.NDArray[np.float32] | Floats, first: npt.NDArray[np.intp], rim: Floats, depth: Floats, sigma_z: float
) -> tuple[Floats, Floats]:
    """The edge by the area that is missing, and its standard uncertainty, cells; NaN where too little is seen."""
    count, samples = z.shape
    take = np.arange(count)[:, None]
    start = np.maximum(first - INNER, 1)

    def gather(low: npt.NDArray[np.intp], number: int) -> Floats:
        at = low[:, None] + np.arange(number)
        return np.where((at >= 0) & (at < samples), z[take, np.clip(at, 0, samples - 1)], np.nan)

    number = 2 * WALL + 1
    place = np.arange(-WALL, WALL + 1) * STEP
    wall = gather(start - WALL, number)
    seen = np.isfinite(wall)
    n = np.maximum(seen.sum(axis=1), 1)
    middle = np.where(seen, place, 0.0).sum(axis=1) / n
    mean = np.where(seen, wall, 0.0).sum(axis=1) / n
    lever = np.where(seen, (place - middle[:, None]) ** 2, 0.0).sum(axis=1)
    rise = np.where(seen, (place - middle[:, None]) * (wall - mean[:, None]), 0.0).sum(axis=1)
    usable = seen.sum(axis=1) >= 3
    slope = np.maximum(np.where(usable, rise / np.where(lever > 0, lever, 1.0), 0.0), 0.0)
    missing = rim[:, None] - gather(start, INNER + OUTER + 1)
    gap = rim - (mean - slope * middle)
    held = np.arange(INNER + OUTER + 1) <= (first - start + OUTER)[:, None]
    usable &= (np.isfinite(missing) | ~held).all(axis=1) & (gap > DROP_SIGMAS * sigma_z)
    missing = np.where(held, missing, 0.0)
    area = STEP * (missing.sum(axis=1) - 0.5 * missing[:, 0])
    error = sigma_z * STEP * np.sqrt(held.sum(axis=1))
    cell = round(1 / STEP)
    drop = (missing[:, :-cell] - missing[:, cell:]).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sharp = area - SMEARED_AREA * slope
        bent = _parabola(sharp, gap, slope)
        for _ in range(3):  # the bend that is given back bends the wall more, ever less
            bend = np.clip((gap - slope * bent) / bent**2, 0.0, None)
            bent = _parabola(sharp, gap + SMEARED_GAP * bend, slope)
        stepped = area / gap
        abrupt = np.clip((drop / np.maximum(depth, gap) - ABRUPT[0]) / (ABRUPT[1] - ABRUPT[0]), 0.0, 1.0)
        narrow = np.clip((NARROW - first * STEP) / 2, 0.0, 1.0)
        length = bent + (1 - 0.5 * narrow) * abrupt * (stepped - bent)
        spread = np.hypot(2 * error / gap, 0.5 * narrow * abrupt * (stepped - bent))
    usable &= (length > -1) & (length <= (INNER + OUTER) * STEP)
    edge = np.where(usable, start * STEP + length, np.nan)
    return edge, np.hypot(np.minimum(spread, 1.0), LEAST_CELLS)


def _parabola(area: Floats, gap: Floats, slope: Floats) -> Floats:
    """Where a parabola of that gap and slope at the inner point meets the rim, with that area below it."""
    length: Floats = 2 * area / (2 * gap / 3 + np.sqrt(np.maximum(4 * gap**2 / 9 - 2 * slope * area / 3, 0.0)))
    return length
