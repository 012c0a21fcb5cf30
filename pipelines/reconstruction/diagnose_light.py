"""What became of the light: level, clipping, flicker, the room, exposures that caught two patterns, sharpness."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from .diagnose_order import pairs_of
from .diagnose_sample import Sample, quantile

__all__ = ["LightFigures", "light_figures"]

Doubles = npt.NDArray[np.float64]

FULL = 0.92
"""A pixel counts as dark in a pattern if its inverse exceeds this share of what light pixels have."""
WIDE = 0.8
"""Patterns of which half the pixels reach this share of white less black are wide enough to read dark levels off."""
CLEAR = 0.25
"""Variance of a frame (-1 to 1) from which on its noise, and the ends of its stripes, do not pass for a mixture."""
THIN = 3
"""Of the lit pixels, one in so many is looked at."""
FEW = 64
"""Pixels that a level is read from, at least."""
UNCERTAIN = 0.1
"""Swing of a stripe, as a share of white less black, below which `decode` is not certain of it."""
NARROWEST_PX = 1.95
"""Narrower stripes than 2 px (at the ends of a code some are cut) come out uneven and do not measure sharpness."""


@dataclass(frozen=True, slots=True, eq=False)
class LightFigures:
    """Figures of one capture whose frames are in order.

    Parameters
    ----------
    snr : float
        Swing of the strongest tenth of the pixels over the standard deviation of a pixel's value.
    noise : float
        That standard deviation, counts, from the pairs themselves.
    light : ndarray, shape (frame,)
        Light of the projector in each frame over that of the median frame; NaN where it cannot be told. A change that
        pattern and inverse share may be the room's as well.
    ambient : ndarray, shape (frame,)
        Dark level of each frame less that of the median frame, as a share of white less black; NaN likewise. Blur and
        light scattered in the scene raise it too, by as much in a pattern as in its inverse.
    mixed : ndarray, shape (frame,)
        Share of each frame's light that belongs to a neighbour in the sequence; NaN where it cannot be told.
    blurred : tuple of (str, float, float)
        By axis: share of the lit tiles in which half of the pixels see less than the decoder's least swing, in the
        finest pattern and in the one that is four times as wide.
    """

    snr: float
    noise: float
    light: Doubles
    ambient: Doubles
    mixed: Doubles
    blurred: tuple[tuple[str, float, float], ...]


def light_figures(sample: Sample) -> LightFigures:
    """Measure the light of each frame.

    Parameters
    ----------
    sample : Sample
        Of a capture whose frames are in order.

    Returns
    -------
    LightFigures
    """
    count = len(sample.tiles)
    light, ambient, mixed = (np.full(count, np.nan) for _ in range(3))
    noise = _pair_noise(sample)
    if sample.lit.any():
        share = sample.share[:, ::THIN]
        white, black = (next(n for n, r in enumerate(sample.roles) if r.what == what) for what in ("white", "black"))
        light[white] = quantile(share[white] + share[black])  # as of pairs, so that blur matters to neither
        ambient[black] = quantile(share[black])
        _levels_of_pairs(sample, light, ambient)
        _mixtures(sample, mixed, ambient - np.nanmedian(ambient))
        ambient -= np.nanmedian(ambient)
        middle = float(np.nanmedian(light))
        light /= middle if middle > 0 else 1.0
    snr = sample.strong / noise
    return LightFigures(snr, noise, light, ambient, mixed, tuple(_blurred(sample, noise)))


def _pair_noise(sample: Sample) -> float:
    """Standard deviation of a pixel's value, counts: what is left of pairs once level, light and stripes are out."""
    pairs = [(p, n) for _, _, p, n in pairs_of(sample.patterns) if n >= 0]
    if not pairs or sample.lit.sum() < FEW:
        return sample.noise
    swing = sample.swing[sample.lit][::THIN]
    share = sample.share[:, ::THIN]
    variances = []
    for p, n in pairs:
        rest = (share[p] + share[n] - 1) * swing
        columns = np.stack([swing, (share[p] - share[n]) * swing, np.ones_like(swing)])
        rest = rest - _project(columns, rest) @ columns
        variances.append(float(np.mean(np.square(rest))) / 2)
    # the quietest quarter of the pairs: a fault in others is none of the noise
    return max(sample.noise, sqrt(float(np.percentile(variances, 25))))


