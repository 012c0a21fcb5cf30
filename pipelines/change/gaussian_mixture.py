"""A covariance by lag as a mixture of Gaussians, from residuals of a plane: what the plane took is given back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["gaussian_mixture", "plane_shapes"]

Floats = npt.NDArray[np.float64]

NARROWEST_CELLS = 0.7
LONGEST_SHARE = 0.25
"""Standard deviation of the widest Gaussian, as a share of the map's shorter side."""
COARSE = 24
"""Blocks along the shorter side on which it is worked out what a plane takes: it is smooth."""
NEGLIGIBLE = 1e-3
LEAST_PART = 0.05
"""A Gaussian of a smaller share of the whole tells nothing of how well that is known."""


def gaussian_mixture(pairs: Floats, products: Floats, counts: Floats, block: int) -> tuple[Floats, float]:
    """Fit a mixture of Gaussians to the products of residuals.

    Every covariance by distance that is one in any number of dimensions is a mixture of Gaussians (Schoenberg 1938),
    and a mixture gives no sum a variance below 0. Errors e with covariance C leave residuals ``r = e - Q Q' e`` of a
    plane whose orthonormal shapes are Q, and ``E r r' = C - Q Q' C - C Q Q' + Q Q' C Q Q'``, summed over the pairs of
    cells at each lag, is what each Gaussian adds to the products. Least squares with no variance below 0, each lag
    weighted by its pairs.

    Parameters
    ----------
    pairs, products : ndarray of float64, shape (lags,)
        Pairs of cells by the lag of their blocks, and the sum of their residuals' products.
    counts : ndarray of float64, shape (rows, columns)
        Cells used of each block.
    block : int
        Side of a block, cells.

    Returns
    -------
    by_lag : ndarray of float64, shape (more lags,)
        Covariance at lags of 0, 1, 2, ... blocks, until it has vanished.
    freedom : float
        In how many independent values the part that reaches farthest was seen, less the plane's three and at least 1:
        ``n^2 / sum_ij rho_ij^2`` over the n cells (Bayley and Hammersley 1946).
    """
    from scipy.optimize import nnls

    lags = pairs.size
    widest = LONGEST_SHARE * min(counts.shape) * block
    scales = NARROWEST_CELLS * 2.0 ** np.arange(0, max(1.0, np.log2(widest / NARROWEST_CELLS)) + 0.5, 0.5)
    longest = max(lags, int(np.hypot(*counts.shape)))
    plain = np.stack([_white(longest, block), *(_rings(scale / block, block, longest) for scale in scales)])
    weight = np.sqrt(pairs)
    found = products / np.maximum(pairs, 1)
    size = max(float(found[0]), 1e-300)
    design = plain[:, :lags].T - _taken(counts, block, scales, lags)
    terms, _ = nnls(design * weight[:, None], found / size * weight)
    by_lag = size * terms @ plain
    # of the variance of a sum over wide ground, which goes by a covariance's integral over the plane
    part = terms * (plain @ np.maximum(1.0, 2 * np.pi * np.arange(longest)))
    cells, last = float(pairs[0]), int(np.flatnonzero(part >= LEAST_PART * part.sum())[-1])
    alike = float(pairs @ (plain[last, :lags] / plain[last, 0]) ** 2) if last else cells
    seen = np.flatnonzero(by_lag > NEGLIGIBLE * by_lag[0])
    return by_lag[: int(seen[-1]) + 1 if seen.size else 0], max(cells**2 / max(cells, alike) - 3, 1.0)


def _white(lags: int, block: int) -> Floats:
    found = np.zeros(lags)
    found[0] = 1 / block**2
    return found


def _between(lags: int, scale: float, side: int) -> Floats:
    """A Gaussian along one axis, its mean over the cells of two blocks that lie 0, 1, 2, ... blocks apart."""
    within = np.arange(1 - side, side)
    weight = (side - np.abs(within)) / side**2
    away = np.arange(lags)[:, None] * side + within
    found: Floats = np.exp(-(away**2) / (2 * scale**2)) @ weight
    return found


