"""Do stripes follow their code? What the sign of each pattern is at the edges of the others, and which words exist."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .codebook import Codebook

__all__ = ["edge_votes", "planes_of", "valid_share"]

Doubles = npt.NDArray[np.float64]

SEEN = 24
"""Pixels that an edge must cross before it counts."""
FAINT = 0.15
"""A stripe pattern with a smaller mean swing says nothing of its order."""
DENSE = 0.3
"""Stripes that change their sign more often than this per camera pixel are too narrow to have one at an edge."""


def edge_votes(
    signal: npt.NDArray[np.float32], lit: npt.NDArray[np.bool_], planes: npt.NDArray[np.bool_]
) -> tuple[Doubles, list[float]]:
    """Compare the sign of each pattern at the edges of all others with what the code says there.

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
    for one, other in ((np.s_[..., 1:], np.s_[..., :-1]), (np.s_[..., 1:, :], np.s_[..., :-1, :])):
        both = lit[one] & lit[other]
        a, b = signal[one][:, both], signal[other][:, both]
        edge = ((a * b < 0) & (np.abs(a - b) > 0.5)).astype(np.float32)
        middle = (a + b) / 2
        seen += edge.sum(axis=1, keepdims=True)
        density = np.maximum(density, (a * b < 0).mean(axis=1) if a.shape[1] else 1.0)
        found += edge @ middle.T
        size += edge @ np.abs(middle).T
    usable = (np.abs(expected) > 0.95) & (seen >= SEEN) & (size > FAINT * seen)
    usable &= ~np.eye(bits, dtype=bool) & (density < DENSE)
    right = np.where(usable, found * np.sign(expected) / np.maximum(size, 1e-6), 0)
    weight = usable.sum(axis=0)
    votes = right.sum(axis=0) / np.maximum(weight, 1)
    return votes, [float(vote) for vote, there in zip(votes, weight, strict=True) if there]


def planes_of(book: Codebook) -> npt.NDArray[np.bool_]:
    """What each projector pixel carries, shape (bits, pixel), coarsest first."""
    word = np.repeat(book.word.astype(np.int64), book.width)
    planes: npt.NDArray[np.bool_] = (word >> np.arange(book.bits - 1, -1, -1)[:, np.newaxis]) & 1 == 1
    return planes


def valid_share(signal: npt.NDArray[np.float32], book: Codebook) -> float:
    """Share of pixels whose word the set projects, of those where every pattern is clear."""
    clear = (np.abs(signal) > FAINT).all(axis=0)
    if clear.sum() < SEEN:
        clear = np.ones(signal.shape[1], np.bool_)
    weights = 1 << np.arange(book.bits - 1, -1, -1)
    words = weights @ (signal[:, clear] > 0)
    return float((book.cell[words] >= 0).mean()) if words.size else 1.0
