"""Projector positions to 3D points: camera-ray and projector tables once per calibration, one fused pass per scan."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .clean_kernels import take_points
from .height_doubt import add_rows, doubt_mm, with_doubt
from .pinhole import undistort
from .pixel_maps import Decoded, PointMap
from .ray_kernels import MARGIN_PX, map_points, plane_points
from .rig_model import Calibration
from .slabs import in_slabs
from .triangulate_parallel import triangulate_parallel

__all__ = ["triangulate", "triangulate_bands"]

Planes = npt.NDArray[np.float32]

LEAST_PARALLAX = 0.5  # of both axes' together: an axis with less, left alone, says next to nothing of the depth


@dataclass(frozen=True, slots=True, eq=False)
class _Tables:
    rays: npt.NDArray[np.float32]
    """(row, column, 2): x/z and y/z of each camera pixel, distortion taken out."""
    lit: npt.NDArray[np.float32]
    """(row, column, 2): the same of each projector pixel, from -MARGIN_PX on."""


_cache: OrderedDict[str, _Tables] = OrderedDict()
_KEPT = 3


def triangulate(decoded: Decoded, calibration: Calibration) -> PointMap:
    """Give each decoded camera pixel its point in space.

    Each decoded axis is one linear equation for the distance along the camera's ray; both together are solved by least
    squares, weighted by the sigma of each axis, so the axis along the baseline decides and the other one helps and
    checks: where the two rays pass each other by more than decoding and calibration explain, the pixel is rejected.
    A missing axis is taken from where the ray falls, by iteration. A pixel that lost the axis which carries the
    parallax is rejected: its rays are nearly parallel, and what is left puts it anywhere.

    Parameters
    ----------
    decoded : Decoded
    calibration : Calibration
        Of the same image size.

    Returns
    -------
    PointMap
        ``sigma_z`` is the decoding's sigma carried through the geometry, and what the calibration leaves open beside
        (`doubt_mm`).

    Raises
    ------
    ValueError
        If the images' size is not the one that was calibrated.
    """
    if calibration.camera.parallel or calibration.projector.parallel:
        return triangulate_parallel(decoded, calibration)
    by_row, fixed = _kernel_input(decoded, calibration)
    rows, columns = decoded.column.shape
    xyz = np.empty((rows, columns, 3), np.float32)
    sigma_z = np.empty((rows, columns), np.float32)
    projector = np.empty((rows, columns, 2), np.float32)
    level = np.empty((rows, columns), np.uint8)

    def slab(first: int, last: int) -> None:
        out = (array[first:last] for array in (decoded.level, xyz, sigma_z, projector, level))
        map_points(*(array[first:last] for array in by_row), *fixed, *out)

    in_slabs(rows, slab)
    return with_doubt(PointMap(xyz, sigma_z, projector, level, decoded.texture), calibration)


def triangulate_bands(decoded: Decoded, calibration: Calibration) -> Callable[[int, int, Planes], None]:
    """Prepare what `triangulate` does, band by band, for who needs no map of all points.

    Returns
    -------
    callable
        Called with the first image row, the one after the last, and an array of float32, (4, row, column), it writes
        x, y, z and sigma_z of these rows there.

    Raises
    ------
    ValueError
        As `triangulate`.
    """
    if calibration.camera.parallel or calibration.projector.parallel:
        points = triangulate_parallel(decoded, calibration)
        return lambda first, last, planes: take_points(points.xyz[first:last], points.sigma_z[first:last], planes)
    by_row, fixed = _kernel_input(decoded, calibration)
    coarse, rows = doubt_mm(calibration), len(decoded.column)

    def band(first: int, last: int, planes: Planes) -> None:
        plane_points(*(array[first:last] for array in by_row), *fixed, planes)
        add_rows(planes[3], coarse, 1.0, planes[3], first, rows)

    return band


def _kernel_input(decoded: Decoded, calibration: Calibration) -> tuple[tuple[Planes, ...], tuple[Any, ...]]:
    """Arrays with a row per image row, and what is the same for all rows."""
    columns, rows = calibration.camera.size
    if decoded.column.shape != (rows, columns):
        raise ValueError(
            f"images of {decoded.column.shape[1]}x{decoded.column.shape[0]}, but the calibration is for "
            f"{columns}x{rows}: use the camera settings of the calibration, or calibrate again"
        )
    tables = _tables(calibration)
    P = calibration.projector
    lens = np.array([P.K[0, 0], P.K[1, 1], P.K[0, 2], P.K[1, 2], *P.dist])
    least = LEAST_PARALLAX if _any_known(decoded.column) and _any_known(decoded.row) else 0.0
    by_row = (decoded.column, decoded.row, decoded.sigma_column, decoded.sigma_row, tables.rays)
    return by_row, (tables.lit, calibration.R, calibration.t_mm, lens, least)


def _any_known(place: npt.NDArray[np.float32]) -> bool:
    return any(not np.isnan(line).all() for line in place)  # most often the first line answers


def _tables(calibration: Calibration) -> _Tables:
    key = calibration.id
    if key in _cache:
        _cache.move_to_end(key)
        return _cache[key]
    rays = _undistorted(calibration.camera.size, calibration, 0)
    made = _Tables(rays, _undistorted(calibration.projector.size, calibration, MARGIN_PX))
    _cache[key] = made
    while len(_cache) > _KEPT:
        _cache.popitem(last=False)
    return made


def _undistorted(size: tuple[int, int], calibration: Calibration, margin: int) -> npt.NDArray[np.float32]:
    lens = calibration.projector if margin else calibration.camera
    columns = np.arange(-margin, size[0] + margin, dtype=np.float64)
    table = np.empty((size[1] + 2 * margin, len(columns), 2), np.float32)
    block = max(1, 200_000 // len(columns))
    for first in range(0, len(table), block):  # in blocks: the intermediates stay in the processor's cache
        rows = np.arange(first, min(first + block, len(table))) - float(margin)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
        table[first : first + block] = undistort(lens, pixels)
    return table