def _rings(scale_blocks: float, block: int, lags: int) -> Floats:
    """The same by distance in the plane: the mean over the lags along both axes that round to it."""
    one = _between(lags, scale_blocks * block, block)
    # beyond six standard deviations nothing is left
    near = min(lags, int(6 * scale_blocks) + 2)
    lag = np.rint(np.hypot(*np.ogrid[:near, :near])).astype(np.intp)
    twice = np.where(np.arange(near) > 0, 2.0, 1.0)
    both = np.outer(twice, twice)
    total = np.bincount(lag.ravel(), weights=(np.outer(one[:near], one[:near]) * both).ravel(), minlength=lags)
    number = np.bincount(lag.ravel(), weights=both.ravel(), minlength=lags)
    return np.where(np.arange(lags) < near, total[:lags] / np.maximum(number[:lags], 1), 0.0)


def _taken(counts: Floats, block: int, scales: Floats, lags: int) -> Floats:
    """What a plane takes from the mean product at each lag, of white noise and each Gaussian, shape (lags, 1 + n)."""
    step = max(1, min(counts.shape) // COARSE)
    rows, columns = (-(-n // step) for n in counts.shape)
    padded = np.zeros((rows * step, columns * step))
    padded[: counts.shape[0], : counts.shape[1]] = counts
    coarse = padded.reshape(rows, step, columns, step).sum(axis=(1, 3))
    shapes = plane_shapes(coarse)
    reach = min(-(-(lags - 1) // step) + 1, min(rows, columns) - 1)
    number = np.maximum(_by_distance(coarse, coarse, reach), 1.0)
    own = [[_by_distance(one, other, reach) for other in shapes] for one in shapes]
    cells = np.where(coarse > 0, coarse, 1.0)
    found = []
    side = block * step
    for scale in (None, *scales):
        if scale is None:
            carried = [shape / cells for shape in shapes]
        else:
            along, across = (_toeplitz(_between(n, scale, side)) for n in (rows, columns))
            carried = [along @ shape @ across for shape in shapes]
        lost = 2 * sum(_by_distance(one, far * coarse, reach) for one, far in zip(shapes, carried, strict=True))
        for k, one in enumerate(shapes):
            for m in range(len(shapes)):
                lost -= float((one * carried[m]).sum()) * own[k][m]
        found.append(np.interp(np.arange(lags), np.arange(reach + 1) * step, lost / number))
    return np.stack(found, axis=1)


def _toeplitz(first: Floats) -> Floats:
    away = np.abs(np.subtract.outer(np.arange(first.size), np.arange(first.size)))
    found: Floats = first[away]
    return found


def _by_distance(one: Floats, other: Floats, reach: int) -> Floats:
    """Sum of the products of one map's values with another's by the distance of their cells, to `reach`."""
    from scipy import fft

    shape = [fft.next_fast_len(n + reach, real=True) for n in one.shape]
    products = fft.irfft2(np.conj(fft.rfft2(one, shape)) * fft.rfft2(other, shape), shape)
    ahead = np.arange(-reach, reach + 1)
    near = products[np.ix_(ahead % shape[0], ahead % shape[1])]
    lag = np.rint(np.hypot(ahead[:, None], ahead[None, :])).astype(np.intp)
    sums: Floats = np.bincount(lag.ravel(), weights=near.ravel())[: reach + 1].astype(np.float64)
    return sums


def plane_shapes(counts: Floats) -> list[Floats]:
    """1, row and column on the cells of blocks, made orthonormal, summed by blocks; `counts` is cells used of each."""
    row, column = (np.arange(n, dtype=np.float64) - n / 2 for n in counts.shape)
    rows, columns = np.broadcast_to(row[:, None], counts.shape), np.broadcast_to(column[None, :], counts.shape)
    shapes: list[Floats] = []
    for plain in (np.ones(counts.shape), rows, columns):
        shape = plain.copy()
        # Gram and Schmidt, twice: once leaves what rounding made of nearly parallel shapes
        for other in shapes * 2:
            shape -= float(np.einsum("ij,ij,ij", shape, other, counts)) * other
        size = float(np.sqrt(np.einsum("ij,ij,ij", shape, shape, counts)))
        shapes.append(shape / size if size > 0 else shape)
    return [shape * counts for shape in shapes]
