"""Roughness of a surface after ISO 25178-2: its filters (S, F, L), its parameters, and what noise makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .roughness_kernels import gaussian_mean, moments, power_sums, without_form
from .values import Measurement

__all__ = ["ROUGHNESS", "Filters", "filtered", "height_parameters", "roughness"]

Floats = npt.NDArray[np.float64]

GAUSSIAN = float(np.sqrt(np.log(2) / np.pi) / np.sqrt(2 * np.pi))
"""Standard deviation of the Gaussian weighting over its nesting index, which it passes by half (ISO 16610-61)."""
DRAWS = 4
"""Draws of the scan's own noise that tell what it does to a parameter."""
DECAY = 0.2
"""Of the autocorrelation: where Sal and Str are read (ISO 25178-3's default)."""
CORE = 0.4
"""Share of the material that the secant of the core spans (ISO 25178-2, 13565-2)."""
LEAST_CELLS = 100
DRAWN_CELLS = 256
"""Side of the part of a map on which noise is drawn for its height parameters: what it does to a mean is told there."""

ROUGHNESS: Mapping[str, tuple[str, str]] = {
    "Sa": ("mm", "arithmetical mean height"),
    "Sq": ("mm", "root mean square height"),
    "Ssk": ("1", "skewness of the heights"),
    "Sku": ("1", "kurtosis of the heights, 3 for a normal distribution"),
    "Sp": ("mm", "highest peak above the mean"),
    "Sv": ("mm", "deepest pit below the mean"),
    "Sz": ("mm", "Sp + Sv"),
    "Sdq": ("1", "root mean square slope"),
    "Sdr": ("1", "developed area over projected area, less 1"),
    "Sal": ("mm", "shortest distance at which the autocorrelation falls to 0.2"),
    "Str": ("1", "Sal over the longest such distance: 1 looks alike in all directions"),
    "Sk": ("mm", "height of the core of the material ratio curve"),
    "Spk": ("mm", "reduced height of the peaks above the core"),
    "Svk": ("mm", "reduced depth of the dales below the core"),
    "Smr1": ("1", "material ratio where the peaks end"),
    "Smr2": ("1", "material ratio where the dales begin"),
}
"""Unit and meaning of each parameter."""


@dataclass(frozen=True, slots=True)
class Filters:
    """What is taken away before parameters are read; it travels with every value.

    Parameters
    ----------
    s_mm, l_mm : float or None
        Nesting indices of the S-filter (finer structure goes) and of the L-filter (coarser goes); None: not used.
    form : int
        Order of the polynomial that the F-operation takes out: 0 the mean, 1 a plane, 2 a second-order surface.
    """

    s_mm: float | None = None
    l_mm: float | None = None
    form: int = 1

    def __post_init__(self) -> None:
        for name, value in (("S-filter", self.s_mm), ("L-filter", self.l_mm)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"the {name}'s nesting index must be above 0 mm, not {value}")
        if self.s_mm is not None and self.l_mm is not None and self.s_mm >= self.l_mm:
            raise ValueError(f"the S-filter ({self.s_mm:g} mm) must be finer than the L-filter ({self.l_mm:g} mm)")
        if self.form not in (0, 1, 2):
            raise ValueError(f"the form is of order 0, 1 or 2, not {self.form}")

    def __str__(self) -> str:
        form = ("mean", "plane", "second-order surface")[self.form]
        s = f"S {self.s_mm:g} mm" if self.s_mm else "no S"
        coarse = f"L {self.l_mm:g} mm" if self.l_mm else "no L"
        return f"{s}, F {form}, {coarse} (Gaussian regression, ISO 16610-61/-71)"


def filtered(height: Floats, pitch_mm: float, filters: Filters) -> Floats:
    """Give the scale-limited surface: S-filter, F-operation, L-filter, in this order.

    Parameters
    ----------
    height : ndarray of float64, shape (rows, columns)
        mm; NaN where not measured, and so it stays.
    pitch_mm : float
    filters : Filters

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        mm, with a mean of 0. Filters are Gaussian regressions of order 0: means over the measured cells within the
        Gaussian, so that neither borders nor missing cells pull.
    """
    surface = height if filters.s_mm is None else gaussian_mean(height, GAUSSIAN * filters.s_mm / pitch_mm)
    surface = _formless(surface, filters.form)
    if filters.l_mm is not None:
        surface = surface - gaussian_mean(surface, GAUSSIAN * filters.l_mm / pitch_mm)
        surface -= np.nanmean(surface)
    return surface


