"""Slanted edge: contrast against line width from one straight edge, as ISO 12233's e-SFR; and how to find one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .resolution import ContrastCurve, Roi, crop

__all__ = ["edge_contrast", "find_edge"]

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

BIN_PX = 0.25
TILTS_DEG = 1.5, 20.0  # less: the pixels sample one phase only; more: few rows cross the edge
SMALLEST_PX = 20
NOISE_BAND = 1.0, 1.75  # cycles/px: beyond what pixels pass, so all that is there is noise
WINDOW = 7.0  # the spread counts to this many of its standard deviations, tapered from the half of it
CANDIDATES = 60  # boxes of each size that are looked at, strongest gradients in one direction first
FLAT = 0.15  # spread of either side, share of the edge


def edge_contrast(image: npt.NDArray[np.generic], pixel_um: float, roi: Roi | None = None) -> ContrastCurve:
    """Measure contrast against line width at a straight edge between dark and bright.

    As in ISO 12233: the edge is found in each row from the derivative's centroid, a line is fitted, all pixels
    are put into bins of a quarter pixel by their distance from it, and the derivative of their means is
    Fourier transformed. The attenuation by bins and by the difference (each sinc(f/4)) is taken out. Noise beyond 1
    cycle per pixel, where an image has nothing of the scene, scaled with frequency as a derivative's is, is
    subtracted in quadrature. Unlike ISO's window, ours follows the width of the spread: less noise, and blur is not
    taken for sharper than it is; a faint halo beyond 7 standard deviations does not count.

    Parameters
    ----------
    image : ndarray, shape (row, column)
    pixel_um : float
        Camera pixel on the object.
    roi : Roi, optional
        A box that holds the edge and nothing else; found by `find_edge` if not given.

    Returns
    -------
    ContrastCurve
        At frequencies up to 0.5 cycles per pixel.

    Raises
    ------
    ValueError
        There is no such edge; the message says what is wrong with it.
    """
    grey = np.asarray(image, np.float64)
    box = find_edge(grey) if roi is None else roi
    patch = crop(grey, box)
    if min(patch.shape) < SMALLEST_PX:
        raise ValueError(f"a box for an edge needs {SMALLEST_PX} px and more on each side, not {box[2]}x{box[3]}")
    patch = _upright(patch)
    offset, slope, residual = _line(patch)
    tilt = math.degrees(math.atan(abs(slope)))
    if residual > 1.0:
        raise ValueError(f"no straight edge in the box {','.join(map(str, box))}: rows differ by {residual:.1f} px")
    if tilt < TILTS_DEG[0]:
        raise ValueError(f"the edge is tilted by {tilt:.1f} degrees only: turn the chart by 2 to 15 degrees")
    distances = _distances(patch.shape, offset, slope)
    half = float(min(distances[:, -1].min(), -distances[:, 0].max()))
    if half < SMALLEST_PX / 4:
        raise ValueError("the edge leaves the box sideways: give a wider box, or one that is less high")
    spread = _spread(patch, distances, half)
    frequency = np.arange(0.01, NOISE_BAND[1], 0.01).round(2)
    steps = np.arange(len(spread)) * BIN_PX
    transform = np.abs(np.exp(-2j * np.pi * frequency[:, None] * steps) @ spread) / abs(spread.sum())
    transform /= np.sinc(frequency * BIN_PX) ** 2
    beyond = frequency >= NOISE_BAND[0]
    # the noise of a transform is complex: half of its power lies along the contrast
    noise: Floats = math.sqrt(float(np.mean((transform[beyond] / frequency[beyond]) ** 2)) / 2) * frequency
    used = frequency <= 0.5
    contrast = np.sqrt(np.maximum(transform**2 - 2 * noise**2, 0.0))
    return ContrastCurve(pixel_um / (2 * frequency[used]), contrast[used], noise[used], pixel_um, box, tilt)


def find_edge(image: npt.NDArray[np.generic]) -> Roi:
    """Find the box with the strongest straight edge that is tilted and has even ground on both sides.

    Raises
    ------
    ValueError
        There is none.
    """
    grey = np.asarray(image, np.float64)
    down, across = np.gradient(grey)
    sums = [np.pad(each, ((1, 0), (1, 0))).cumsum(0).cumsum(1) for each in (across**2, down**2, across * down)]
    best: tuple[float, Roi] | None = None
    for side in (160, 96, 56, 32):
        if side > min(grey.shape):
            continue
        rows = np.arange(0, grey.shape[0] - side + 1, side // 4)
        columns = np.arange(0, grey.shape[1] - side + 1, side // 4)
        xx, yy, xy = (_box_sums(each, rows, columns, side) for each in sums)
        normal = np.rad2deg(0.5 * np.arctan2(2 * xy, xx - yy))
        tilt = np.abs((normal + 45) % 90 - 45)
        strength = np.where((tilt >= TILTS_DEG[0]) & (tilt <= TILTS_DEG[1]), np.hypot(xx - yy, 2 * xy), 0.0)
        for place in np.argsort(strength, axis=None)[::-1][:CANDIDATES]:
            i, j = np.unravel_index(place, strength.shape)
            row, column = int(rows[i]), int(columns[j])
            if strength[i, j] <= 0:
                break
            height = _edge_height(grey[row : row + side, column : column + side])
            if height > 0 and (best is None or height > 1.1 * best[0]):
                best = (height, (column, row, side, side))
    if best is None:
        raise ValueError(
            "found no straight edge that is tilted by 2 to 15 degrees with even ground on both sides: give its box"
        )
    return best[1]


def _box_sums(integral: Floats, rows: Indices, columns: Indices, side: int) -> Floats:
    """Sums over square boxes, from the integral image."""
    top, bottom = integral[rows], integral[rows + side]
    sums: Floats = bottom[:, columns + side] - bottom[:, columns] - top[:, columns + side] + top[:, columns]
    return sums


def _edge_height(patch: Floats) -> float:
    """Grey difference across the edge of a patch; 0 where it holds no single slanted edge near its middle."""
    upright = _upright(patch)
    offset, slope, residual = _line(upright)
    if residual > 0.7 or not TILTS_DEG[0] <= math.degrees(math.atan(abs(slope))) <= TILTS_DEG[1]:
        return 0.0
    distances = _distances(upright.shape, offset, slope)
    half = float(min(distances[:, -1].min(), -distances[:, 0].max()))
    if half < 0.2 * len(upright):
        return 0.0
    sides = [upright[side] for side in (distances < -half / 2, distances > half / 2)]
    low, high = float(sides[0].mean()), float(sides[1].mean())
    height = abs(high - low)
    if max(float(side.std()) for side in sides) > FLAT * height:
        return 0.0
    return height


def _upright(patch: Floats) -> Floats:
    """Transpose a patch whose edge runs along the rows."""
    across = abs(float(patch[:, -3:].mean() - patch[:, :3].mean()))
    down = abs(float(patch[-3:].mean() - patch[:3].mean()))
    return patch if across >= down else np.ascontiguousarray(patch.T)


def _line(patch: Floats) -> tuple[float, float, float]:
    """Column of the edge in row 0, its slope in columns per row, and the robust spread of single rows about it."""
    derivative = np.diff(patch, axis=1)
    rows, columns = derivative.shape
    derivative = derivative * np.sign(derivative.sum())
    row, column = np.arange(rows), np.arange(columns) + 0.5
    centre = (
        np.full(rows, (derivative.sum(axis=0) * column).sum() / derivative.sum()) if derivative.any() else row * 0.0
    )
    width = float(columns)
    for narrowing in (1.0, 0.7, 0.5, 0.5):
        width = max(12.0, narrowing * columns)
        off = (column - centre[:, None]) / (width / 2)
        weight = np.where(np.abs(off) < 1, 0.54 + 0.46 * np.cos(np.pi * off), 0.0) * derivative
        total = weight.sum(axis=1)
        usable = total > 0.2 * np.median(total)
        if np.count_nonzero(usable) < 0.7 * rows or not np.median(total) > 0:
            return 0.0, 0.0, float("inf")
        found = (weight * column)[usable].sum(axis=1) / total[usable]
        slope, offset = np.polyfit(row[usable], found, 1)
        centre = offset + slope * row
    residual = 1.4826 * float(np.median(np.abs(found - centre[usable])))
    return float(offset), float(slope), residual


def _distances(shape: tuple[int, ...], offset: float, slope: float) -> Floats:
    """Distance of each pixel from the edge, px, growing with the column."""
    rows, columns = shape
    across = np.arange(columns)[None, :] - (offset + slope * np.arange(rows))[:, None]
    distances: Floats = across / math.hypot(1.0, slope)
    return distances


def _spread(patch: Floats, distances: Floats, half: float) -> Floats:
    """The line spread function in steps of `BIN_PX`: the windowed derivative of the oversampled edge."""
    count = int(half / BIN_PX)
    number = np.rint(distances / BIN_PX).astype(int) + count
    inside = (number >= 0) & (number <= 2 * count)
    hits = np.bincount(number[inside], minlength=2 * count + 1)
    sums = np.bincount(number[inside], weights=patch[inside], minlength=2 * count + 1)
    filled = np.flatnonzero(hits)
    edge = np.interp(np.arange(2 * count + 1), filled, sums[filled] / hits[filled])
    spread = np.diff(edge)
    rise = np.cumsum(spread) / spread.sum()
    low, middle, high = (int(np.argmax(rise > share)) for share in (0.1, 0.5, 0.9))
    reach = max(SMALLEST_PX / 2 / BIN_PX, WINDOW * (high - low) / 2.563)  # 10 to 90 % of a Gaussian
    reach = min(reach, middle, len(spread) - 1 - middle)
    off = np.abs(np.arange(len(spread)) - middle) / max(reach, 1.0)
    windowed: Floats = spread * np.where(
        off < 0.5, 1.0, np.where(off < 1, 0.5 + 0.5 * np.cos(np.pi * (2 * off - 1)), 0)
    )
    return windowed
