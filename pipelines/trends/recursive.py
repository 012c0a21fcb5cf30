"""Recursive residuals: how far each value lies from what those before it foretell, one value after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["Fit", "fitted", "score"]

TINY = 1e-9
"""Of the largest number seen in a column: what is left of it below that is rounding."""
FARTHEST = 8.0
"""A residual beyond so many standard deviations counts as that: a normal score has no end."""


class Fit(NamedTuple):
    """A least-squares fit to the values so far, as the triangle that Givens rotations leave of the rows seen.

    Carried from value to value, so that the ten-thousandth costs what the first did; a column that has not varied yet
    takes part only once it does.

    Parameters
    ----------
    origin, largest : tuple of float
        First row of regressors and value, taken off all, and the largest number of each column since.
    triangle : tuple of tuple of float
        Row j begins at column j; its last entry belongs to the value.
    squares : float
        Sum of the squared recursive residuals.
    freedom : int
        How many there were.
    """

    origin: tuple[float, ...] = ()
    largest: tuple[float, ...] = ()
    triangle: tuple[tuple[float, ...], ...] = ()
    squares: float = 0.0
    freedom: int = 0


def fitted(before: Fit, regressors: Sequence[float], value: float) -> tuple[float, Fit]:
    """Give a value's recursive residual (Brown, Durbin and Evans 1975), and the fit with it.

    The residual is the value less what the fit to those before foretells, over sqrt(1 + leverage): while the model
    holds, all have the noise's variance and none depends on another. It is what is left of the value once its row has
    been rotated into the triangle (Gentleman 1973); NaN for a row that tells a column for the first time.

    Parameters
    ----------
    before : Fit
        ``Fit()`` before the first value.
    regressors : sequence of float
        A level is always fitted and not one of them.
    value : float
    """
    row = (*regressors, value)
    if not before.origin:
        # the first value tells the level
        width = len(row)
        level = (1.0, *(0.0,) * width)
        return math.nan, Fit(row, (0.0,) * width, (level, *((0.0,) * (width - j) for j in range(width - 1))))
    away = [1.0, *(new - old for new, old in zip(row, before.origin, strict=True))]
    largest = tuple(max(old, abs(new)) for old, new in zip(before.largest, away[1:], strict=True))
    triangle, new_rank = [], False
    for j, held in enumerate(before.triangle):
        if abs(away[j]) <= TINY * (largest[j - 1] if j else 1.0):
            triangle.append(held)
            continue
        new_rank = new_rank or held[0] == 0.0
        length = math.hypot(held[0], away[j])
        cosine, sine = held[0] / length, away[j] / length
        rest = away[j:]
        triangle.append(tuple(cosine * a + sine * b for a, b in zip(held, rest, strict=True)))
        away[j:] = [cosine * b - sine * a for a, b in zip(held, rest, strict=True)]
    after = before._replace(largest=largest, triangle=tuple(triangle))
    if new_rank:
        return math.nan, after
    residual = away[-1] if abs(away[-1]) > TINY * largest[-1] else 0.0
    return residual, after._replace(squares=before.squares + residual * residual, freedom=before.freedom + 1)


def score(before: Fit, residual: float, chosen: int = 0) -> float:
    """Give the normal score of a recursive residual, standard normal whatever the noise; NaN where that is not known.

    Over the spread of the residuals before it, it is a Student t of as many degrees of freedom (self-starting charts:
    Hawkins 1987, Quesenberry 1991), less `chosen`: how many numbers of the model were picked for a small spread.
    """
    freedom = before.freedom - chosen
    if math.isnan(residual) or freedom < 2 or before.squares <= 0:
        return math.nan
    from scipy.special import ndtri, stdtr

    student = residual / math.sqrt(before.squares / freedom)
    # through the tail that is small: a score far out keeps its digits
    far = -float(ndtri(stdtr(freedom, -abs(student))))
    return math.copysign(min(far, FARTHEST), student)
