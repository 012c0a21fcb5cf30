"""Control charts: has a series changed, said with a stated rate of false alarms (CUSUM and EWMA on its residuals)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

__all__ = ["Chart", "ControlChart", "control_chart", "run_length", "standard_residuals", "threshold"]

Floats = npt.NDArray[np.float64]
Chart = Literal["cusum", "ewma"]
Model = Literal["level", "line"]

SLACK = 0.5
"""CUSUM ignores shifts below so many standard deviations: tuned to find one of 1 (Page 1954; Montgomery 2013)."""
WEIGHT = 0.2
"""EWMA's weight of the newest value (Roberts 1959)."""
MOST_APART = 100_000
STATES = 401
"""States of the Markov chain that tells run lengths."""
FARTHEST = 8.0
"""A residual beyond so many standard deviations counts as that: a normal score has no end."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlChart:
    """A series on a control chart.

    Parameters
    ----------
    residual : ndarray of float64, shape (n,)
        Standard residuals, standard normal while nothing changes; NaN for the first ones, which are learned from, and
        where nothing was measured.
    statistic : ndarray of float64, shape (n,)
        What is compared with `threshold`: the larger of the two sums of a CUSUM, the absolute EWMA.
    threshold : float
    signals : ndarray of bool, shape (n,)
        Where the statistic is beyond the threshold. A CUSUM starts again after a signal.
    false_alarm_every : float
        Values between two false alarms in the mean, while nothing changes.
    """

    residual: Floats
    statistic: Floats
    threshold: float
    signals: npt.NDArray[np.bool_]
    false_alarm_every: float


def control_chart(
    times: npt.NDArray[np.datetime64],
    values: Floats,
    *,
    chart: Chart = "cusum",
    model: Model = "level",
    false_alarm_every: float = 370.0,
) -> ControlChart:
    """Put a series on a control chart.

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
        Ascending, as irregular as they are.
    values : ndarray of float64, shape (n,)
        NaN where not measured.
    chart : {"cusum", "ewma"}
        CUSUM with a slack of 0.5, EWMA with a weight of 0.2.
    model : {"level", "line"}
        What "no change" is: a level, or a steady rate.
    false_alarm_every : float
        Values between false alarms in the mean (average run length under no change), 10 to 100,000.

    Returns
    -------
    ControlChart

    Raises
    ------
    ValueError
        If the arrays differ in length or `false_alarm_every` is out of range.
    """
    residual = standard_residuals(times, values, model)
    limit = threshold(chart, float(false_alarm_every))
    statistic = np.full(residual.shape, np.nan)
    signals = np.zeros(residual.shape, dtype=np.bool_)
    up = down = smooth = 0.0
    for n in np.flatnonzero(np.isfinite(residual)):
        z = float(residual[n])
        if chart == "cusum":
            up, down = max(0.0, up + z - SLACK), max(0.0, down - z - SLACK)
            statistic[n] = max(up, down)
        else:
            smooth += WEIGHT * (z - smooth)
            statistic[n] = abs(smooth)
        if statistic[n] > limit:
            signals[n] = True
            up = down = smooth = 0.0
    return ControlChart(residual, statistic, limit, signals, float(false_alarm_every))


def standard_residuals(times: npt.NDArray[np.datetime64], values: Floats, model: Model = "level") -> Floats:
    """How far each value lies from what those before it foretell, as a standard normal score.

    Recursive residuals (Brown, Durbin and Evans 1975) of a level or of a line over time, each divided by the standard
    deviation of those before it, which makes a Student t of known degrees of freedom; its normal score is standard
    normal and independent of the others (self-starting charts: Hawkins 1987, Quesenberry 1991). So no length of
    quiet baseline is needed, and the rate of false alarms is the stated one from the first residual on.

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
        Ascending.
    values : ndarray of float64, shape (n,)
        NaN where not measured.
    model : {"level", "line"}

    Returns
    -------
    ndarray of float64, shape (n,)
        NaN for the first 3 (level) or 4 (line) values and where not measured; within +-8.

    Raises
    ------
    ValueError
        If the arrays differ in length.
    """
    if times.shape != values.shape:
        raise ValueError(f"a control chart needs as many times as values: {times.shape} and {values.shape}")
    from scipy.stats import norm, t

    residual = np.full(values.shape, np.nan)
    known = np.flatnonzero(np.isfinite(values) & ~np.isnat(times))
    if known.size < 4:
        return residual
    day = (times[known] - times[known[0]]) / np.timedelta64(1, "D")
    scale = max(float(day[-1]), 1e-12)
    design = np.stack([np.ones(known.size), day / scale], axis=1)[:, : 1 if model == "level" else 2]
    step = _recursive(design, values[known] - values[known[0]])
    first = design.shape[1]  # values that determine the model and foretell nothing
    squares = np.concatenate([[0.0], np.cumsum(step[first:] ** 2)[:-1]])
    freedom = np.arange(squares.size)
    usable = (freedom >= 2) & (squares > 0)
    student = step[first:][usable] / np.sqrt(squares[usable] / freedom[usable])
    # through the tail that is small: a score far out keeps its digits
    score = -norm.ppf(t.sf(np.abs(student), freedom[usable])) * np.sign(student)
    residual[known[first:][usable]] = np.clip(score, -FARTHEST, FARTHEST)
    return residual


def _recursive(design: Floats, values: Floats) -> Floats:
    """How far each value lies from the fit of those before it, over the root of 1 + its leverage; 0 without a fit."""
    count, size = design.shape
    step = np.zeros(count)
    inverse = np.linalg.pinv(design[:size].T @ design[:size])
    coefficients = inverse @ design[:size].T @ values[:size]
    for n in range(size, count):
        x = design[n]
        gain = inverse @ x
        leverage = 1.0 + float(x @ gain)
        off = float(values[n] - x @ coefficients)
        step[n] = off / np.sqrt(leverage)
        coefficients = coefficients + gain * (off / leverage)
        inverse -= np.outer(gain, gain) / leverage
    return step


@lru_cache(maxsize=32)
def threshold(chart: Chart, false_alarm_every: float) -> float:
    """Threshold of a two-sided chart whose false alarms are so many values apart in the mean.

    Parameters
    ----------
    chart : {"cusum", "ewma"}
    false_alarm_every : float
        From 10 to 100,000.

    Raises
    ------
    ValueError
        Out of that range: such a chart would tell nothing, or never.
    """
    if not 10 <= false_alarm_every <= MOST_APART:
        raise ValueError(f"false_alarm_every is a number of values from 10 to {MOST_APART}, not {false_alarm_every:g}")
    from scipy.optimize import brentq

    low, high = (0.1, 12.0) if chart == "cusum" else (0.05, 1.6)
    found: float = brentq(
        lambda limit: np.log(run_length(chart, limit)) - np.log(false_alarm_every), low, high, xtol=1e-4
    )
    return found


def run_length(chart: Chart, limit: float, shift: float = 0.0) -> float:
    """Values until a two-sided chart signals, in the mean, when the level has shifted by so many standard deviations.

    A Markov chain over the statistic cut into `STATES` states (Brook and Evans 1972). The two sums of a CUSUM are told
    apart: 1 / ARL = 1 / ARL up + 1 / ARL down (van Dobben de Bruyn 1968).

    Parameters
    ----------
    chart : {"cusum", "ewma"}
    limit : float
    shift : float

    Returns
    -------
    float
    """
    if chart == "cusum":
        return 1 / (1 / _cusum_length(limit, shift) + 1 / _cusum_length(limit, -shift))
    from scipy.special import ndtr

    edge = np.linspace(-limit, limit, STATES + 1)
    middle = (edge[1:] + edge[:-1]) / 2
    reach = ndtr((edge - (1 - WEIGHT) * middle[:, None]) / WEIGHT - shift)
    return _steps(np.diff(reach, axis=1))[STATES // 2]


def _cusum_length(limit: float, shift: float) -> float:
    from scipy.special import ndtr

    # state 0 is the sum 0; the others have width w, the first half of it
    w = 2 * limit / (2 * STATES - 1)
    middle = np.arange(STATES) * w
    upper = ndtr(middle - middle[:, None] + w / 2 + SLACK - shift)
    step = np.diff(upper, axis=1, prepend=0.0)
    return _steps(step)[0]


def _steps(transition: Floats) -> list[float]:
    """Mean steps to absorption from each state."""
    count = len(transition)
    found: list[float] = np.linalg.solve(np.eye(count) - transition, np.ones(count)).tolist()
    return found
