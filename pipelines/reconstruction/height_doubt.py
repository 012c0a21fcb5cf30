"""What a calibration leaves open of heights, carried from its coarse map over the image to points and cells."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..slabs import in_slabs
from .pinhole import Floats, project
from .pixel_maps import PointMap
from .rig_model import Calibration

__all__ = ["add_rows", "bow_mm", "doubt_mm", "doubt_of_cells", "doubt_on", "with_doubt"]

NODES = 17  # per axis of a grid: what is told there varies slowly
LEAST = 1e-2  # of a point's sigma: what is left of it at least where nearly all of it is the calibration's

Map = npt.NDArray[np.float32]


def doubt_mm(calibration: Calibration) -> Map:
    """Standard uncertainty (rows, columns) of heights by the calibration alone, mm, at nodes spread over the image.

    Offset and tilt of the whole field aside: one smooth error, the same in every scan, so no mean makes it less. The
    first and last nodes lie on the outermost pixels. 0 where the calibration does not tell; one from before it had a
    map tells one value.
    """
    field = (calibration.sigma or {}).get("field", {})
    told = field.get("map_um") or [[field.get("bow_image_um") or 0.0]]
    coarse = np.array(told, dtype=np.float32) / 1000
    return np.ascontiguousarray(np.broadcast_to(coarse, np.maximum(coarse.shape, 2)))


def bow_mm(calibration: Calibration) -> float:
    """Root mean square of `doubt_mm` over the image, for who needs one number; 0 if not known."""
    return float(np.sqrt(np.mean(np.square(doubt_mm(calibration), dtype=np.float64))))


def with_doubt(points: PointMap, calibration: Calibration) -> PointMap:
    """Add what the calibration leaves open to ``sigma_z``, in place: the points are just made, nobody else has them."""
    _add(points.sigma_z, doubt_mm(calibration), 1.0, points.sigma_z)
    return points


def doubt_of_cells(sigma: Map, grid: Grid, calibration: Calibration) -> None:
    """Add what the calibration leaves open to the sigma (rows, columns) of cells, in place."""
    _add(sigma, doubt_on(grid, calibration), 1.0, sigma)


def doubt_on(grid: Grid, calibration: Calibration) -> Map:
    """As `doubt_mm`, at nodes spread over a grid."""
    x, y = (np.linspace(side[0], side[-1], NODES) for side in (grid.x_mm, grid.y_mm))
    site = np.stack([*np.meshgrid(x, y), np.zeros((NODES, NODES))], axis=-1)
    points = (site - calibration.reference[:, 3]) @ calibration.reference[:, :3]
    return _at(doubt_mm(calibration), project(calibration.camera, points), calibration.camera.size)


def _at(coarse: Map, pixels: Floats, size: tuple[int, int]) -> Map:
    """The map at pixels (..., 2), linear between nodes, held at the image's edge."""
    where = []
    for axis, nodes in ((1, coarse.shape[0]), (0, coarse.shape[1])):
        place = np.clip(pixels[..., axis] / (size[axis] - 1), 0, 1) * (nodes - 1)
        first = np.minimum(place.astype(np.intp), nodes - 2)
        where.append((first, place - first))
    (i, a), (j, b) = where
    upper = coarse[i, j] * (1 - b) + coarse[i, j + 1] * b
    lower = coarse[i + 1, j] * (1 - b) + coarse[i + 1, j + 1] * b
    return np.ascontiguousarray(upper * (1 - a) + lower * a, dtype=np.float32)


def _add(sigma: Map, coarse: Map, sign: float, out: Map) -> None:
    rows = len(sigma)
    in_slabs(rows, lambda first, last: add_rows(sigma[first:last], coarse, sign, out[first:last], first, rows))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_rows(sigma, coarse, sign, out, top, rows):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add (`sign` 1) or take out (-1) what the map says of some rows, the first of which is row `top` of `rows`."""
    W, nodes = sigma.shape[1], coarse.shape[1]
    high, step = np.float32(coarse.shape[0] - 1), np.float32(nodes - 1) / np.float32(max(W - 1, 1))
    line, own = np.empty(nodes, np.float32), np.empty(W, np.float32)
    begin = np.full(nodes, W, np.int64)  # first column behind each node
    for j in range(W - 1, -1, -1):
        begin[min(int(np.float32(j) * step), nodes - 2)] = j
    for m in range(nodes - 2, -1, -1):  # nodes closer than columns have none
        begin[m] = min(begin[m], begin[m + 1])
    for i in range(len(sigma)):
        place = np.float32(top + i) * high / np.float32(max(rows - 1, 1))
        k = min(int(place), coarse.shape[0] - 2)
        a = place - np.float32(k)
        for j in range(nodes):
            line[j] = coarse[k, j] * (np.float32(1) - a) + coarse[k + 1, j] * a
        for j in range(W):
            own[j] = sigma[i, j]  # `out` may be `sigma`
        for m in range(nodes - 1):
            _add_between(own, line[m], line[m + 1], np.float32(sign), step, m, begin[m], begin[m + 1], out[i])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_between(own, left, right, way, step, m, first, last, out):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """The same for the columns between two nodes: no look-up, so the compiler uses vector instructions."""
    least, one = np.float32(LEAST * LEAST), np.float32(1)
    for j in range(first, last):
        b = np.float32(j) * step - np.float32(m)
        doubt = left * (one - b) + right * b
        s = own[j] * own[j]
        out[j] = np.sqrt(max(s + way * doubt * doubt, least * s))  # NaN stays NaN
