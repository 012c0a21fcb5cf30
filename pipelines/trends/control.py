"""Control charts: has a series changed, said with a stated rate of false alarms (CUSUM and EWMA on its residuals)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .recursive import Fit, fitted, score

__all__ = [
    "Chart",
    "Charted",
    "ControlChart",
    "Model",
    "charted",
    "control_chart",
    "run_length",
    "threshold",
]

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


class Charted(NamedTuple):
    """What a control chart knows after a value: what it has learned of the series, and its sums.

    Carried from value to value, so that a chart costs the same after ten thousand of them. `fits` are one for each lag
    by which the series may follow its drivers; `residual` is the newest value's standard residual (NaN while it is
    learned from), `statistic` what is compared with the threshold, `quiet` how many values ago the chart last signalled
    (-1: never, 0: now).
    """

    known: int = 0
    fits: tuple[Fit, ...] = ()
    up: float = 0.0
    down: float = 0.0
    smooth: float = 0.0
    residual: float = math.nan
    statistic: float = math.nan
    quiet: int = -1

    @property
    def signals(self) -> bool:
        """Whether the newest value made the chart signal."""
        return self.quiet == 0


NO_DRIVERS: tuple[tuple[float, ...], ...] = ((),)


def charted(
    before: Charted,
    day: float,
    value: float,
    chart: Chart,
    limit: float,
    model: Model = "level",
    drivers: Sequence[Sequence[float]] = NO_DRIVERS,
) -> Charted:
    """Put the next value on a chart.

    Parameters
    ----------
    before : Charted
        ``Charted()`` before the first value.
    day : float
        When it was measured, days after any fixed moment.
    value : float
        Finite.
    chart : {"cusum", "ewma"}
    limit : float
        `threshold` of the chart.
    model : {"level", "line"}
        What "no change" is: a level, or a steady rate.
    drivers : sequence of sequence of float, shape (lags, quantities)
        What else moves the series and is taken out of it, such as the temperature, as it was each of some lags before.
        A value is judged by the lag that told the values before it best.
    """
    residual, fits = _learned(before.fits, (day,) if model == "line" else (), value, drivers)
    learned = before._replace(known=before.known + 1, fits=fits, residual=residual, statistic=math.nan)
    if math.isnan(residual):
        return learned
    up, down, smooth = before.up, before.down, before.smooth
    if chart == "cusum":
        up, down = max(0.0, up + residual - SLACK), max(0.0, down - residual - SLACK)
        statistic = max(up, down)
    else:
        smooth += WEIGHT * (residual - smooth)
        statistic = abs(smooth)
    if statistic > limit:
        return learned._replace(up=0.0, down=0.0, smooth=0.0, statistic=statistic, quiet=0)
    quiet = before.quiet + 1 if before.quiet >= 0 else -1
    return learned._replace(up=up, down=down, smooth=smooth, statistic=statistic, quiet=quiet)


def _learned(
    before: tuple[Fit, ...], steady: tuple[float, ...], value: float, drivers: Sequence[Sequence[float]]
) -> tuple[float, tuple[Fit, ...]]:
    """Give the standard residual of a value and the fits with it.

    No length of quiet baseline is needed, and the rate of false alarms is the stated one from the first residual on.
    """
    fits = before or (Fit(),) * len(drivers)
    found = [fitted(fit, (*steady, *lagged), value) for fit, lagged in zip(fits, drivers, strict=True)]
    # by the values before this one only: chosen with it, the residual would be too small
    best = min(range(len(fits)), key=lambda n: fits[n].squares / fits[n].freedom if fits[n].freedom else math.inf)
    return score(fits[best], found[best][0], chosen=len(fits) > 1), tuple(fit for _, fit in found)


def control_chart(
    times: npt.NDArray[np.datetime64],
    values: Floats,
    *,
    chart: Chart = "cusum",
    model: Model = "level",
    false_alarm_every: float = 400.0,
    drivers: Floats | None = None,
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
    drivers : ndarray of float64, shape (n, lags, quantities), optional
        As `followed` gives them: taken out of the series. A value beside which one is NaN is passed over.

    Returns
    -------
    ControlChart

    Raises
    ------
    ValueError
        If the arrays differ in length or `false_alarm_every` is out of range.
    """
    if times.shape != values.shape:
        raise ValueError(f"a control chart needs as many times as values: {times.shape} and {values.shape}")
    limit = threshold(chart, float(false_alarm_every))
    residual, statistic = np.full(values.shape, np.nan), np.full(values.shape, np.nan)
    signals = np.zeros(values.shape, dtype=np.bool_)
    beside = np.zeros((*values.shape, 1, 0)) if drivers is None else drivers
    known = np.flatnonzero(np.isfinite(values) & ~np.isnat(times) & np.isfinite(beside).all(axis=(1, 2)))
    state = Charted()
    if known.size:
        days = ((times[known] - times[known[0]]) / np.timedelta64(1, "D")).tolist()
        rows = zip(known.tolist(), days, values[known].tolist(), beside[known].tolist(), strict=True)
        for n, day, value, moved in rows:
            state = charted(state, day, value, chart, limit, model, moved)
            residual[n], statistic[n], signals[n] = state.residual, state.statistic, state.signals
    return ControlChart(residual, statistic, limit, signals, float(false_alarm_every))


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
