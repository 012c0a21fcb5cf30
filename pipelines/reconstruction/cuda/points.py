"""Points on the card: triangulation, what the calibration leaves open, pixels on no surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numba import cuda, float32

from ...scan import LEVEL_NONE
from ..clean_kernels import _on_no_surface
from ..height_doubt import LEAST
from ..pixel_maps import Decoded, PointMap, Shared
from ..ray_kernels import _from_one_axis, _points_of_line
from ..ray_tables import LEAST_PARALLAX, ray_tables
from ..rig_model import Calibration
from .card import OnCard, cached, clear, empty, kernel, launch, pixelwise, up
from .place import Placed

__all__ = ["Sight", "add_doubt", "drop_mixed", "planes_of", "point_map", "sight_of", "triangulate"]

_points_of_pixel = pixelwise(_points_of_line, BLOCK=1)


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What triangulation by two pinholes is given, on the card; as `ray_kernels` takes it."""

    rays: OnCard
    lit: OnCard
    R: OnCard
    t: OnCard
    lens: OnCard
    least: float

    @property
    def all(self) -> tuple[Any, ...]:
        """In the kernels' order."""
        return self.rays, self.lit, self.R, self.t, self.lens, self.least


def sight_of(placed: Placed, calibration: Calibration) -> Sight:
    """Bring a calibration's tables to the card, where they stay for the next capture.

    Raises
    ------
    ValueError
        If the images' size is not the one that was calibrated.
    """
    tables = ray_tables(cast(Decoded, placed), calibration)  # of which it asks for the size alone
    P = calibration.projector
    lens = np.array([P.K[0, 0], P.K[1, 1], P.K[0, 2], P.K[1, 2], *P.dist])
    given = tables.rays, tables.lit, calibration.R, calibration.t_mm, lens
    rays, lit, R, t, lens = cached(calibration.id, lambda: [up(each) for each in given])
    known = clear(2, np.int32)
    for n, place in enumerate((placed.column, placed.row)):
        launch(_any_known, place.size, place.reshape(place.size), n, known)
    least = LEAST_PARALLAX if known.copy_to_host().all() else 0.0
    return Sight(rays, lit, R, t, lens, least)


def triangulate(placed: Placed, sight: Sight) -> OnCard:
    """Give x, y, z (camera frame) and sigma of all pixels, (4, row, column), without the calibration's doubt."""
    planes = empty((4, *placed.column.shape), np.float32)
    launch(
        _triangulate, placed.column.size,
        placed.column, placed.row, placed.sigma_column, placed.sigma_row, *sight.all, planes,
    )  # fmt: skip
    return planes


def planes_of(points: PointMap) -> OnCard:
    """Bring a point map to the card as planes, (4, row, column)."""
    planes = empty((4, *points.sigma_z.shape), np.float32)
    launch(_take, points.sigma_z.size, up(points.xyz), up(points.sigma_z), planes)
    return planes


def add_doubt(sigma: OnCard, coarse: Any, sign: float) -> None:
    """As `height_doubt.add_rows`, in place, of the whole image or grid."""
    launch(_doubt, sigma.size, sigma, up(coarse), sign)


def drop_mixed(planes: OnCard) -> None:
    """As `clean.reject_mixed`: z and sigma of pixels on no surface become NaN."""
    size = planes[0].size
    mixed = empty(size, np.uint8)
    launch(_mixed, size, planes, mixed)
    launch(_forget, size, planes, mixed)


def point_map(planes: OnCard, placed: Placed, sight: Sight, texture: Any, shared: Shared) -> PointMap:
    """Bring the points back as `PointMap` keeps them."""
    rows, columns = placed.column.shape
    xyz, projector = empty((rows, columns, 3), np.float32), empty((rows, columns, 2), np.float32)
    level = empty((rows, columns), np.uint8)
    launch(
        _map, level.size, placed.column, placed.row, placed.sigma_column, placed.sigma_row, *sight.all,
        placed.level, planes, xyz, projector, level,
    )  # fmt: skip
    sigma = planes[3].copy_to_host()
    return PointMap(xyz.copy_to_host(), sigma, projector.copy_to_host(), level.copy_to_host(), texture, shared)


