"""M3C2: the distance between two rasters along local normals, exact as between point clouds, and how sure it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numba
import numpy as np
import numpy.typing as npt

from .m3c2_kernels import cylinders, medians, normals

__all__ = ["Distances", "m3c2"]

Floats = npt.NDArray[np.float64]
LAGUE_95 = 1.96
"""The paper's rounded factor, as other programs have it; `difference` takes all digits."""
BAND = 16
"""Rows that one thread takes at a time: steep parts cost more than flat ones."""


@dataclass(frozen=True, slots=True, eq=False)
class Distances:
    """M3C2 per cell of the first surface; arrays of shape (rows, columns), mm, NaN where nothing is known.

    Parameters
    ----------
    distance : ndarray of float64
        Second surface less first along the normal, which points up: positive where the second lies above.
    lod : ndarray of float64
        Level of detection at 95 %: ``1.96 (sqrt(spread1^2 / n1 + spread2^2 / n2) + registration error)``.
    n1, n2 : ndarray of int32
        Points of either surface in the cylinder; 0 where there is no core.
    spread1, spread2 : ndarray of float64
        Their standard deviation along the normal, or interquartile range; NaN of a single point, as is `lod` then.
    normal : ndarray of float64, shape (rows, columns, 3)
        Unit vectors x, y, z with z > 0.
    """

    distance: Floats
    lod: Floats
    n1: npt.NDArray[np.int32]
    n2: npt.NDArray[np.int32]
    spread1: Floats
    spread2: Floats
    normal: Floats

    @property
    def significant(self) -> npt.NDArray[np.bool_]:
        """Cells whose distance exceeds its level of detection; False where nothing is known."""
        return np.abs(self.distance) > self.lod


def m3c2(
    first: npt.NDArray[np.floating[Any]],
    second: npt.NDArray[np.floating[Any]],
    pitch_mm: float,
    *,
    normal_radii_mm: Sequence[float],
    radius_mm: float,
    max_distance_mm: float,
    registration_error_mm: float = 0.0,
    statistic: Literal["mean", "median"] = "mean",
    core: npt.NDArray[np.bool_] | None = None,
    offset_mm: tuple[float, float] = (0.0, 0.0),
) -> Distances:
    """Measure from one surface to another along local normals (Lague, Brodu and Leroux 2013).

    Every measured cell is a point (x = column * pitch, y = row * pitch, z = height). At each core, the normal is the
    smallest principal axis of the first surface's points in a ball about it. In a cylinder about the normal through the
    core, the mean (median) along it of the first surface's points is taken from that of the second's.

    Parameters
    ----------
    first, second : ndarray of float, shape (rows, columns) each
        Heights, mm, NaN where not measured.
    pitch_mm : float
        Of both.
    normal_radii_mm : sequence of float
        Radii of the balls; of several, the one in which the points are most nearly planar counts at each core.
    radius_mm, max_distance_mm : float
        Radius of the cylinder, and half of its length.
    registration_error_mm : float
        What alignment leaves between the surfaces; added linearly, as the paper does.
    statistic : {"mean", "median"}
        ``median`` has the interquartile range as spread: for surfaces with gross errors.
    core : ndarray of bool, shape of `first`, optional
        Where to measure; every measured cell of the first surface if left out.
    offset_mm : (float, float)
        x and y of the second raster's first cell less the first's.

    Returns
    -------
    Distances

    Raises
    ------
    ValueError
        If a radius, a distance or the pitch is not above 0, or `core` has another shape.
    """
    lengths = {"pitch": pitch_mm, "radius": radius_mm, "max distance": max_distance_mm}
    lengths |= {f"normal radius {each:g}": each for each in normal_radii_mm}
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be above 0, not {value}")
    if not normal_radii_mm:
        raise ValueError("at least one normal radius is needed")
    if not (np.isfinite(registration_error_mm) and registration_error_mm >= 0):
        raise ValueError(f"registration error must not be below 0, not {registration_error_mm}")
    measured = np.isfinite(first)
    if core is not None and core.shape != first.shape:
        raise ValueError(f"core has shape {core.shape}, the first surface {first.shape}")
    at = measured if core is None else core & measured
    rows, columns = first.shape
    reach = int(np.ceil((max_distance_mm + radius_mm) / pitch_mm)) + 1
    pad = max(int(np.ceil(max(normal_radii_mm) / pitch_mm)) + 1, reach)
    one = _padded(first, pad)
    direction = np.empty((rows, columns, 3))
    radii = np.array(normal_radii_mm, dtype=np.float64)
    _bands(rows, lambda a, b: normals(one, pad, pitch_mm, radii, at, a, b, direction))
    kernel = cylinders if statistic == "mean" else medians
    results = []
    for other, (fx, fy) in ((first, (0.0, 0.0)), (second, offset_mm)):
        # cells of the other raster beside those of the cores: whole cells, and what is left
        column, row = round(fx / pitch_mm), round(fy / pitch_mm)
        shifted = one if other is first else _laid(other, pad, first.shape, row, column)
        shift = np.array([fy - row * pitch_mm, fx - column * pitch_mm, pad, pad], dtype=np.float64)
        count = np.empty((rows, columns), np.int32)
        level, spread = np.empty((rows, columns)), np.empty((rows, columns))

        fixed = (one, pad, pitch_mm, radius_mm, max_distance_mm, at, shifted, shift, direction)
        _bands(rows, partial(_call, kernel, fixed, (count, level, spread)))
        results.append((count, level, spread))
    (n1, level1, spread1), (n2, level2, spread2) = results
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.sqrt(spread1**2 / n1 + spread2**2 / n2)
    lod = LAGUE_95 * (error + registration_error_mm)
    return Distances(level2 - level1, lod, n1, n2, spread1, spread2, direction)


def _call(kernel: Callable[..., object], given: tuple[Any, ...], out: tuple[Any, ...], first: int, last: int) -> None:
    kernel(*given, first, last, *out)


def _padded(heights: npt.NDArray[np.floating[Any]], pad: int) -> Floats:
    return np.pad(heights.astype(np.float64), pad, constant_values=np.nan)


def _laid(heights: npt.NDArray[np.floating[Any]], pad: int, shape: tuple[int, int], row: int, column: int) -> Floats:
    """A raster laid over another's padded one, begun that many cells later; what lies beyond is cut off."""
    whole = np.full((shape[0] + 2 * pad, shape[1] + 2 * pad), np.nan)
    top, left = pad + row, pad + column
    r0, c0 = max(0, -top), max(0, -left)
    r1, c1 = min(heights.shape[0], whole.shape[0] - top), min(heights.shape[1], whole.shape[1] - left)
    if r1 > r0 and c1 > c0:
        whole[top + r0 : top + r1, left + c0 : left + c1] = heights[r0:r1, c0:c1]
    return whole


def _bands(rows: int, work: Callable[[int, int], object]) -> None:
    """Call ``work(first, last)`` on bands that together are all rows, in a thread per core.

    The kernels let go of the interpreter's lock, and write nothing outside of their rows.
    """
    cores = max(1, min(int(numba.config.NUMBA_NUM_THREADS), rows // BAND))
    starts = range(0, rows, BAND)
    with ThreadPoolExecutor(cores) as pool:
        for done in [pool.submit(work, first, min(first + BAND, rows)) for first in starts]:
            done.result()
