"""From scans between which nothing changed to the noise model of their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..instant import format_instant
from ..scan import Scan
from .covariance import covariance_by_lag, longest_lag
from .difference import Z_95
from .noise_model import NoiseCell, NoiseModel, local_slope
from .ranks import robust_sigma
from .values import Comparison

__all__ = ["noise_model", "repeat_pairs", "unrest"]

Floats = npt.NDArray[np.float64]

SAMPLED = 40_000
"""Cells of a pair that the fit sees, drawn evenly: neighbours tell the same."""
BINS = 6
LEAST_IN_BIN = 200
LEAST_CELLS = 400
GROSS = 8.0
"""Differences of more standard deviations are mistakes: they count as false positives, not in the correlation."""
SAME_SIGMA = 1.2
"""Where the predicted sigmas of 90 % of the cells lie within this factor, a floor and a gain cannot be told apart."""


def repeat_pairs(count: int) -> list[tuple[int, int]]:
    """Pair scans so that each is used twice and the two of a pair lie nearly half of the series apart.

    Neighbours in time would hide slow drifts; all with the first would count its noise in every pair.
    """
    if count < 2:
        return []
    apart = max(1, (count - 1) // 2)
    pairs = {tuple(sorted((first, (first + apart) % count))) for first in range(count)}
    return sorted((first, second) for first, second in pairs)


def noise_model(repeats: Sequence[Comparison], use: npt.NDArray[np.bool_] | None = None) -> NoiseModel:
    """Fit the noise of differences.

    Parameters
    ----------
    repeats : sequence of Comparison
        Scans of an unchanged surface, each compared with the same first one; the first itself is their baseline.
    use : ndarray of bool, shape (rows, columns), optional
        Cells that did not change; all if left out.

    Returns
    -------
    NoiseModel
        So that 5 % of the cells lie beyond 1.96 sd, whatever the distribution's shape: in each bin of predicted sigma
        and slope the 95 % point of abs(dz) over 1.96 stands for the sd, a least-squares fit with no part below 0
        goes through the bins, and one factor makes it right over all. The correlation is that of dz / sd by lag, by
        FFT over all cells of all pairs. `false_positives` is by two-fold cross-validation over pairs.

    Raises
    ------
    ValueError
        If there is no scan beside the first, or fewer than 400 cells are common to a pair.
    """
    if not repeats:
        raise ValueError("a noise model needs at least two scans")
    first = repeats[0].baseline
    scans: list[Scan] = [first, *(each.scan for each in repeats)]
    pitch = first.grid.pitch_mm
    slope = local_slope(first.height, pitch)
    pairs = repeat_pairs(len(scans))
    samples = [_sample(scans[one], scans[two], slope, use) for one, two in pairs]
    terms = _fit(np.concatenate(samples, axis=1))
    cells = _table(np.concatenate(samples, axis=1), terms)
    held_back = [
        _beyond(np.concatenate(samples[half::2], axis=1), _fit(np.concatenate(samples[1 - half :: 2], axis=1)))
        for half in range(2)
        if len(samples) > 1
    ]
    motions = [each.change.motion.sigma_z_mm for each in repeats if np.isfinite(each.change.motion.sigma_z_mm)]
    floor, gain, sideways = (float(np.sqrt(term)) for term in terms)
    model = NoiseModel(
        floor,
        gain,
        sideways,
        correlation=np.ones(1),
        pitch_mm=pitch,
        sigma_z_mm=float(np.median(motions)) if motions else 0.0,
        false_positives=float(np.mean(held_back)) if held_back else float("nan"),
        scans=len(scans),
        pairs=len(pairs),
        first=format_instant(first.time),
        last=format_instant(scans[-1].time),
        calibration_id=first.calibration_id,
        ground="everything" if use is None else "stable areas",
        cells=cells,
    )
    return replace(model, correlation=_correlation(model, scans, pairs, slope, use))


def unrest(repeats: Sequence[Comparison], use: npt.NDArray[np.bool_] | None = None) -> float:
    """Tell how much more the first and the last of some scans differ than neighbours in time do.

    Parameters
    ----------
    repeats, use
        As for `noise_model`; the scans in the order of time.

    Returns
    -------
    float
        Ratio of robust standard deviations: about 1 for scans at rest, above it where the surface went on changing.
        NaN for fewer than three scans.
    """
    scans = [repeats[0].baseline, *(each.scan for each in repeats)] if repeats else []
    if len(scans) < 3:
        return float("nan")

    def spread(one: Scan, two: Scan) -> float:
        return robust_sigma(_difference(one, two)[0], use)

    steps = float(np.median([spread(one, two) for one, two in pairwise(scans)]))
    return spread(scans[0], scans[-1]) / steps if steps > 0 else float("nan")


def _difference(one: Scan, two: Scan) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Give dz and the sigma that the two scans predict for it."""
    return two.height - one.height, np.sqrt(one.sigma**2 + two.sigma**2)


