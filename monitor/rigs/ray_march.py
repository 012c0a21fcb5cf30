"""What each camera pixel looks at: rays marched through a height field, and on to the projector for shadows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from .optics_model import Optics

__all__ = ["View", "look"]

Field = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Per camera pixel, arrays of float32, shape (row, column).

    `column`, `row` are where the projector's rays come from (px); `lit` is the light that a white pixel sends to the
    camera, 0 in shadow or beyond the projector; `ambient` the room's; `depth_camera`, `depth_projector` the distances
    along the axes, mm.
    """

    column: Field
    row: Field
    lit: Field
    ambient: Field
    depth_camera: Field
    depth_projector: Field


def look(
    height: Field, albedo: Field, origin_mm: tuple[float, float], pitch_mm: float, rays: Field, optics: Optics
) -> View:
    """Find what the camera's pixels see.

    Parameters
    ----------
    height, albedo : ndarray of float32, shape (y, x)
        mm and share, on a raster that goes on at its rim as it ends; bilinear between cells.
    origin_mm : (float, float)
        x, y of cell [0, 0], scene frame.
    pitch_mm : float
    rays : ndarray of float32, shape (row, column, 2)
        `Device.rays` of the camera.
    optics : Optics
        In the scene's frame (`Device.moved`).
    """
    camera, projector = optics.camera, optics.projector
    out = _look(
        height,
        albedo,
        origin_mm[0],
        origin_mm[1],
        pitch_mm,
        float(height.max()),
        float(height.min()),
        rays,
        np.ascontiguousarray(camera.R.T),
        camera.centre_mm,
        np.ascontiguousarray(camera.R),
        camera.t_mm,
        projector.R.copy(),
        projector.t_mm,
        projector.centre_mm,
        projector.lens.K,
        projector.lens.dist,
        projector.lens.size[0],
        projector.lens.size[1],
    )
    return View(*out)


@njit(cache=True, nogil=True)
def _at(field, u, v):  # type: ignore[no-untyped-def]  # numba infers
    """Bilinear; beyond the rim the rim's value."""
    rows, columns = field.shape
    u = min(max(u, 0.0), columns - 1.001)
    v = min(max(v, 0.0), rows - 1.001)
    i = int(u)
    j = int(v)
    a = u - i
    b = v - j
    low = field[j, i] + a * (field[j, i + 1] - field[j, i])
    high = field[j + 1, i] + a * (field[j + 1, i + 1] - field[j + 1, i])
    return low + b * (high - low)


@njit(cache=True, nogil=True, error_model="numpy")
def _look(height, albedo, x0, y0, pitch, top, bottom, rays, rt, centre, rc, tc, rp, tp, source, k, d, columns, rows):  # type: ignore[no-untyped-def]  # numba infers
    shape = rays.shape[:2]
    column = np.zeros(shape, np.float32)
    row = np.zeros(shape, np.float32)
    lit = np.zeros(shape, np.float32)
    ambient = np.zeros(shape, np.float32)
    depth_camera = np.zeros(shape, np.float32)
    depth_projector = np.zeros(shape, np.float32)
    span = max(top - bottom, 1e-6)
    for r in range(shape[0]):
        for c in range(shape[1]):
            xn = rays[r, c, 0]
            yn = rays[r, c, 1]
            dx = rt[0, 0] * xn + rt[0, 1] * yn + rt[0, 2]
            dy = rt[1, 0] * xn + rt[1, 1] * yn + rt[1, 2]
            dz = rt[2, 0] * xn + rt[2, 1] * yn + rt[2, 2]
            # down the ray from the highest to the lowest point of the field, half a cell at a time sideways
            sx = dx / dz
            sy = dy / dz
            su = sx / pitch  # the ray in cells: u = u0 + z su
            sv = sy / pitch
            u0 = (centre[0] - centre[2] * sx - x0) / pitch
            v0 = (centre[1] - centre[2] * sy - y0) / pitch
            steps = 2 + int(2.0 * span * np.sqrt(sx * sx + sy * sy) / pitch)
            above = top + 1e-4
            below = bottom - 1e-4
            fall = (above - below) / steps
            z = above
            for _ in range(steps):
                z -= fall
                if z < _at(height, u0 + z * su, v0 + z * sv):
                    break
            lower = z
            upper = z + fall
            for _ in range(12):  # to 1/4096 of a step: far below a micrometre
                z = 0.5 * (lower + upper)
                if z < _at(height, u0 + z * su, v0 + z * sv):
                    lower = z
                else:
                    upper = z
            x = centre[0] + (z - centre[2]) * sx
            y = centre[1] + (z - centre[2]) * sy
            u = (x - x0) / pitch
            v = (y - y0) / pitch
            zx = (_at(height, u + 0.5, v) - _at(height, u - 0.5, v)) / pitch
            zy = (_at(height, u, v + 0.5) - _at(height, u, v - 0.5)) / pitch
            steep = 1.0 / np.sqrt(1.0 + zx * zx + zy * zy)
            reflects = _at(albedo, u, v)
            ambient[r, c] = reflects * (0.4 + 0.6 * steep)
            depth_camera[r, c] = rc[2, 0] * x + rc[2, 1] * y + rc[2, 2] * z + tc[2]
            px = rp[0, 0] * x + rp[0, 1] * y + rp[0, 2] * z + tp[0]
            py = rp[1, 0] * x + rp[1, 1] * y + rp[1, 2] * z + tp[1]
            pz = rp[2, 0] * x + rp[2, 1] * y + rp[2, 2] * z + tp[2]
            depth_projector[r, c] = pz
            a = px / pz
            b = py / pz
            r2 = a * a + b * b
            radial = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))
            pc = k[0, 0] * (a * radial + 2.0 * d[2] * a * b + d[3] * (r2 + 2.0 * a * a)) + k[0, 2]
            pr = k[1, 1] * (b * radial + d[2] * (r2 + 2.0 * b * b) + 2.0 * d[3] * a * b) + k[1, 2]
            column[r, c] = pc
            row[r, c] = pr
            if pc < -0.5 or pc > columns - 0.5 or pr < -0.5 or pr > rows - 0.5:
                continue
            lx = source[0] - x
            ly = source[1] - y
            lz = source[2] - z
            far = np.sqrt(lx * lx + ly * ly + lz * lz)
            facing = (lz - zx * lx - zy * ly) * steep / far
            if facing <= 0.0:
                continue
            # up towards the projector, three quarters of a cell at a time sideways
            sideways = np.sqrt(lx * lx + ly * ly)
            stride = 0.75 * pitch / sideways
            share = stride
            shadow = False
            while z + share * lz < top:
                if _at(height, u + share * lx / pitch, v + share * ly / pitch) > z + share * lz + 1e-3:
                    shadow = True
                    break
                share += stride
            if not shadow:
                lit[r, c] = reflects * facing
    return column, row, lit, ambient, depth_camera, depth_projector
