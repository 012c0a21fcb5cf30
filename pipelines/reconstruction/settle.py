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
    in_slabs(
        len(found),
        lambda first, last: _settle(found, spread, misfit, broken, flat, rise, WELL, first, last, place, sigma),
    )


def rise_px(place: F32) -> float:
    """How much the place changes from pixel to pixel where nothing breaks off."""
    most = 0.0
    for step in (np.diff(place[::4], axis=1), np.diff(place[:, ::4], axis=0)):
        known = step[np.isfinite(step)]
        most = max(most, float(np.median(np.abs(known))) if known.size else 0.0)
    return most


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle(found, sigma, cost, break_px, flat_px, steep_px, well, first, last, place, spread):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Keep the pixels that lie on a surface which their neighbours show, and add the bend of the surface to sigma.

    Going on straight from the two next pixels in each of eight directions leads to a point of a surface, on its own
    side of an edge too. A pixel that sees two surfaces at once lies between them.

    Parameters
    ----------
    found, sigma, cost : ndarray of float32, shape (row, column)
        Of `locate_pixels`.
    break_px : float
        A pixel whose neighbours spread over more lies at an edge of a surface.
    flat_px, steep_px : float
        How far the way on may miss a pixel of the surface, sigma aside; how much a surface may rise per pixel.
    well : float
        Cost of a pixel that fits well.
    first, last : int
        Rows to do.
    place, spread : ndarray of float32, shape (row, column)
        Filled; NaN where rejected.
    """
    H, W = found.shape
    nan = np.float32(np.nan)
    for i in range(first, last):
        for j in range(W):
            here = found[i, j]
            place[i, j], spread[i, j] = nan, nan
            if here != here:
                continue
            own = sigma[i, j]
            low, high, hole, straight = here, here, False, 0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    if (a == 0 and b == 0) or not (0 <= i + a < H and 0 <= j + b < W):
                        continue
                    beside = found[i + a, j + b]
                    if beside != beside:
                        hole = True
                        continue
                    low, high = min(low, beside), max(high, beside)
                    if not (0 <= i + 2 * a < H and 0 <= j + 2 * b < W):
                        continue
                    beyond = found[i + 2 * a, j + 2 * b]
                    s1, s2 = sigma[i + a, j + b], sigma[i + 2 * a, j + 2 * b]
                    miss = abs(here - 2 * beside + beyond) - flat_px
                    rise = abs(beside - beyond) - steep_px
                    if miss > 0 and miss * miss > 4 * (own * own + 4 * s1 * s1 + s2 * s2):
                        continue
                    if rise > 0 and rise * rise > 4 * (s1 * s1 + s2 * s2):
                        continue
                    straight += beyond == beyond
            need = 2
            if hole or high - low > break_px:
                need = 3
            if high - low > 2 * break_px and cost[i, j] > well:
                need = 4
            if straight < need and min(H, W) > 4:
                continue
            bend = np.float32(0)
            for a, b in ((0, 1), (1, 0)):
                if a <= i < H - a and b <= j < W - b:
                    s1, s2 = sigma[i - a, j - b], sigma[i + a, j + b]
                    more = found[i - a, j - b] - 2 * here + found[i + a, j + b]
                    more = more * more - (s1 * s1 + 4 * own * own + s2 * s2)
                    if more > bend and more < break_px * break_px:
                        bend = more
            place[i, j] = here
            spread[i, j] = np.sqrt(own * own + np.float32(BEND * BEND) * bend)
