"""How far a scan is turned about the vertical, once its shift is known: what the shift left, farther out the more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs
from .bands import FINE_CELLS

if TYPE_CHECKING:
    from .drift import Pattern

__all__ = ["CLIP", "Turn", "turn_left"]

THINNED = 8
"""A turn shows in every so-manieth row as well."""
ROUNDS = 12
CLIP = 4.685
"""Tukey's biweight: 95 % efficient for normal residuals, blind to gross ones."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn from x to y about the middle of the cells that were used (column, row); and its standard uncertainty."""

    angle_rad: float = 0.0
    sigma_rad: float = float("inf")
    about: tuple[float, float] = (0.0, 0.0)


@njit(cache=True, nogil=True)
def _equations(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    ref, gx, gy, mov, at_row, u, v, turn, about, scale, step, first, last
):
    """Tukey-weighted Gauss-Newton sums over a slab: normal matrix and right side of shift and turn.

    A residual is mov(i + v + turn x, j + u - turn y) - ref(i, j), bilinear, with (x, y) from `about`.
    """
    rows, columns = mov.shape
    normal, right = np.zeros((3, 3)), np.zeros(3)
    slopes = np.zeros(3)
    for i in range(first, last):
        y = at_row[i] - about[1]
        for j in range(ref.shape[1]):
            x = 1 + step * j - about[0]
            c, r = 1 + step * j + u - turn * y, at_row[i] + v + turn * x
            if not (abs(ref[i, j]) < np.inf and 0 <= c < columns - 1 and 0 <= r < rows - 1):
                continue
            b, a = int(r), int(c)
            fv, fu = r - b, c - a
            m = (1 - fv) * ((1 - fu) * mov[b, a] + fu * mov[b, a + 1]) + fv * (
                (1 - fu) * mov[b + 1, a] + fu * mov[b + 1, a + 1]
            )
            d = m - ref[i, j]
            e = d / (CLIP * scale)
            if not abs(e) < 1:
                continue
            w = (1 - e * e) ** 2 / (scale * scale)
            slopes[0], slopes[1], slopes[2] = gx[i, j], gy[i, j], gy[i, j] * x - gx[i, j] * y
            for k in range(3):
                right[k] += w * slopes[k] * d
                for n in range(3):
                    normal[k, n] += w * slopes[k] * slopes[n]
    return normal, right


def turn_left(patterns: Sequence[Pattern], scales: Sequence[float], u: float, v: float) -> Turn:
    """Find the turn besides a shift by Gauss-Newton over shift and turn on some rows.

    Parameters
    ----------
    patterns : sequence of Pattern
        Channels of the baseline, each to be sought in the scan.
    scales : sequence of float
        Spread of each channel's residuals after the shift.
    u, v : float
        The shift, cells along x and y.

    Returns
    -------
    Turn
        Of infinite uncertainty where nothing tells.
    """
    some = slice(None, None, THINNED)
    thin = [(one.ref[some], one.gx[some], one.gy[some], one.mov, one.rows[some]) for one in patterns]
    step = patterns[0].step
    row, column = np.nonzero(np.isfinite(thin[0][0]))
    if not row.size:
        return Turn()
    about = (1 + step * float(column.mean()), float(thin[0][4][row].mean()))
    turn = 0.0
    for _ in range(ROUNDS):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for given, scale in zip(thin, scales, strict=True):
            for part in _sums(given, u, v, turn, about, scale, step):
                normal, right = normal + part[0], right + part[1]
        if not np.linalg.cond(normal) < 1e14:
            return Turn()
        move = np.linalg.solve(normal, right)
        far = np.hypot(*patterns[0].mov.shape) / 2
        u, v, turn = u - float(move[0]), v - float(move[1]), turn - float(move[2])
        if abs(move[2]) * far < 1e-3:
            break
    # neighbouring residuals share their errors over the smoothing's footprint (4 pi sigma^2 cells)
    shared = max(1.0, 4 * np.pi * FINE_CELLS**2 / (step**2 * THINNED))
    return Turn(turn, float(np.sqrt(shared * np.linalg.inv(normal)[2, 2])), about)


def _sums(
    given: tuple[npt.NDArray[np.generic], ...],
    u: float,
    v: float,
    turn: float,
    about: tuple[float, float],
    scale: float,
    step: int,
) -> list[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    return in_slabs(
        len(given[0]), lambda first, last: _equations(*given, u, v, turn, about, scale, step, first, last), least=16
    )