def _sample(one: Scan, two: Scan, slope: npt.NDArray[np.float32], use: npt.NDArray[np.bool_] | None) -> Floats:
    """An even sample of a pair's cells, shape (3, n): abs(dz), predicted variance, slope squared."""
    dz, said = _difference(one, two)
    known = np.isfinite(dz) if use is None else np.isfinite(dz) & use
    where = np.flatnonzero(known)
    if where.size < LEAST_CELLS:
        raise ValueError(f"only {where.size} cells are common to two repeat scans, {LEAST_CELLS} are needed")
    # a step that shares no factor with a row's length would be neater; an odd one walks over all columns as well
    where = where[:: max(1, where.size // SAMPLED) | 1]
    return np.stack(
        [
            np.abs(dz.ravel()[where]).astype(np.float64),
            np.nan_to_num(said.ravel()[where]).astype(np.float64) ** 2,
            slope.ravel()[where].astype(np.float64) ** 2,
        ]
    )


def _fit(sample: Floats) -> Floats:
    """Variances (floor, gain, sideways) by least squares over the bins, scaled to 5 % beyond 1.96 sd in all."""
    from scipy.optimize import nnls

    absolute, said, steep = sample
    bins = _bins(said, steep)
    rows, targets, weights = [], [], []
    for number in np.unique(bins):
        inside = bins == number
        if inside.sum() < LEAST_IN_BIN:
            continue
        rows.append((1.0, float(said[inside].mean()), float(steep[inside].mean())))
        targets.append(max((float(np.quantile(absolute[inside], 0.95)) / Z_95) ** 2, 1e-18))
        weights.append(float(inside.sum()))
    design, target = np.array(rows).reshape(-1, 3), np.array(targets)
    if not target.size:
        return np.array([(float(np.quantile(absolute, 0.95)) / Z_95) ** 2, 0.0, 0.0])
    low, high = np.quantile(said, (0.05, 0.95))
    if 0 < high <= SAME_SIGMA**2 * low:
        design[:, 0] = 0.0
    # relative errors count: a bin of 1 um must be right to a tenth as one of 10 um is
    scale = np.sqrt(np.array(weights)) / target
    terms, _ = nnls(design * scale[:, None], target * scale)
    variance = terms @ np.stack([np.ones_like(said), said, steep])
    ratio = absolute / np.sqrt(np.maximum(variance, 1e-18))
    fitted: Floats = terms * (float(np.quantile(ratio, 0.95)) / Z_95) ** 2
    return fitted


def _bins(said: Floats, steep: Floats) -> npt.NDArray[np.intp]:
    """Number of each cell's bin: sixths of the predicted sigma, and in each of these sixths of the slope."""
    inner = np.arange(1, BINS) / BINS
    outer = np.searchsorted(np.unique(np.quantile(said, inner)), said)
    found = np.zeros(said.size, dtype=np.intp)
    for number in np.unique(outer):
        inside = outer == number
        edges = np.unique(np.quantile(steep[inside], inner))
        found[inside] = number * BINS + np.searchsorted(edges, steep[inside])
    return found


def _beyond(sample: Floats, terms: Floats) -> float:
    """Share of cells beyond 1.96 sd."""
    absolute, said, steep = sample
    variance = terms @ np.stack([np.ones_like(said), said, steep])
    return float((absolute > Z_95 * np.sqrt(variance)).mean())


def _table(sample: Floats, terms: Floats) -> tuple[NoiseCell, ...]:
    absolute, said, steep = sample
    bins = _bins(said, steep)
    cells = []
    for number in np.unique(bins):
        inside = bins == number
        part = sample[:, inside]
        middle = np.array([1.0, float(said[inside].mean()), float(steep[inside].mean())])
        cells.append(
            NoiseCell(
                sigma_mm=float(np.sqrt(middle[1])),
                slope=float(np.sqrt(middle[2])),
                count=int(inside.sum()),
                observed_mm=float(np.quantile(absolute[inside], 0.95)) / Z_95,
                model_mm=float(np.sqrt(terms @ middle)),
                beyond=_beyond(part, terms),
            )
        )
    return tuple(cells)


def _correlation(
    model: NoiseModel,
    scans: Sequence[Scan],
    pairs: Sequence[tuple[int, int]],
    slope: npt.NDArray[np.float32],
    use: npt.NDArray[np.bool_] | None,
) -> Floats:
    """Correlation of dz / sd by lag, pooled over the pairs, cut at its first value below zero."""

    def standardized(one: Scan, two: Scan) -> tuple[Floats, npt.NDArray[np.bool_]]:
        dz, said = _difference(one, two)
        score = dz / np.maximum(model.sd(said, slope), np.float32(1e-9))
        known = np.isfinite(score) & (np.abs(np.nan_to_num(score)) < GROSS)
        known = known if use is None else known & use
        return np.where(known, score, 0.0).astype(np.float64), known

    fields = (standardized(scans[one], scans[two]) for one, two in pairs)
    covariance = covariance_by_lag(fields, longest_lag(scans[0].grid.shape))
    if covariance[0] <= 0:
        return np.ones(1)
    below = np.flatnonzero(covariance <= 0)
    kept = covariance[: int(below[0])] if below.size else covariance
    correlation: Floats = kept / kept[0]
    return correlation
