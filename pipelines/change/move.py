"""Resample a scan on the baseline's grid after a rigid motion; missing cells stay missing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..grid import Grid
from ..scan import LEVEL_NONE, Scan
from ..slabs import in_slabs
from .motion import Motion

__all__ = ["apply_motion"]


@njit(cache=True, nogil=True)
def _resample(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    height, sigma, texture, level, inverse, matrix, place, out_height, out_sigma, out_texture, out_level, first, last
):
    x0, y0, pitch, new_x0, new_y0, new_pitch = place
    rows, columns = height.shape
    tilt = abs(inverse[0, 2]) + abs(inverse[1, 2])
    for i in range(first, last):
        y = new_y0 + i * new_pitch
        for j in range(out_height.shape[1]):
            x = new_x0 + j * new_pitch
            z = matrix[2, 3]
            found = False
            s = 0.0
            for _ in range(3):
                # where in the scan the point (x, y, z) of the baseline's frame lies; the small tilt makes it
                # depend on z, which is what we look for: each round cuts the error by the sine of the tilt
                px = inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2] * z + inverse[0, 3]
                py = inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2] * z + inverse[1, 3]
                u = (px - x0) / pitch
                v = (py - y0) / pitch
                # a shift that is a whole cell but for rounding must not ask for a neighbour it does not need
                if abs(u - round(u)) < 1e-6:
                    u = float(round(u))
                if abs(v - round(v)) < 1e-6:
                    v = float(round(v))
                a = int(np.floor(u))
                b = int(np.floor(v))
                fu = u - a
                fv = v - b
                found = False
                if a < 0 or b < 0 or a >= columns or b >= rows:
                    break
                a1 = a + 1 if fu > 0 else a
                b1 = b + 1 if fv > 0 else b
                if a1 >= columns or b1 >= rows:
                    break
                w00 = (1 - fv) * (1 - fu)
                w01 = (1 - fv) * fu
                w10 = fv * (1 - fu)
                w11 = fv * fu
                # the nearest cell decides whether this one was measured: neither grows nor shrinks what is missing
                if not np.isfinite(height[b if fv < 0.5 else b1, a if fu < 0.5 else a1]):
                    break
                found = True
                if not np.isfinite(height[b, a]):
                    w00 = 0.0
                if not np.isfinite(height[b, a1]):
                    w01 = 0.0
                if not np.isfinite(height[b1, a]):
                    w10 = 0.0
                if not np.isfinite(height[b1, a1]):
                    w11 = 0.0
                total = w00 + w01 + w10 + w11
                w00 /= total
                w01 /= total
                w10 /= total
                w11 /= total
                h = 0.0
                s = 0.0
                if w00 > 0:
                    h += w00 * height[b, a]
                    s += w00 * sigma[b, a]
                if w01 > 0:
                    h += w01 * height[b, a1]
                    s += w01 * sigma[b, a1]
                if w10 > 0:
                    h += w10 * height[b1, a]
                    s += w10 * sigma[b1, a]
                if w11 > 0:
                    h += w11 * height[b1, a1]
                    s += w11 * sigma[b1, a1]
                before = z
                z = matrix[2, 0] * px + matrix[2, 1] * py + matrix[2, 2] * h + matrix[2, 3]
                if abs(z - before) * tilt < 1e-4 * pitch:
                    break
            if not found:
                continue
            out_height[i, j] = z
            # sigma is carried, not averaged down: neighbouring cells share most of their error
            out_sigma[i, j] = s
            t = w00 * texture[b, a] + w01 * texture[b, a1] + w10 * texture[b1, a] + w11 * texture[b1, a1]
            out_texture[i, j] = np.uint8(t + 0.5)
            out_level[i, j] = level[b if fv < 0.5 else b1, a if fu < 0.5 else a1]


def apply_motion(scan: Scan, motion: Motion, grid: Grid | None = None) -> Scan:
    """Move a scan and resample it.

    Parameters
    ----------
    scan : Scan
    motion : Motion
        What `register` found.
    grid : Grid, optional
        Where to put the cells, normally the baseline's grid; the scan's own if left out.

    Returns
    -------
    Scan
        On `grid`. Heights are interpolated bilinearly over the measured neighbours; a cell is NaN where the cell
        nearest to it is NaN, so that nothing is smeared across a crack's missing floor and what is missing neither
        grows nor shrinks. A motion by none returns the scan unchanged.
    """
    grid = scan.grid if grid is None else grid
    if grid == scan.grid and np.array_equal(motion.matrix, np.eye(4)):
        return scan
    height = np.full(grid.shape, np.nan, dtype=np.float32)
    sigma = np.full(grid.shape, np.nan, dtype=np.float32)
    texture = np.zeros(grid.shape, dtype=np.uint8)
    level = np.full(grid.shape, LEVEL_NONE, dtype=np.uint8)
    source = scan.grid
    place: npt.NDArray[np.float64] = np.array(
        [source.x0_mm, source.y0_mm, source.pitch_mm, grid.x0_mm, grid.y0_mm, grid.pitch_mm]
    )
    given = scan.height, scan.sigma, scan.texture, scan.level, np.linalg.inv(motion.matrix), motion.matrix, place
    in_slabs(grid.rows, lambda first, last: _resample(*given, height, sigma, texture, level, first, last))
    return Scan(grid, scan.time, height, sigma, texture, level, scan.calibration_id)
