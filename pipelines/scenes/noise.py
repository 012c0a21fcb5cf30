"""Natural texture as a function of place: fractal value noise and scattered grains, the same for the same seed."""

from __future__ import annotations

import numpy as np
from numba import njit

from .scene import Array

__all__ = ["fractal", "grains"]


def fractal(x_mm: Array, y_mm: Array, seed: int, wavelength_mm: float, octaves: int, gain: float = 0.5) -> Array:
    """Sum octaves of lattice noise.

    Parameters
    ----------
    x_mm, y_mm : ndarray, any shape
    seed : int
    wavelength_mm : float
        Lattice of the coarsest octave; each next one is half as wide and `gain` times as high.
    octaves : int
    gain : float

    Returns
    -------
    ndarray
        Twice differentiable, mean near 0, within [-1, 1], shape of `x_mm`.
    """
    x, y = np.broadcast_arrays(x_mm, y_mm)
    flat = _fractal(np.ravel(x).astype(np.float64), np.ravel(y).astype(np.float64), seed, wavelength_mm, octaves, gain)
    shaped: Array = flat.reshape(x.shape)
    return shaped


def grains(x_mm: Array, y_mm: Array, seed: int, spacing_mm: float, radius_mm: tuple[float, float]) -> Array:
    """Scatter rounded grains, one at most per square of `spacing_mm`.

    Parameters
    ----------
    x_mm, y_mm : ndarray, any shape
    seed : int
    spacing_mm : float
    radius_mm : (float, float)
        Smallest and largest radius; at most half of `spacing_mm`.

    Returns
    -------
    ndarray
        Height of the grains, mm: 0.45 r (1 - (d/r)^2)^2 for a grain of radius r at distance d < r, else 0.
    """
    x, y = np.broadcast_arrays(x_mm, y_mm)
    flat = _grains(np.ravel(x).astype(np.float64), np.ravel(y).astype(np.float64), seed, spacing_mm, *radius_mm)
    shaped: Array = flat.reshape(x.shape)
    return shaped


@njit(cache=True, nogil=True)
def _hash(i, j, seed):  # type: ignore[no-untyped-def]  # numba infers; integers wrap, as meant
    """Mix two lattice indices and a seed to a number in [0, 1) (the finaliser of MurmurHash3)."""
    h = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(j) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= np.uint64(seed) * np.uint64(0x165667B19E3779F9)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xFF51AFD7ED558CCD)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xC4CEB9FE1A85EC53)
    h ^= h >> np.uint64(33)
    return float(h >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True, nogil=True)
def _fractal(x, y, seed, wavelength, octaves, gain):  # type: ignore[no-untyped-def]  # numba infers
    out = np.zeros(x.size)
    total = 0.0
    amplitude = 1.0
    for octave in range(octaves):
        scale = 2.0**octave / wavelength
        for n in range(x.size):
            u = x[n] * scale
            v = y[n] * scale
            i = int(np.floor(u))
            j = int(np.floor(v))
            a = u - i
            b = v - j
            a = a * a * a * (a * (6.0 * a - 15.0) + 10.0)
            b = b * b * b * (b * (6.0 * b - 15.0) + 10.0)
            salt = seed + 1013 * octave
            low = _hash(i, j, salt) * (1 - a) + _hash(i + 1, j, salt) * a
            high = _hash(i, j + 1, salt) * (1 - a) + _hash(i + 1, j + 1, salt) * a
            out[n] += amplitude * (2.0 * (low * (1 - b) + high * b) - 1.0)
        total += amplitude
        amplitude *= gain
    return out / total


@njit(cache=True, nogil=True)
def _grains(x, y, seed, spacing, smallest, largest):  # type: ignore[no-untyped-def]  # numba infers
    out = np.zeros(x.size)
    for n in range(x.size):
        i0 = int(np.floor(x[n] / spacing))
        j0 = int(np.floor(y[n] / spacing))
        for i in range(i0 - 1, i0 + 2):
            for j in range(j0 - 1, j0 + 2):
                if _hash(i, j, seed) < 0.55:
                    size = _hash(i, j, seed + 3)
                    r = smallest + (largest - smallest) * size * size
                    dx = x[n] - (i + _hash(i, j, seed + 1)) * spacing
                    dy = y[n] - (j + _hash(i, j, seed + 2)) * spacing
                    q = (dx * dx + dy * dy) / (r * r)
                    if q < 1.0:
                        out[n] = max(out[n], 0.45 * r * (1.0 - q) ** 2)
    return out
