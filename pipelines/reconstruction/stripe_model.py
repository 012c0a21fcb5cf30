"""What a blurred camera should see of stripes along an axis: the swing of every bit, and what may read as a word."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba as nb
import numpy as np
import numpy.typing as npt

from .codebook import stripe_planes
from .patterns import AXES, Axis, PatternSet

__all__ = ["GROUP", "LANES", "STRIDE", "WIDTH", "SwingModel", "apart", "swing_model"]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

WIDTH = 16
"""Bits are padded to so many, so that loops over them have a fixed length and become vector instructions."""
STRIDE = 2
"""Every other sample is enough to find the best one."""
GROUP, LANES = 4, 8
"""So many bits and so many samples are compared at once."""
SHARPEST_PX, BLURRIEST, BLURS = 0.15, 1.1, 17
"""Blurs of the tables: standard deviations, from one in projector px to one in cells of the finest stripes."""
BLUR_SHARE = 0.12
"""How far the blur of a pixel lies from that of its tile, a share: it changes with the slope of the surface."""
DOUBT = 0.35
"""A bit whose expected swing stays closer to zero may be read either way."""
BLANK, PLAIN = 4, 0.1
"""So many patterns at once that are neither black nor white are a boundary of all, or light from elsewhere; of patterns
that blur leaves plain to see: mean square of their swings."""
DRAWN = 16
"""Samples per projector pixel at which the stripes are drawn before they are blurred."""


@dataclass(frozen=True, slots=True, eq=False)
class SwingModel:
    """Expected swings, pattern minus inverse over white minus black, along one axis.

    Parameters
    ----------
    bits : int
    per_px : int
        Samples per projector pixel; sample s is the place ``(s + 0.5) / per_px - 0.5`` px.
    cell_px : float
        Mean width of the finest stripes.
    blur_px : ndarray of float32, shape (blur,)
        Standard deviation of the Gaussian that stands for the optics, ascending.
    swing, loose : ndarray of float32, shape (blur, sample, WIDTH)
        The expected swing of each bit, -1 to 1, and the variance that a blur not quite known adds to it. Bits beyond
        `bits` are 0.
    comb : ndarray of float32, shape (blur * STRIDE * WIDTH * n + LANES,)
        `swing` once more, as it is gone through: by blur, even or odd sample, and bit, n samples side by side.
    power : ndarray of float32, shape (blur, bit)
        Mean square of the swing along the axis.
    blank : ndarray of bool, shape (blur, sample)
        Where `BLANK` patterns and more are neither black nor white.
    first : ndarray of int32, shape (blur, 2 ** bits + 1)
        Where the candidates of each word begin.
    candidate : ndarray of int32, shape (n,)
        Projector pixels that may read as a word, ascending within it.
    """

    bits: int
    per_px: int
    cell_px: float
    blur_px: F32
    swing: F32
    loose: F32
    comb: F32
    power: F32
    blank: npt.NDArray[np.bool_]
    first: I32
    candidate: I32

    @property
    def near_px(self) -> float:
        """Two places nearer than this are one place, known badly: two cells, and no less than two pixels."""
        return max(2 * self.cell_px, 2.0)


@lru_cache(maxsize=8)
def swing_model(patterns: PatternSet, axis: Axis) -> SwingModel:
    """Blur the stripes of an axis by every blur of the table."""
    from scipy.ndimage import gaussian_filter1d

    length = patterns.size[AXES.index(axis)]
    planes = stripe_planes(length, patterns.counts)
    bits = len(planes)
    cell = length / max(patterns.counts)
    per_px = 8 if cell < 2 else 4
    drawn = np.repeat(np.where(planes, 1.0, -1.0), DRAWN, axis=1)
    blurs = np.geomspace(SHARPEST_PX, BLURRIEST * cell, BLURS)

    def blurred(sigma_px: float) -> npt.NDArray[np.float64]:
        line = gaussian_filter1d(drawn, sigma_px * DRAWN, axis=1, mode="nearest", truncate=5.0)
        thin = DRAWN // per_px
        swings: npt.NDArray[np.float64] = line.reshape(bits, -1, thin).mean(axis=2)
        return swings

    swing, loose = np.zeros((2, BLURS, length * per_px, WIDTH), np.float32)
    power = np.empty((BLURS, bits), np.float32)
    first = np.empty((BLURS, 2**bits + 1), np.int32)
    candidates = []
    begin = 0
    for n, sigma in enumerate(blurs):
        here = blurred(sigma)
        swing[n, :, :bits] = here.T
        change = (blurred(sigma * (1 + BLUR_SHARE)) - blurred(sigma * (1 - BLUR_SHARE))) / 2
        loose[n, :, :bits] = np.square(change).T
        power[n] = np.square(here).mean(axis=1)
        edges, found = _candidates(here.reshape(bits, length, per_px))
        first[n] = edges + begin
        candidates.append(found)
        begin += len(found)
        blur_px = blurs.astype(np.float32)
    comb = np.append(swing.reshape(BLURS, -1, STRIDE, WIDTH).transpose(0, 2, 3, 1), np.zeros(LANES, np.float32))
    grey = (np.abs(swing[..., :bits]) < DOUBT) & (power[:, np.newaxis] > PLAIN)
    blank = grey.sum(axis=2) >= BLANK
    return SwingModel(bits, per_px, cell, blur_px, swing, loose, comb, power, blank, first, np.concatenate(candidates))


@lru_cache(maxsize=32)
def apart(patterns: PatternSet, axis: Axis, blur: int) -> F32:
    """How far each sample's swings are from those of any place that is not near it (`SwingModel.near_px`).

    Returns
    -------
    ndarray of float32, shape (sample,)
        Euclidean. No place that is far can look more like what a pixel saw than this, less how far what it saw is from
        the sample: the inequality of the triangle.
    """
    model = swing_model(patterns, axis)
    swing = model.swing[blur]
    distance = np.full(len(swing), np.inf, np.float32)
    _apart(swing, round(model.near_px * model.per_px), distance)
    return np.sqrt(distance)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _apart(swing, near, distance):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for a in range(len(swing)):
        for b in range(a + near + 1, len(swing)):
            total = np.float32(0)
            for k in range(WIDTH):
                d = swing[a, k] - swing[b, k]
                total += d * d
            distance[a] = min(distance[a], total)
            distance[b] = min(distance[b], total)


def _candidates(swing: npt.NDArray[np.float64]) -> tuple[I32, I32]:
    """Where the candidates of each word begin, and the candidates; `swing` is (bit, px, sample)."""
    bits, length, _ = swing.shape
    reach = np.pad(swing, ((0, 0), (1, 1), (0, 0)), mode="edge")
    beside = np.concatenate([reach[:, :-2, -1:], swing, reach[:, 2:, :1]], axis=2)
    doubt = (beside.min(axis=2) < DOUBT) & (beside.max(axis=2) > -DOUBT)
    white = swing.mean(axis=2) > 0
    pixel, word = np.arange(length), np.zeros(length, np.int64)
    for bit in range(bits):
        weight = 1 << (bits - 1 - bit)
        word = word + weight * (white[bit] & ~doubt[bit])[pixel]
        both = doubt[bit][pixel]
        pixel, word = np.concatenate([pixel, pixel[both]]), np.concatenate([word, word[both] + weight])
    order = np.lexsort((pixel, word))
    return np.searchsorted(word[order], np.arange(2**bits + 1)).astype(np.int32), pixel[order].astype(np.int32)
