"""Do stripes follow their code? What the sign of each pattern is at the edges of the others, and which words exist."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .codebook import Codebook

__all__ = ["edge_votes", "neighbours", "planes_of", "valid_share"]

Doubles = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]
Pairs = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]
"""Numbers, among the lit pixels, of pixels and of their neighbours."""

SEEN = 24
"""Pixels that an edge must cross before it counts."""
FAINT = 0.15
"""A stripe pattern with a smaller mean swing says nothing of its order."""
DENSE = 0.3
"""Stripes that change their sign more often than this per camera pixel are too narrow to have one at an edge."""


def neighbours(lit: npt.NDArray[np.bool_]) -> tuple[Pairs, Pairs]:
    """Lit pixels of tiles, (tile, row, column), that lie side by side, and those that lie one above the other."""
    number = np.cumsum(lit, dtype=np.int32).reshape(lit.shape) - 1
    found = []
    for one, other in ((np.s_[..., 1:], np.s_[..., :-1]), (np.s_[..., 1:, :], np.s_[..., :-1, :])):
        both = lit[one] & lit[other]
        found.append((number[one][both], number[other][both]))
    return found[0], found[1]


def edge_votes(
    signal: Floats, pairs: tuple[Pairs, Pairs], planes: npt.NDArray[np.bool_]
) -> tuple[Doubles, list[float]]:
    """Compare the sign of each pattern at the edges of all others with what the code says there.

    Parameters
    ----------
    signal : ndarray of float32, shape (pixel, bits)
        Pattern minus inverse of the lit pixels, -1 to 1.
    pairs : (Pairs, Pairs)
        Of `neighbours`.
    planes : ndarray of bool, shape (bits, projector pixel)

    Returns
    -------
    votes : ndarray, shape (bits,)
        1 where the sign is right at all edges, -1 where it is turned, 0 where nothing is known.
    agreements : list of float
        The same for each pattern that says something.
    """
    bits = len(planes)
    plus = np.where(planes, 1.0, -1.0)
    flips = (planes[:, 1:] != planes[:, :-1]).astype(float)
    expected = flips @ ((plus[:, 1:] + plus[:, :-1]) / 2).T / np.maximum(flips.sum(axis=1, keepdims=True), 1)
    seen, found, size = np.zeros((bits, 1)), np.zeros((bits, bits)), np.zeros((bits, bits))
    density = np.zeros(bits)
    for one, other in pairs:
        crossed = np.zeros(bits)
        _add_edges(signal, one, other, crossed, seen[:, 0], found, size)
        density = np.maximum(density, crossed / len(one) if len(one) else 1.0)
    usable = (np.abs(expected) > 0.95) & (seen >= SEEN) & (size > FAINT * seen)
    usable &= ~np.eye(bits, dtype=bool) & (density < DENSE)
    right = np.where(usable, found * np.sign(expected) / np.maximum(size, 1e-6), 0)
    weight = usable.sum(axis=0)
    votes = right.sum(axis=0) / np.maximum(weight, 1)
    return votes, [float(vote) for vote, there in zip(votes, weight, strict=True) if there]


@nb.njit(cache=True, nogil=True)
def _add_edges(signal, one, other, crossed, seen, found, size):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add up, for each pattern, its changes of sign, those that are clear, and what every pattern shows at these."""
    bits = signal.shape[1]
    for pair in range(one.size):
        m, n = one[pair], other[pair]
        for bit in range(bits):
            a, b = signal[m, bit], signal[n, bit]
            if a * b < 0:
                crossed[bit] += 1
                if abs(a - b) > np.float32(0.5):
                    seen[bit] += 1
                    for each in range(bits):
                        middle = (signal[m, each] + signal[n, each]) / 2
                        found[bit, each] += middle
                        size[bit, each] += abs(middle)


def planes_of(book: Codebook) -> npt.NDArray[np.bool_]:
    """What each projector pixel carries, shape (bits, pixel), coarsest first."""
    word = np.repeat(book.word.astype(np.int64), book.width)
    planes: npt.NDArray[np.bool_] = (word >> np.arange(book.bits - 1, -1, -1)[:, np.newaxis]) & 1 == 1
    return planes


def valid_share(signal: Floats, book: Codebook) -> float:
    """Share of pixels whose word the set projects, of those where every pattern is clear; `signal` is (pixel, bits)."""
    clear, valid, any_valid = _count_words(signal, book.cell)
    if clear < SEEN:
        clear, valid = len(signal), any_valid
    return valid / clear if clear else 1.0


@nb.njit(cache=True, nogil=True)
def _count_words(signal, cell):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Pixels whose patterns are all clear, those of them whose word there is, and pixels whose word there is."""
    clear, valid, any_valid = 0, 0, 0
    for pixel in range(len(signal)):
        word, sure = 0, True
        for bit in range(signal.shape[1]):
            word = (word << 1) | (signal[pixel, bit] > 0)
            sure &= abs(signal[pixel, bit]) > np.float32(FAINT)
        there = cell[word] >= 0
        clear += sure
        valid += sure & there
        any_valid += there
    return clear, valid, any_valid