def _formless(surface: Floats, order: int) -> Floats:
    """Take out the polynomial of least squares: its normal equations are sums of products of powers of x and y."""
    x, y = (np.linspace(-0.5, 0.5, n) ** np.arange(2 * order + 1)[:, None] for n in surface.shape[::-1])
    known, heights = moments(surface, x, y)
    terms = [(j, i) for i in range(order + 1) for j in range(order + 1 - i)]
    normal = np.array([[known[j + b, i + a] for b, a in terms] for j, i in terms])
    solved = np.linalg.lstsq(normal, np.array([heights[term] for term in terms]), rcond=None)[0]
    factors = np.zeros((order + 1, order + 1))
    for term, factor in zip(terms, solved.tolist(), strict=True):
        factors[term] = factor
    return without_form(surface, factors, x[: order + 1], y[: order + 1])


def roughness(
    height: npt.NDArray[np.floating],
    pitch_mm: float,
    filters: Filters,
    sigma: npt.NDArray[np.floating] | None = None,
) -> dict[str, Measurement]:
    """Measure the parameters of `ROUGHNESS`.

    Parameters
    ----------
    height : ndarray of float, shape (rows, columns)
        mm, NaN where not measured.
    pitch_mm : float
    filters : Filters
    sigma : ndarray of float, shape (rows, columns), optional
        Standard uncertainty of the heights, mm.

    Returns
    -------
    dict of str to Measurement
        The standard uncertainty is what noise of `sigma`, independent from cell to cell, does to the value, its bias
        included (noise makes every surface rougher): root mean square over draws, for the extremes Sp, Sv and Sz at
        least that. NaN without sigma. A value is NaN
        where it is not defined: Sal and Str where the autocorrelation does not fall to 0.2 within the map.

    Raises
    ------
    ValueError
        If fewer than 100 cells are measured.
    """
    z = np.asarray(height, dtype=np.float64)
    if np.isfinite(z).sum() < LEAST_CELLS:
        raise ValueError(f"only {int(np.isfinite(z).sum())} cells are measured, roughness needs {LEAST_CELLS}")
    found = _parameters(filtered(z, pitch_mm, filters), pitch_mm)
    if sigma is None or not np.isfinite(sigma).any():
        return {name: Measurement(value, float("nan")) for name, value in found.items()}
    random = np.random.default_rng(0)  # a fixed seed: the same scan always gives the same answer
    noise = np.nan_to_num(np.asarray(sigma, dtype=np.float64))
    off = []
    for _ in range(DRAWS):
        drawn = _parameters(filtered(z + noise * random.normal(size=z.shape), pitch_mm, filters), pitch_mm)
        off.append([drawn[name] - found[name] for name in found])
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    return {name: Measurement(value, float(each)) for (name, value), each in zip(found.items(), spread, strict=True)}


