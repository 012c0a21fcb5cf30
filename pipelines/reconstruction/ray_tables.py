"""What triangulation looks up: where each pixel of both devices looks, made once per calibration."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pinhole import undistort
from .pixel_maps import Decoded
from .rig_model import Calibration, Lens

__all__ = ["LEAST_PARALLAX", "MARGIN_PX", "SLACK_PX", "RayTables", "ray_tables"]

MARGIN_PX = 2  # the projector's table reaches this far beyond its edge: sub-pixel positions may too
LEAST_PARALLAX = 0.5  # of both axes' together: an axis with less, left alone, says next to nothing of the depth
SLACK_PX = 1.0  # what calibration and blur may leave between two rays, in projector px, beside the decoding's sigma

Table = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class RayTables:
    """Undistorted coordinates of pixels, (row, column, 2): x/z and y/z of a pinhole's, x and y of an affine lens's."""

    rays: Table
    """Of each camera pixel."""
    lit: Table
    """Of each projector pixel, from -MARGIN_PX on."""


_cache: OrderedDict[str, RayTables] = OrderedDict()
_KEPT = 3


def ray_tables(decoded: Decoded, calibration: Calibration) -> RayTables:
    """Give the tables of a calibration, for a capture of the size that was calibrated.

    Raises
    ------
    ValueError
        If the images' size is another one: the kernels index the tables by the images' pixels.
    """
    columns, rows = calibration.camera.size
    if decoded.column.shape != (rows, columns):
        raise ValueError(
            f"images of {decoded.column.shape[1]}x{decoded.column.shape[0]}, but the calibration is for "
            f"{columns}x{rows}: use the camera settings of the calibration, or calibrate again"
        )
    key = calibration.id
    if key not in _cache:
        _cache[key] = RayTables(_undistorted(calibration.camera, 0), _undistorted(calibration.projector, MARGIN_PX))
        while len(_cache) > _KEPT:
            _cache.popitem(last=False)
    _cache.move_to_end(key)
    return _cache[key]


def _undistorted(lens: Lens, margin: int) -> Table:
    columns = np.arange(-margin, lens.size[0] + margin, dtype=np.float64)
    table = np.empty((lens.size[1] + 2 * margin, len(columns), 2), np.float32)
    block = max(1, 200_000 // len(columns))
    for first in range(0, len(table), block):  # in blocks: the intermediates stay in the processor's cache
        rows = np.arange(first, min(first + block, len(table))) - float(margin)
        table[first : first + block] = undistort(lens, np.stack(np.meshgrid(columns, rows), axis=-1))
    return table
