"""Places that lie on a surface which their neighbours show; the others see two surfaces at once, or were misread."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs

__all__ = ["keep_surfaces", "rise_px"]

F32 = npt.NDArray[np.float32]

BEND = 0.2
"""How far a pixel is off, of the bend of the map: the camera's blur averages over it."""


WELL = 1.4
"""A pixel that fits well costs no more than so many times what is expected."""
STEEP = 3
"""A surface may rise so many times more steeply than the whole does."""


def keep_surfaces(found: F32, spread: F32, misfit: F32, place: F32, sigma: F32, *, cell_px: float = 1.0) -> None:
    """Reject the pixels that lie on no surface which their neighbours show, and add the bend of it to sigma.

    Going on straight from the two next pixels in each of eight directions leads to a point of a surface, on its own
    side of an edge too. A pixel that sees two surfaces at once lies between them.

    Parameters
    ----------
    found, spread : ndarray of float32, shape (row, column)
        Projector px and standard uncertainty; NaN where not found.
    misfit : ndarray of float32, shape (row, column)
        How badly what a pixel saw fits, of what is expected.
    place, sigma : ndarray of float32, shape (row, column)
        Filled; NaN where rejected.
    cell_px : float
        Width of the finest stripes.
    """
    rise = STEEP * rise_px(found)
    flat, broken = max(1.0, 0.5 * cell_px), rise + 2 * max(cell_px, 1.0)
    limits = tuple(np.float32(limit) for limit in (broken, flat, rise, WELL))
    in_slabs(len(found), lambda first, last: _settle(found, spread, misfit, limits, first, last, place, sigma))


def rise_px(place: F32) -> float:
    """How much the place changes from pixel to pixel where nothing breaks off."""
    most = 0.0
    for step in (np.diff(place[::4], axis=1), np.diff(place[:, ::4], axis=0)):
        known = step[np.isfinite(step)]
        most = max(most, float(np.median(np.abs(known))) if known.size else 0.0)
    return most


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle(found, sigma, cost, limits, first, last, place, spread):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Fill rows `first` to `last`, one direction after the other along a row, so that all its pixels go at once.

    Parameters
    ----------
    found, sigma, cost : ndarray of float32, shape (row, column)
    limits : (float32, float32, float32, float32)
        A pixel whose neighbours spread over more lies at an edge of a surface; how far the way on may miss a pixel of
        the surface, sigma aside; how much a surface may rise per pixel, px; misfit of a pixel that fits well.
    place, spread : ndarray of float32, shape (row, column)
        Filled; NaN where rejected.
    """
    H, W = found.shape
    broken, flat, steep, well = limits
    low, high, bend = np.empty(W, np.float32), np.empty(W, np.float32), np.empty(W, np.float32)
    hole, straight = np.empty(W, np.uint8), np.empty(W, np.uint8)
    small = min(H, W) <= 4
    for i in range(first, last):
        here, own = found[i], sigma[i]
        low[:], high[:], bend[:], hole[:], straight[:] = here, here, 0, 0, 0
        for a in range(-1, 2):
            if not 0 <= i + a < H:
                continue
            for b in range(-1, 2):
                if a == 0 and b == 0:
                    continue
                begin, end = max(-b, 0), W - max(b, 0)
                _spread(found[i + a, begin + b : end + b], low[begin:end], high[begin:end], hole[begin:end])
                begin, end = max(-2 * b, 0), W - max(2 * b, 0)
                if 0 <= i + 2 * a < H and begin < end:
                    near, far = slice(begin + b, end + b), slice(begin + 2 * b, end + 2 * b)
                    _go_on(
                        here[begin:end], own[begin:end], found[i + a, near], sigma[i + a, near],
                        found[i + 2 * a, far], sigma[i + 2 * a, far], flat, steep, straight[begin:end],
                    )  # fmt: skip
        if W > 2:
            _bend(found[i, :-2], here[1:-1], found[i, 2:], sigma[i, :-2], own[1:-1], sigma[i, 2:], broken, bend[1:-1])
        if 0 < i < H - 1:
            _bend(found[i - 1], here, found[i + 1], sigma[i - 1], own, sigma[i + 1], broken, bend)
        _keep(here, own, cost[i], low, high, bend, hole, straight, broken, well, small, place[i], spread[i])


@nb.njit(cache=True, nogil=True)
def _spread(beside, low, high, hole):  # type: ignore[no-untyped-def]  # numba infers
    """Take in a neighbour: the lowest, the highest, whether one is missing."""
    for n in range(beside.size):
        value = beside[n]
        low[n] = value if value < low[n] else low[n]
        high[n] = value if value > high[n] else high[n]
        hole[n] |= np.uint8(value != value)


@nb.njit(cache=True, nogil=True)
def _go_on(here, own, beside, s1, beyond, s2, flat, steep, straight):  # type: ignore[no-untyped-def]  # numba infers
    """Count the directions in which going on straight from the two next pixels leads here."""
    two, four, zero = np.float32(2), np.float32(4), np.float32(0)
    for n in range(here.size):
        miss = max(abs(here[n] - two * beside[n] + beyond[n]) - flat, zero)
        rise = max(abs(beside[n] - beyond[n]) - steep, zero)
        of_two = s1[n] * s1[n] + s2[n] * s2[n]
        of_three = own[n] * own[n] + four * s1[n] * s1[n] + s2[n] * s2[n]
        leads = (miss * miss <= four * of_three) & (rise * rise <= four * of_two)
        straight[n] += np.uint8(leads & (beside[n] == beside[n]) & (beyond[n] == beyond[n]))


@nb.njit(cache=True, nogil=True)
def _bend(before, here, after, s1, own, s2, broken, bend):  # type: ignore[no-untyped-def]  # numba infers
    """Square of the bend of the surface less what sigma explains, the larger one; beyond an edge it is none."""
    two, four, most = np.float32(2), np.float32(4), broken * broken
    for n in range(here.size):
        more = before[n] - two * here[n] + after[n]
        more = more * more - (s1[n] * s1[n] + four * own[n] * own[n] + s2[n] * s2[n])
        bend[n] = more if (more > bend[n]) & (more < most) else bend[n]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _keep(here, own, cost, low, high, bend, hole, straight, broken, well, small, place, spread):  # type: ignore[no-untyped-def]  # numba infers
    """Judge a row: the more there is beside a pixel that it may be a mixture of, the more must lead to it."""
    nan, share = np.float32(np.nan), np.float32(BEND * BEND)
    for n in range(here.size):
        wide = high[n] - low[n]
        need = np.uint8(2) + np.uint8((hole[n] > 0) | (wide > broken))
        need = np.uint8(4) if (wide > broken + broken) & (cost[n] > well) else need
        kept = small | (straight[n] >= need)
        place[n] = here[n] if kept else nan
        error = np.sqrt(own[n] * own[n] + share * bend[n])
        spread[n] = error if kept & (here[n] == here[n]) else nan