def _project(columns: npt.NDArray[np.float32], value: npt.NDArray[np.float32]) -> Doubles:
    """Least-squares coefficients of `value` in the rows of `columns`."""
    normal = (columns @ columns.T).astype(np.float64)
    normal += np.eye(len(normal)) * 1e-9 * max(float(np.trace(normal)), 1e-12)
    return np.asarray(np.linalg.solve(normal, (columns @ value).astype(np.float64)))


def _levels_of_pairs(sample: Sample, light: Doubles, ambient: Doubles) -> None:
    """Light of the frames of pairs from their sum, which blur leaves alone; dark levels where stripes are wide."""
    share = sample.share[:, ::THIN]
    for _, _, p, n in pairs_of(sample.patterns):
        if n < 0:
            continue
        stripes = share[p] - share[n]
        if stripes.var() < UNCERTAIN:  # even: one of them is all light
            light[p if stripes.mean() > 0 else n] = quantile(share[p] + share[n])
            continue
        level, tilt = _project(np.stack([np.ones_like(stripes), stripes]), share[p] + share[n])
        light[p], light[n] = level + tilt, level - tilt
        if quantile(np.abs(stripes)) < WIDE:
            continue
        for frame, partner in ((p, n), (n, p)):  # dark where its inverse is light, which says nothing of its own noise
            full = quantile(share[partner], 0.8)
            dark = share[frame][share[partner] > FULL * full]
            if full > 0.5 and len(dark) > FEW:
                ambient[frame] = quantile(dark)


def _mixtures(sample: Sample, mixed: Doubles, dark: Doubles) -> None:
    """Share of a neighbouring pattern in each frame of a pair, by least squares on what its partner says it should be.

    A pattern that holds some of its own inverse has a lower light level and, by as much, a higher dark level.
    """
    u = 2 * sample.share[:, ::THIN] - 1
    spread = u.var(axis=1)  # an even frame cannot be told from a change of the light
    even = np.ones(u.shape[1], np.float32)
    stray = sample.strong / sample.swing[sample.lit][::THIN]  # light that falls on the sensor, not on the object
    for _, _, p, n in pairs_of(sample.patterns):
        if n < 0 or max(spread[p], spread[n]) < CLEAR:
            continue
        for frame, partner in ((p, n), (n, p)):
            near = [k for k in (frame - 1, frame + 1) if 0 <= k < len(u) and k != partner and spread[k] > CLEAR]
            columns = np.stack([even, stray, -u[partner], *(u[k] for k in near)])
            offset, astray, own, *others = _project(columns, u[frame])
            offset = abs(offset) + abs(astray) * float(stray.mean())
            shares = [*others, 0.0]
            # with its own inverse: light falls by 2 a and dark rises by 2 a; less light alone leaves the dark
            if abs(frame - partner) == 1 and 1 - own > offset:
                part = (1 - own - offset - sum(others)) / 2
                raised = dark[frame]  # two lamps that differ have (1 - own) too, but black stays black
                shares.append(part if np.isnan(raised) else min(part, float(raised)))
            mixed[frame] = max(shares)


def _blurred(sample: Sample, noise: float) -> list[tuple[str, float, float]]:
    """By axis: share of the lit tiles where the finest, and the third finest, pattern is lost."""
    told = []
    lit = sample.lit
    pixels = lit.sum(axis=(1, 2))
    tiles = pixels > FEW
    if not tiles.any():
        return []
    owner = np.broadcast_to(np.arange(len(lit))[:, None, None], lit.shape)[lit]
    least = np.maximum(UNCERTAIN, 3 * sqrt(2) * noise / sample.swing[lit])
    for axis in ("columns", "rows"):
        wide = [
            (p, n)
            for (name, bit, p, n) in sorted(pairs_of(sample.patterns), key=lambda pair: pair[1])
            if name == axis and _width_px(sample, axis, bit) >= NARROWEST_PX
        ]
        if len(wide) < 3:
            continue
        shares = []
        for p, n in (wide[-1], wide[-3]):
            swing = np.abs(sample.share[p] - (sample.share[n] if n >= 0 else 1 - sample.share[p]))
            lost = np.bincount(owner, weights=swing < least, minlength=len(lit))
            shares.append(float((lost[tiles] > 0.5 * pixels[tiles]).mean()))
        told.append((axis, shares[0], shares[1]))
    return told


def _width_px(sample: Sample, axis: str, bit: int) -> float:
    """Mean width of the stripes of a pattern, projector px."""
    book = sample.patterns.codebook("columns" if axis == "columns" else "rows")
    sign = (book.word.astype(np.int64) >> (book.bits - 1 - bit)) & 1
    return float(book.width.sum() / (1 + np.count_nonzero(np.diff(sign))))
