"""Projector positions to 3D points: one fused pass per scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs
from .clean_kernels import take_points
from .height_doubt import add_rows, doubt_mm, with_doubt
from .pixel_maps import Decoded, PointMap
from .ray_kernels import map_points, plane_points
from .ray_tables import LEAST_PARALLAX, ray_tables
from .rig_model import Calibration
from .shared_error import shared_mm2
from .triangulate_parallel import triangulate_parallel

__all__ = ["triangulate", "triangulate_bands"]

Planes = npt.NDArray[np.float32]


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
    shared = shared_mm2(decoded.shared, calibration)
    return with_doubt(PointMap(xyz, sigma_z, projector, level, decoded.texture, shared), calibration)


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
    tables = ray_tables(decoded, calibration)
    P = calibration.projector
    lens = np.array([P.K[0, 0], P.K[1, 1], P.K[0, 2], P.K[1, 2], *P.dist])
    least = LEAST_PARALLAX if _any_known(decoded.column) and _any_known(decoded.row) else 0.0
    by_row = (decoded.column, decoded.row, decoded.sigma_column, decoded.sigma_row, tables.rays)
    return by_row, (tables.lit, calibration.R, calibration.t_mm, lens, least)


def _any_known(place: npt.NDArray[np.float32]) -> bool:
    return any(not np.isnan(line).all() for line in place)  # most often the first line answers