def height_parameters(
    height: npt.NDArray[np.floating], pitch_mm: float, filters: Filters, sigma: npt.NDArray[np.floating]
) -> dict[str, Measurement]:
    """Measure Sa, Sq, Ssk, Sku, Sp, Sv and Sz alone, fast enough for every scan.

    Parameters
    ----------
    height, sigma : ndarray of float, shape (rows, columns)
        mm, NaN where not measured.
    pitch_mm : float
    filters : Filters

    Returns
    -------
    dict of str to Measurement
        As `roughness` gives them, but that noise is drawn on the middle of the map; NaN with fewer than 100 cells.
    """
    z = np.asarray(height, dtype=np.float64)
    if np.isfinite(z).sum() < LEAST_CELLS:
        return dict.fromkeys(("Sa", "Sq", "Ssk", "Sku", "Sp", "Sv", "Sz"), Measurement(float("nan"), float("nan")))
    found = _heights(filtered(z, pitch_mm, filters))
    middle = tuple(slice(max(0, (n - DRAWN_CELLS) // 2), (n + DRAWN_CELLS) // 2) for n in z.shape)
    part = z[middle] if np.isfinite(z[middle]).sum() >= LEAST_CELLS else z
    noise = np.nan_to_num(np.asarray(sigma, dtype=np.float64)[middle] if part is not z else sigma)
    random = np.random.default_rng(0)
    still = _heights(filtered(part, pitch_mm, filters))
    off = []
    for _ in range(DRAWS):
        drawn = _heights(filtered(part + noise * random.normal(size=part.shape), pitch_mm, filters))
        off.append([drawn[name] - still[name] for name in still])
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    return {name: Measurement(value, float(each)) for (name, value), each in zip(found.items(), spread, strict=True)}


def _heights(surface: Floats) -> dict[str, float]:
    count, sizes, squares, cubes, fourths, top, bottom = power_sums(surface)
    sq = float(np.sqrt(squares / count))
    flat = sq <= 1e-12
    return {
        "Sa": sizes / count,
        "Sq": sq,
        "Ssk": cubes / count / sq**3 if not flat else float("nan"),
        "Sku": fourths / count / sq**4 if not flat else float("nan"),
        "Sp": top,
        "Sv": -bottom,
        "Sz": top - bottom,
    }


def _parameters(surface: Floats, pitch_mm: float) -> dict[str, float]:
    heights = _heights(surface)
    flat = heights["Sq"] <= 1e-12
    steep = _slope(surface, pitch_mm, 0) ** 2 + _slope(surface, pitch_mm, 1) ** 2
    steep = steep[np.isfinite(steep)]
    sal, longest = _autocorrelation(surface, pitch_mm) if not flat else (float("nan"), float("nan"))
    return {
        **heights,
        "Sdq": float(np.sqrt(steep.mean())) if steep.size else float("nan"),
        "Sdr": float(np.sqrt(1 + steep).mean() - 1) if steep.size else float("nan"),
        "Sal": sal,
        "Str": sal / longest,
        **_material_ratio(surface[np.isfinite(surface)]),
    }


def _slope(surface: Floats, pitch_mm: float, axis: int) -> Floats:
    """Slope along an axis by the seven-point formula of ISO 4287; NaN where one of the seven is missing."""
    slope = np.full(surface.shape, np.nan)
    count = surface.shape[axis]
    if count < 7:
        return slope

    def beside(cells: int) -> Floats:
        return np.take(surface, range(3 + cells, count - 3 + cells), axis)

    middle = (slice(3, -3), slice(None)) if axis == 0 else (slice(None), slice(3, -3))
    steps = 45 * (beside(1) - beside(-1)) - 9 * (beside(2) - beside(-2)) + beside(3) - beside(-3)
    slope[middle] = steps / (60 * pitch_mm)
    return slope


def _autocorrelation(surface: Floats, pitch_mm: float) -> tuple[float, float]:
    """Shortest and longest distance, mm, from the middle to where the autocorrelation's middle part falls to DECAY."""
    from scipy import fft

    known = np.isfinite(surface)
    shape = [fft.next_fast_len(2 * n - 1, real=True) for n in surface.shape]
    sums = fft.irfft2(np.abs(fft.rfft2(np.where(known, surface, 0.0), shape)) ** 2, shape)
    pairs = fft.irfft2(np.abs(fft.rfft2(known.astype(np.float64), shape)) ** 2, shape)
    likeness = np.where(pairs > 0.5, sums / np.maximum(pairs, 1), 0.0)
    likeness = fft.fftshift(likeness / likeness[0, 0])
    middle = shape[0] // 2, shape[1] // 2
    # beyond half of the map too few pairs are left
    half = [n // 2 for n in surface.shape]
    part = likeness[middle[0] - half[0] : middle[0] + half[0] + 1, middle[1] - half[1] : middle[1] + half[1] + 1]
    labels, _ = ndimage.label(part >= DECAY)
    lobe = labels == labels[half[0], half[1]]
    if lobe[[0, -1]].any() or lobe[:, [0, -1]].any():
        return float("nan"), float("nan")
    angles = np.linspace(0, np.pi, 180, endpoint=False)
    radii = np.arange(0, max(half), 0.1)
    rows = half[0] + radii * np.sin(angles)[:, None]
    columns = half[1] + radii * np.cos(angles)[:, None]
    along = ndimage.map_coordinates(part, [rows, columns], order=1, cval=0.0)
    reach = radii[np.argmax(along < DECAY, axis=1)] * pitch_mm
    return float(reach.min()), float(reach.max())


def _material_ratio(z: Floats) -> dict[str, float]:
    """The core of the material ratio curve: its least steep secant over 40 %, and the triangles above and below."""
    curve = np.sort(z)[::-1]
    span = max(1, round(CORE * (curve.size - 1)))
    falls = curve[:-span] - curve[span:]
    start = int(np.argmin(falls))
    slope = float(falls[start]) / span
    top = float(curve[start]) + slope * start
    bottom = top - slope * (curve.size - 1)
    first, last = int((curve > top).sum()), int((curve >= bottom).sum())
    peaks = float((curve[:first] - top).sum())
    dales = float((bottom - curve[last:]).sum())
    return {
        "Sk": top - bottom,
        "Spk": 2 * peaks / first if first else 0.0,
        "Svk": 2 * dales / (curve.size - last) if last < curve.size else 0.0,
        "Smr1": first / curve.size,
        "Smr2": last / curve.size,
    }