@kernel
def _any_known(place, which, known):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(cuda.grid(1), place.size, cuda.gridsize(1)):
        if place[n] == place[n] and known[which] == 0:  # NaN is not itself
            known[which] = 1


@kernel
def _triangulate(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, rays, lit, R, t, lens, least, planes
):
    W = column.shape[1]
    for n in range(cuda.grid(1), column.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        block = cuda.local.array(8, float32)
        _points_of_pixel(
            column[i, j : j + 1], row[i, j : j + 1], sigma_column[i, j : j + 1], sigma_row[i, j : j + 1],
            rays[i, j : j + 1], lit, R, t, lens, least, block,
            planes[0, i, j : j + 1], planes[1, i, j : j + 1], planes[2, i, j : j + 1], planes[3, i, j : j + 1],
        )  # fmt: skip


@kernel
def _take(xyz, sigma, planes):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = sigma.shape[1]
    for n in range(cuda.grid(1), sigma.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        for axis in range(3):
            planes[axis, i, j] = xyz[i, j, axis]
        planes[3, i, j] = sigma[i, j]


@kernel
def _doubt(sigma, coarse, sign):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    H, W = sigma.shape
    high, wide = np.float32(coarse.shape[0] - 1), np.float32(coarse.shape[1] - 1)
    least, way, one = np.float32(LEAST * LEAST), np.float32(sign), np.float32(1)
    for n in range(cuda.grid(1), sigma.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        place = np.float32(i) * high / np.float32(max(H - 1, 1))
        k = min(int(place), coarse.shape[0] - 2)
        a = place - np.float32(k)
        place = np.float32(j) * (wide / np.float32(max(W - 1, 1)))
        m = min(int(place), coarse.shape[1] - 2)
        b = place - np.float32(m)
        left = coarse[k, m] * (one - a) + coarse[k + 1, m] * a
        right = coarse[k, m + 1] * (one - a) + coarse[k + 1, m + 1] * a
        doubt = left * (one - b) + right * b
        s = sigma[i, j] * sigma[i, j]
        if s == s:
            sigma[i, j] = np.sqrt(max(s + way * doubt * doubt, least * s))


@kernel
def _mixed(planes, mixed):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    x, y, z, s = planes[0], planes[1], planes[2], planes[3]
    W = z.shape[1]
    for n in range(cuda.grid(1), mixed.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        mixed[n] = 1 if s[i, j] > 0 and _on_no_surface(x, y, z, s, i, j) else 0


@kernel
def _forget(planes, mixed):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = planes.shape[2]
    for n in range(cuda.grid(1), mixed.size, cuda.gridsize(1)):
        if mixed[n]:
            planes[2, n // W, n % W] = np.float32(np.nan)
            planes[3, n // W, n % W] = np.float32(np.nan)


@kernel
def _map(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    column, row, sigma_column, sigma_row, rays, lit, R, t, lens, least, level_in, planes, xyz, projector, level
):
    """As `ray_kernels.map_points` hands over."""
    W = column.shape[1]
    nan = np.float32(np.nan)
    for n in range(cuda.grid(1), column.size, cuda.gridsize(1)):
        i, j = n // W, n % W
        c, r = column[i, j], row[i, j]
        good = planes[2, i, j] == planes[2, i, j]
        for axis in range(3):
            xyz[i, j, axis] = planes[axis, i, j] if good else nan
        if good and not (c == c and r == r):
            _, _, c, r = _from_one_axis(
                c, r, sigma_column[i, j], sigma_row[i, j], rays[i, j, 0], rays[i, j, 1], lit, R, t, lens, least
            )
        projector[i, j, 0] = c if good else nan
        projector[i, j, 1] = r if good else nan
        found = np.uint8(0) if level_in[i, j] == LEVEL_NONE else level_in[i, j]  # one axis was enough
        level[i, j] = found if good else np.uint8(LEVEL_NONE)
