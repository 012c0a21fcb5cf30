"""Environment: what temperature and humidity do to a series, with a lag, taken out of it and out of its trend."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from .trend import inflation

__all__ = ["ENVIRONMENT", "Corrected", "Effect", "correct_for", "followed"]

Floats = npt.NDArray[np.float64]
Times = npt.NDArray[np.datetime64]

ENVIRONMENT: Mapping[str, str] = MappingProxyType({"temperature": "degree_Celsius", "humidity": "percent"})
"""Unit of each quantity that is kept with the scans, by the name of its series."""
LAGS = 25
"""So many lags are tried, evenly from none to the longest."""
FEWEST = 12
"""Values below which nothing can be told apart from chance."""
EXACT = 1e-6
"""Days by which two times may differ and be one, a tenth of a second."""
ROUNDS, HUBER = 8, 1.345
"""Of the robust fit: values off by more than 1.345 robust standard deviations count less (Huber 1964)."""


@dataclass(frozen=True, slots=True)
class Effect:
    """By how much a metric changes per unit of an environmental quantity, with its standard uncertainty."""

    name: str
    per_unit: float
    sigma: float


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """A series as it would be at the mean temperature and humidity, and its trend.

    Parameters
    ----------
    values, sigmas : ndarray of float64, shape (n,)
        NaN where the environment is not known; sigma includes what is uncertain of the effects.
    slope_per_day, slope_sigma : float
        Rate fitted together with the effects, and its standard uncertainty.
    low, high : float
        95 % interval of the rate.
    lag_hours : float
        By which the metric follows the environment.
    effects : tuple of Effect
    count : int
        Number of values used.
    """

    values: Floats
    sigmas: Floats
    slope_per_day: float
    slope_sigma: float
    low: float
    high: float
    lag_hours: float
    effects: tuple[Effect, ...]
    count: int


def correct_for(
    times: Times,
    values: Floats,
    sigmas: Floats,
    drivers: Mapping[str, tuple[Times, Floats]],
    max_lag_hours: float = 0.0,
) -> Corrected | None:
    """Regress the environment out of a series.

    ``value = a + b t + sum c_k x_k(t - lag) + error``, robustly (Huber weights), for the lag of the least sum of
    squares, which all quantities share. Uncertainties are those of the fit, widened for a positive lag-one correlation
    r of its residuals by (1 + r) / (1 - r) as in `trend`.

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
        Ascending.
    values, sigmas : ndarray of float64, shape (n,)
        NaN where not measured.
    drivers : mapping of str to (ndarray of datetime64, ndarray of float64), shape (m,) each
        Environmental quantities and when they were read, ascending; NaN where not known. Between readings they are
        interpolated, but not across a gap of more than three usual steps. What comes and goes between two readings is
        not seen: readings should be closer than the environment varies.
    max_lag_hours : float
        Longest lag that is tried.

    Returns
    -------
    Corrected or None
        None where there are too few values, or nothing varied.

    Raises
    ------
    ValueError
        If the arrays differ in length.
    """
    if not times.shape == values.shape == sigmas.shape:
        raise ValueError(f"a correction needs as many times as values: {times.shape}, {values.shape}, {sigmas.shape}")
    if any(read.shape != x.shape for read, x in drivers.values()):
        raise ValueError("environmental quantities need as many times as values")
    if not drivers or len(times) < FEWEST:
        return None
    day = (times - times[0]) / np.timedelta64(1, "D")
    lags = _lags(max_lag_hours)
    before = followed(times, tuple(drivers.values()), max_lag_hours)
    # the same values for all lags, or the sums of squares could not be compared
    used = np.isfinite(values) & np.isfinite(before).all(axis=(1, 2))
    count, size = int(used.sum()), 2 + len(drivers)
    freedom = count - size - (len(lags) > 1)
    if count < FEWEST or freedom < 4 or any(np.ptp(before[used, 0, k]) <= 0 for k in range(len(drivers))):
        return None
    designs = [np.column_stack([np.ones(count), day[used], before[used, n]]) for n in range(len(lags))]
    losses = [float(np.linalg.lstsq(design, values[used], rcond=None)[1].sum()) for design in designs]
    best = int(np.argmin(losses))
    fit, covariance, residual = _robust(designs[best], values[used], freedom)
    covariance = covariance * inflation(residual)
    slope, slope_sigma = float(fit[1]), math.sqrt(float(covariance[1, 1]))
    from scipy.special import stdtrit

    half = float(stdtrit(freedom, 0.975)) * slope_sigma
    away = before[:, best] - before[used, best].mean(axis=0)
    uncertain = np.einsum("nk,kl,nl->n", away, covariance[2:, 2:], away)
    deviations = np.sqrt(np.diag(covariance)[2:])
    effects = tuple(Effect(name, float(c), float(s)) for name, c, s in zip(drivers, fit[2:], deviations, strict=True))
    return Corrected(
        values - away @ fit[2:],
        np.sqrt(sigmas**2 + uncertain),
        slope,
        slope_sigma,
        slope - half,
        slope + half,
        float(lags[best]),
        effects,
        count,
    )


def followed(times: Times, drivers: Sequence[tuple[Times, Floats]], max_lag_hours: float) -> Floats:
    """Give environmental quantities as they were before some times, by each of the lags that are tried.

    Parameters
    ----------
    times : ndarray of datetime64, shape (n,)
    drivers : sequence of (ndarray of datetime64, ndarray of float64), shape (m,) each
        As for `correct_for`.
    max_lag_hours : float

    Returns
    -------
    ndarray of float64, shape (n, lags, quantities)
        NaN where a quantity is not known.
    """
    lags = _lags(max_lag_hours) / 24
    if not times.size:
        return np.zeros((0, len(lags), len(drivers)))
    day = (times - times[0]) / np.timedelta64(1, "D")
    read = [((at - times[0]) / np.timedelta64(1, "D"), x) for at, x in drivers]
    return np.stack([_at(at, x, day[:, np.newaxis] - lags) for at, x in read], axis=2)


def _lags(max_lag_hours: float) -> Floats:
    return np.linspace(0.0, max_lag_hours, LAGS if max_lag_hours > 0 else 1)


def _at(read: Floats, x: Floats, wanted: Floats) -> Floats:
    """Give a quantity at some times, in days; NaN beyond its readings and across long gaps."""
    known = np.isfinite(x)
    at = read[known]
    if len(at) < 2:
        return (
            np.where(np.abs(wanted - at[0]) < EXACT, x[known][0], np.nan) if len(at) else np.full_like(wanted, np.nan)
        )
    steps = np.diff(at)
    after = np.clip(np.searchsorted(at, wanted - EXACT), 1, len(at) - 1)
    exact = (np.abs(at[after] - wanted) < EXACT) | (np.abs(at[after - 1] - wanted) < EXACT)
    inside = (wanted >= at[0] - EXACT) & (wanted <= at[-1] + EXACT)
    bridged = steps[after - 1] <= 3 * np.median(steps)
    return np.where(inside & (bridged | exact), np.interp(wanted, at, x[known]), np.nan)


def _robust(design: Floats, values: Floats, freedom: int) -> tuple[Floats, Floats, Floats]:
    """Fit by iteratively reweighted least squares; coefficients, covariance, residuals."""
    weight = np.ones(len(values))
    scaled = np.maximum(np.abs(design).max(axis=0), 1e-300)  # days and per cent side by side
    for _ in range(ROUNDS):
        root = np.sqrt(weight)[:, np.newaxis]
        fit = np.linalg.lstsq(root * design / scaled, root[:, 0] * values, rcond=None)[0] / scaled
        residual = values - design @ fit
        spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        if spread <= 0:
            break
        weight = np.minimum(1.0, HUBER * spread / np.maximum(np.abs(residual), 1e-300))
    inner = np.linalg.pinv((design / scaled).T @ (weight[:, np.newaxis] * design / scaled))
    variance = float((weight * residual**2).sum()) / freedom
    # the weights take part of the variance away that they count: Huber's correction for the mean of psi'
    whole = float((weight >= 1.0).mean()) or 1.0
    return fit, variance / whole * inner / np.outer(scaled, scaled), residual
