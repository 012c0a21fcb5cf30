"""Resolution: contrast against line width from an edge (e-SFR) or from bars (USAF 1951), and what follows from it.

Contrast is the transfer of a sine wave of that line width, 1 for wide lines, by whichever way it is measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pinhole import undistort
from .rig_model import Calibration

__all__ = [
    "PAPER_THRESHOLD",
    "ContrastCurve",
    "DepthOfField",
    "Roi",
    "depth_of_field",
    "object_pixel_um",
    "usaf_contrast",
    "usaf_line_um",
]

Floats = npt.NDArray[np.float64]
Roi = tuple[int, int, int, int]
"""Column, row, width, height in px."""

PAPER_THRESHOLD = 0.02
"""Contrast at which the paper calls lines resolved (section 4.2)."""


@dataclass(frozen=True, slots=True, eq=False)
class ContrastCurve:
    """Contrast against line width in one image.

    Parameters
    ----------
    line_um : ndarray of float64, shape (n,)
        Width of one line (half a period), falling.
    contrast : ndarray of float64, shape (n,)
        0 to about 1, less what noise alone would give.
    noise : ndarray of float64, shape (n,)
        Standard uncertainty of the contrast by the image's noise.
    pixel_um : float
        Camera pixel on the object: lines narrower than one are beyond the sampling.
    roi : Roi
    tilt_deg : float
        Of the edge against the pixels; 0 for bars.
    """

    line_um: Floats
    contrast: Floats
    noise: Floats
    pixel_um: float
    roi: Roi
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        if not self.line_um.shape == self.contrast.shape == self.noise.shape or (np.diff(self.line_um) >= 0).any():
            raise ValueError("a contrast curve has line widths that fall, and a contrast and noise for each")

    def at(self, line_um: float) -> float:
        """Contrast of a line width by interpolation over frequency; NaN outside what was measured."""
        low, high = float(self.line_um[-1]), float(self.line_um[0])
        if not low <= line_um <= high:
            return float("nan")
        return float(np.interp(1 / line_um, 1 / self.line_um, self.contrast))

    def resolution_um(self, threshold: float = PAPER_THRESHOLD) -> float:
        """Width of the narrowest line down to which all have at least the threshold's contrast.

        Returns
        -------
        float
            Interpolated over frequency; NaN where even the widest line has less; the narrowest width measured, or one
            pixel, where all have more.
        """
        if self.contrast[0] < threshold:
            return float("nan")
        below = np.flatnonzero(self.contrast < threshold)
        if len(below) == 0:
            return max(float(self.line_um[-1]), self.pixel_um)
        last = below[0] - 1
        (f0, f1), (c0, c1) = 1 / self.line_um[last : last + 2], self.contrast[last : last + 2]
        found = f0 + (f1 - f0) * (c0 - threshold) / (c0 - c1)
        return max(float(1 / found), self.pixel_um)

    def uncertainty_um(self, threshold: float = PAPER_THRESHOLD) -> float:
        """Standard uncertainty of `resolution_um` by the image's noise; NaN where the threshold is not reached."""
        if not self.reaches(threshold):
            return float("nan")
        below = int(np.flatnonzero(self.contrast < threshold)[0])
        first = max(0, below - max(2, len(self.line_um) // 20))
        frequency = 1 / self.line_um
        fall = (self.contrast[first] - self.contrast[below]) / (frequency[below] - frequency[first])
        return float(self.noise[below] / fall * self.resolution_um(threshold) ** 2)

    def reaches(self, threshold: float = PAPER_THRESHOLD) -> bool:
        """Whether the contrast falls to the threshold within what was measured and sampled."""
        below = np.flatnonzero(self.contrast < threshold)
        return len(below) > 0 and bool(self.resolution_um(threshold) > self.pixel_um)


@dataclass(frozen=True, slots=True)
class DepthOfField:
    """Where along the axis lines have the threshold's contrast; `open_low`, `open_high`: at least that far."""

    low_mm: float
    high_mm: float
    open_low: bool
    open_high: bool

    @property
    def extent_mm(self) -> float:
        """From one end to the other."""
        return self.high_mm - self.low_mm


def depth_of_field(z_mm: Sequence[float], contrast: Sequence[float], threshold: float) -> DepthOfField | None:
    """Give the stretch around the sharpest place in which the contrast is at least the threshold.

    Parameters
    ----------
    z_mm : sequence of float
        Different from each other, in any order.
    contrast : sequence of float
        Of one line width at each; NaN counts as 0.
    threshold : float

    Returns
    -------
    DepthOfField or None
        Ends interpolated linearly between places; None where even the sharpest place lies below.
    """
    order = np.argsort(z_mm)
    z, c = np.asarray(z_mm, np.float64)[order], np.nan_to_num(np.asarray(contrast, np.float64))[order]
    if len(z) < 2 or (np.diff(z) <= 0).any():
        raise ValueError("a focus series needs two or more different z")
    best = int(np.argmax(c))
    if c[best] < threshold:
        return None
    ends = []
    for step in (-1, 1):
        here = best
        while 0 <= here + step < len(z) and c[here + step] >= threshold:
            here += step
        beyond = here + step
        if 0 <= beyond < len(z):
            share = (c[here] - threshold) / (c[here] - c[beyond])
            ends.append((float(z[here] + share * (z[beyond] - z[here])), False))
        else:
            ends.append((float(z[here]), True))
    return DepthOfField(ends[0][0], ends[1][0], ends[0][1], ends[1][1])


def usaf_line_um(group: int, element: int) -> float:
    """Line width of an element of the USAF 1951 chart: 2^(group + (element - 1) / 6) line pairs per mm (MIL-STD-150A).

    Raises
    ------
    ValueError
        If there is no such element.
    """
    if not (-2 <= group <= 9 and 1 <= element <= 6):
        raise ValueError(f"the USAF chart has groups -2 to 9 and elements 1 to 6, not {group}.{element}")
    return float(500 / 2 ** (group + (element - 1) / 6))


def usaf_contrast(
    image: npt.NDArray[np.generic],
    elements: Mapping[tuple[int, int], Roi],
    pixel_um: float,
    levels: tuple[float, float] | None = None,
) -> ContrastCurve:
    """Measure the contrast of elements of a USAF 1951 chart, each given by where its three bars are.

    The bars are integrated along their length. Over their five line widths a sine of their period, a cosine and a
    polynomial of 4th degree (three blurred bars are also one broad blob) are fitted together; the amplitude, times
    pi/4 for square bars, over half the difference of the levels is the contrast of a sine (Coltman 1954).

    Parameters
    ----------
    image : ndarray, shape (row, column)
    elements : mapping of (group, element) to Roi
        The box holds three bars along rows or columns, some ground around them, and nothing else. Tilts to 2 degrees do
        little harm.
    pixel_um : float
    levels : (float, float), optional
        Grey of dark and bright areas that are too large to be blurred; by default the 0.5 and 99.5 percentiles.

    Raises
    ------
    ValueError
        If a box leaves the image or is too small for its bars.
    """
    grey = np.asarray(image, np.float64)
    lines = {name: usaf_line_um(*name) for name in elements}
    dark, bright = levels if levels is not None else np.percentile(grey, [0.5, 99.5])
    if bright <= dark:
        raise ValueError("the image has no contrast at all: is it the chart?")
    measured = []
    for (group, element), roi in elements.items():
        patch = crop(grey, roi)
        width = lines[group, element] / pixel_um
        if width < 1:
            raise ValueError(f"element {group}.{element}: its lines are {width:.2f} px wide, narrower than one pixel")
        if min(patch.shape) < 5 * width:
            raise ValueError(f"element {group}.{element}: its box must be {5 * width:.0f} px wide and high, or more")
        amplitude, noise = max(_bars(patch, width), _bars(patch.T, width))
        scale = np.pi / 4 / (0.5 * (bright - dark))
        measured.append((lines[group, element], amplitude * scale, noise * scale))
    measured.sort(reverse=True)
    line, contrast, uncertain = np.array(measured).T
    columns = [roi[0] for roi in elements.values()], [roi[0] + roi[2] for roi in elements.values()]
    rows = [roi[1] for roi in elements.values()], [roi[1] + roi[3] for roi in elements.values()]
    box = (min(columns[0]), min(rows[0]), max(columns[1]) - min(columns[0]), max(rows[1]) - min(rows[0]))
    return ContrastCurve(line, contrast, uncertain, pixel_um, box)


def crop(grey: Floats, roi: Roi) -> Floats:
    """Cut out a box; ValueError where it leaves the image."""
    column, row, width, height = roi
    rows, columns = grey.shape
    if width < 1 or height < 1 or column < 0 or row < 0 or column + width > columns or row + height > rows:
        raise ValueError(f"the box {column},{row},{width},{height} leaves the image of {columns}x{rows}")
    return grey[row : row + height, column : column + width]


def object_pixel_um(calibration: Calibration, z_mm: float = 0.0) -> float:
    """Side of the camera's middle pixel on the plane at `z_mm` in the site frame, um."""
    columns, rows = calibration.camera.size
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    flat = undistort(calibration.camera, middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    rays = np.concatenate([flat, np.ones((3, 1))], axis=-1)
    normal, offset = calibration.reference[2, :3], calibration.reference[2, 3]
    points = rays * ((z_mm - offset) / (rays @ normal))[:, None]
    return float(1000 * np.sqrt(np.linalg.norm(np.cross(points[1] - points[0], points[2] - points[0]))))


def _bars(patch: Floats, width: float) -> tuple[float, float]:
    """Amplitude of the sine in bars that stand upright in the patch, and its standard uncertainty."""
    ground = np.median(np.concatenate([patch[0], patch[-1], patch[:, 0], patch[:, -1]]))
    blob = (patch - ground) * np.sign(patch.mean() - ground)
    total = blob.sum()
    if total <= 0:
        return 0.0, 0.0
    row = (blob.sum(axis=1) * np.arange(patch.shape[0])).sum() / total
    column = (blob.sum(axis=0) * np.arange(patch.shape[1])).sum() / total
    first, last = max(0, round(row - 1.5 * width)), round(row + 1.5 * width) + 1  # bars are 5 widths long
    profile = patch[first:last].mean(axis=0)
    place = (np.arange(len(profile)) - column) / width
    used = np.abs(place) <= 2.5
    s, y = place[used], profile[used]
    design = np.stack([*((s / 2.5) ** power for power in range(5)), np.cos(np.pi * s), np.sin(np.pi * s)], axis=1)
    if len(s) < design.shape[1]:
        return 0.0, 0.0
    solved, *_ = np.linalg.lstsq(design, y, rcond=None)
    spread = patch[first:last].std(axis=0, ddof=1).mean() / np.sqrt(max(1, last - first))
    noise = float(spread * np.sqrt(np.linalg.inv(design.T @ design)[5, 5]))
    amplitude = float(np.hypot(solved[5], solved[6]))
    return float(np.sqrt(max(0.0, amplitude**2 - 2 * noise**2))), noise
