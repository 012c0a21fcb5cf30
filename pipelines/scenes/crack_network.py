"""CrackNetwork: bent edges of a Voronoi diagram, with closed-form distance to the nearest centre line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from .scene import Array

__all__ = ["CentreLines", "CrackNetwork"]


@dataclass(frozen=True, slots=True, eq=False)
class CentreLines:
    """Pieces of crack: their middles, lengths and unit normals, each of shape (n,), mm."""

    x_mm: Array
    y_mm: Array
    length_mm: Array
    normal_x: Array
    normal_y: Array


@dataclass(frozen=True, slots=True, eq=False)
class CrackNetwork:
    """Cracks between plates, each plate the Voronoi cell of one seed, in bent coordinates.

    Parameters
    ----------
    seeds : ndarray of float64, shape (n, 2)
        One per plate, mm, bent coordinates.
    bend_mm, bend_wavelength_mm : float
        Amplitude and wavelength of the two waves by which the places are displaced before the (straight) Voronoi edges
        are measured: cracks are not straight. The distance is therefore right to first order in
        2 pi bend / wavelength.
    """

    seeds: Array
    bend_mm: float = 0.14
    bend_wavelength_mm: float = 3.7

    def distance(self, x_mm: Array, y_mm: Array) -> Array:
        """Distance to the nearest centre line, mm, shape of the places.

        The smallest distance to a bisector between the nearest seed and another one is the exact distance to the
        edges of a Voronoi diagram.
        """
        u, v = self._bent(np.asarray(x_mm, np.float64), np.asarray(y_mm, np.float64))
        flat = _distance_to_edges(np.ravel(u), np.ravel(v), self.seeds)
        shaped: Array = flat.reshape(u.shape)
        return shaped

    def plate(self, x_mm: Array, y_mm: Array) -> npt.NDArray[np.intp]:
        """Number of the plate (row of `seeds`) that holds each place, shape of the places."""
        from scipy.spatial import cKDTree

        u, v = self._bent(np.asarray(x_mm, np.float64), np.asarray(y_mm, np.float64))
        number: npt.NDArray[np.intp] = cKDTree(self.seeds).query(np.stack([u, v], axis=-1))[1]
        return number

    def lines(self, region_mm: tuple[float, float, float, float], step_mm: float = 0.01) -> CentreLines:
        """Walk along the centre lines inside a region, in pieces of about `step_mm`."""
        from scipy.spatial import Voronoi

        far = 1e3 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], np.float64)  # makes every ridge near us finite
        diagram = Voronoi(np.concatenate([self.seeds, far]))
        x_min, x_max, y_min, y_max = region_mm
        reach = 4 * max(abs(side) for side in region_mm)
        walked = [np.empty((5, 0))]
        for ends in diagram.ridge_vertices:
            if -1 in ends:
                continue
            start, stop = (np.clip(diagram.vertices[end], -1e4, 1e4) for end in ends)
            if not np.isfinite([start, stop]).all():
                continue
            pieces = int(np.ceil(np.hypot(*(stop - start)) / step_mm)) + 1
            places = start + np.linspace(0, 1, pieces + 1)[:, None] * (stop - start)
            places = places[(np.abs(places) < reach).all(axis=1)]
            if len(places) < 2:
                continue
            x, y = self._straight(places[:, 0], places[:, 1])
            xm, ym = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
            inside = (xm > x_min) & (xm < x_max) & (ym > y_min) & (ym < y_max)
            dx, dy = np.diff(x), np.diff(y)
            length = np.hypot(dx, dy)
            walked.append(np.stack([xm, ym, length, -dy / length, dx / length])[:, inside])
        return CentreLines(*np.concatenate(walked, axis=1))

    def stretch(self, lines: CentreLines, aside_mm: float = 0.02) -> Array:
        """`distance` per mm of true distance beside each piece of the lines: 1 where the bend does nothing."""
        across = np.zeros(lines.x_mm.size)
        for side in (-aside_mm, aside_mm):
            across += self.distance(lines.x_mm + side * lines.normal_x, lines.y_mm + side * lines.normal_y)
        stretch: Array = across / (2 * aside_mm)
        return stretch

    def _bent(self, x: Array, y: Array) -> tuple[Array, Array]:
        k = 2 * np.pi / self.bend_wavelength_mm
        a = self.bend_mm
        u = x + a * np.sin(k * y + 0.7) + 0.4 * a * np.sin(2.3 * k * y + 0.31 * k * x + 2.0)
        v = y + a * np.sin(k * x + 4.1) + 0.4 * a * np.sin(2.1 * k * x - 0.27 * k * y + 1.0)
        return u, v

    def _straight(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Undo `_bent` by fixed-point iteration (the bend is a contraction)."""
        x, y = u.copy(), v.copy()
        for _ in range(40):
            bent_x, bent_y = self._bent(x, y)
            x, y = x + (u - bent_x), y + (v - bent_y)
        return x, y


@njit(cache=True, nogil=True)
def _distance_to_edges(x, y, seeds):  # type: ignore[no-untyped-def]  # numba infers
    out = np.empty(x.size)
    for n in range(x.size):
        nearest = 0
        best = 1e30
        for s in range(len(seeds)):
            d2 = (x[n] - seeds[s, 0]) ** 2 + (y[n] - seeds[s, 1]) ** 2
            if d2 < best:
                best = d2
                nearest = s
        edge = 1e30
        for s in range(len(seeds)):
            if s != nearest:
                nx = seeds[s, 0] - seeds[nearest, 0]
                ny = seeds[s, 1] - seeds[nearest, 1]
                mx = (seeds[s, 0] + seeds[nearest, 0]) / 2 - x[n]
                my = (seeds[s, 1] + seeds[nearest, 1]) / 2 - y[n]
                edge = min(edge, (mx * nx + my * ny) / np.sqrt(nx * nx + ny * ny))
        out[n] = edge
    return out
