"""Noise, and how unevenly the light shone, estimated from the frames themselves: a sample of pixels is enough."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from .codebook import MAX_BITS
from .frames import Frames
from .patterns import AXES, PatternSet

__all__ = ["ROUNDING", "Light", "fit_pairs", "frame_indices", "frame_of", "read_light"]

RUN = 64
"""Pixels are looked at in runs of so many neighbours: scattered single ones cost a cache miss each."""
RUNS = 8
ROUNDING = 0.29
"""Standard deviation of rounding to whole counts, 1 / sqrt(12)."""
FEW = 16
OUTLIER = 4.0
RIDGE = 1e-3
"""Where a pattern is even all over the sample its light cannot be told from its stripes: then it is taken for right."""

Floats = npt.NDArray[np.float32]
Frame = npt.NDArray[np.int64]
Row = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """What the frames say of their light.

    Parameters
    ----------
    noise : float
        Standard deviation of a pixel's value, counts.
    tilt : ndarray of float32, shape (2, MAX_BITS)
        By axis and bit, coarsest first: what uneven light adds to pattern minus inverse (without inverses: to twice
        the pattern minus white and black) at an edge, as a share of white minus black.
    """

    noise: float
    tilt: Floats


def read_light(frames: Frames, runs: int = RUNS) -> Light:
    """Estimate noise and light.

    With inverses, pattern + inverse - white - black is 0 under even light: what there is of it in proportion to
    pattern minus inverse says by how much one of the two outshone the other, and the scatter that is left is noise.
    Without inverses noise is that of the black frame's second differences along rows.

    Parameters
    ----------
    frames : Frames
    runs : int
        Runs of 64 pixels to look at.

    Returns
    -------
    Light
    """
    tilt = np.zeros((2, MAX_BITS), np.float32)
    white, black = frame_of(frames.patterns, "white"), frame_of(frames.patterns, "black")
    if not frames.patterns.complementary:
        return Light(_dark_noise(frames.stack[black]), tilt)
    flat = frames.stack.reshape(len(frames.stack), -1)
    starts = np.linspace(0, max(0, flat.shape[1] - RUN), runs).astype(np.int64)
    at = (starts[:, np.newaxis] + np.arange(min(RUN, flat.shape[1]))).reshape(-1)
    values = flat[:, at]
    sample = values[:, values.max(axis=0) < np.iinfo(flat.dtype).max].astype(np.float32)
    if sample.shape[1] < FEW:
        return Light(0.0, tilt)
    bits, plus, minus = frame_indices(frames.patterns)
    of = np.arange(MAX_BITS) < bits[:, np.newaxis]
    noise, tilt[of] = fit_pairs(sample, white, black, plus[of], minus[of])
    return Light(noise, tilt)


def fit_pairs(sample: Floats, white: int, black: int, plus: Frame, minus: Frame) -> tuple[float, Floats]:
    """Noise and tilt of pairs of pattern and inverse, by least squares without outliers.

    Parameters
    ----------
    sample : ndarray of float32, shape (frame, pixel)
        Counts, none of them clipped.
    white, black : int
        Frames.
    plus, minus : ndarray of int, shape (pair,)
        Frames of the patterns and of their inverses.

    Returns
    -------
    noise : float
        Standard deviation of a pixel's value, counts.
    tilt : ndarray of float32, shape (pair,)
        Light of the pattern less that of its inverse, over their sum; 0 where it does not exceed two standard errors.
    """
    level, tilt, error = (np.empty(len(plus)) for _ in range(3))
    noise = _fit(sample, white, black, plus, minus, level, tilt, error)
    return noise, np.where(np.abs(tilt) > 2 * error, tilt * (1 + level), 0).astype(np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _fit(sample: Floats, white: int, black: int, plus: Frame, minus: Frame, level: Row, tilt: Row, error: Row) -> float:
    """Fit each pair twice, the second time without outliers; gives the noise. A library would start threads."""
    pairs, pixels = len(plus), sample.shape[1]
    rest = np.empty((pairs, pixels), np.float32)
    used = np.ones((pairs, pixels), np.bool_)
    variance = 0.0
    for turn in range(2):
        squares, number = 0.0, 0
        for k in range(pairs):
            ss, st, tt, s1, t1, count, sr, tr, r1 = 1e-6, 0.0, 1e-6, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0
            for i in range(pixels):
                if used[k, i]:
                    w, b, p, n = sample[white, i], sample[black, i], sample[plus[k], i], sample[minus[k], i]
                    s, t, r = w - b, p - n, p + n - w - b
                    ss += s * s
                    st += s * t
                    tt += t * t
                    s1 += s
                    t1 += t
                    count += 1
                    sr += s * r
                    tr += t * r
                    r1 += r
            tt += RIDGE * ss
            # without the mean first, then two unknowns
            a, c, d = ss - s1 * s1 / count, st - s1 * t1 / count, tt - t1 * t1 / count
            e, f = sr - s1 * r1 / count, tr - t1 * r1 / count
            # as even a scene as this tells nothing of its level: that goes to the offset
            a += 1e-6 * ss
            det = a * d - c * c
            level[k], tilt[k] = (e * d - f * c) / det, (a * f - c * e) / det
            offset = (r1 - level[k] * s1 - tilt[k] * t1) / count
            error[k] = np.sqrt(a / det)
            for i in range(pixels):
                w, b, p, n = sample[white, i], sample[black, i], sample[plus[k], i], sample[minus[k], i]
                rest[k, i] = p + n - w - b - level[k] * (w - b) - tilt[k] * (p - n) - offset
                if used[k, i]:
                    squares += rest[k, i] * rest[k, i]
                    number += 1
        variance = squares / max(number, 1)
        if turn == 0:  # whole counts make a median coarse: it only says what is an outlier
            far = OUTLIER * max(1.4826 * np.median(np.abs(rest[:, ::4]).copy().reshape(-1)), 1.0)
            for k in range(pairs):
                for i in range(pixels):
                    used[k, i] = abs(rest[k, i]) <= far
    noise = np.sqrt(variance) / 2
    for k in range(pairs):
        error[k] *= 2 * noise
    return float(noise)


def _dark_noise(black: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> float:
    dark = black[:: max(1, len(black) // 64)].astype(np.float32)
    second = dark[:, 2:] - 2 * dark[:, 1:-1] + dark[:, :-2]
    if not second.size:
        return 0.0
    far = OUTLIER * max(1.4826 * float(np.median(np.abs(second))), 1.0)
    return float(np.sqrt(np.mean(np.square(second[np.abs(second) <= far])) / 6))


def frame_of(patterns: PatternSet, what: str) -> int:
    """Index of the white or the black frame."""
    return next(number for number, role in enumerate(patterns.roles) if role.what == what)


def frame_indices(patterns: PatternSet) -> tuple[Frame, Frame, Frame]:
    """Which frame shows which bit.

    Returns
    -------
    bits : ndarray, shape (2,)
        Bits along columns, rows.
    plus, minus : ndarray, shape (2, MAX_BITS)
        Frame of each bit, coarsest first, and of its inverse; -1 where there is none.
    """
    plus = np.full((2, MAX_BITS), -1, dtype=np.int64)
    minus = np.full((2, MAX_BITS), -1, dtype=np.int64)
    for frame, role in enumerate(patterns.roles):
        if role.what == "bit" and role.axis:
            (minus if role.inverted else plus)[AXES.index(role.axis), role.index] = frame
    return np.array(patterns.bits, dtype=np.int64), plus, minus
