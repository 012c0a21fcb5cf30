"""Vertical offset and tilt from ground that did not move; and such ground, found where nobody marked it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs
from .ranks import MAD_TO_SIGMA, median, robust_sigma

__all__ = ["Plane", "fit_plane", "largest_consensus", "levelling", "mean_plane"]

CLIP = 4.685  # Tukey's biweight constant
TRIPLES = 400
TAIL = 3.0
"""Residuals of more spreads are a distribution's tails."""
LOPSIDED = 0.25
"""Tails that differ by more than this share of both are not alike."""
MISTAKE = 8.0
"""Residuals of more spreads are no errors of measurement."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """``z = c + a (x - x0) + b (y - y0)`` with its spread and covariance.

    `level` is (c, a, b), mm and mm per mm; `centre` (x0, y0) is the middle of the cells used; `residual` is the
    robust standard deviation about the plane; `covariance` (3, 3) is that of `level`.
    """

    level: npt.NDArray[np.float64]
    centre: tuple[float, float]
    residual: float
    covariance: npt.NDArray[np.float64]


def fit_plane(
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    z: npt.NDArray[np.float64],
    *,
    per_patch: float = 1.0,
    tilt: bool = True,
) -> Plane | None:
    """Fit a plane with Tukey weights.

    Parameters
    ----------
    x, y, z : ndarray of float64, shape (n,)
        Finite, mm.
    per_patch : float
        Number of neighbouring values that share one error: the covariance grows by it.
    tilt : bool
        Fit the tilt too; otherwise the offset alone.

    Returns
    -------
    Plane or None
        None where fewer than 10 values are left or they lie on one line.
    """
    if z.size < 10:
        return None
    centre = (float(x.mean()), float(y.mean()))
    columns = [np.ones_like(z)] + ([x - centre[0], y - centre[1]] if tilt else [])
    design = np.stack(columns, axis=1)
    level = np.zeros(design.shape[1])
    level[0] = np.median(z)
    normal = np.zeros((design.shape[1], design.shape[1]))
    residual = 0.0
    for _ in range(20):
        r = z - design @ level
        residual = float(MAD_TO_SIGMA * np.median(np.abs(r - np.median(r))))
        e = r / (CLIP * max(residual, 1e-9))
        weight = np.where(np.abs(e) < 1, (1 - e * e) ** 2, 0.0)
        normal = design.T @ (weight[:, None] * design)
        if np.linalg.cond(normal) > 1e12:
            return None
        step = np.linalg.solve(normal, design.T @ (weight * r))
        level = level + step
        if np.abs(step).max() < 1e-9:
            break
    covariance = np.zeros((3, 3))
    size = design.shape[1]
    covariance[:size, :size] = residual**2 * max(1.0, per_patch) * np.linalg.inv(normal)
    return Plane(np.append(level, np.zeros(3 - size)), centre, residual, covariance)


def mean_plane(
    plane: Plane,
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    dz: npt.NDArray[np.float32],
    held: npt.NDArray[np.bool_],
) -> Plane:
    """Fit by plain least squares over all cells what a robust fit began, where both tails of its residuals weigh alike.

    Tails on both sides are errors, whose mean is what a volume or a mean height must be free of; a robust fit follows
    the mode instead. A heavier tail on one side is change that the ground was not spared, and the robust fit stays.

    Parameters
    ----------
    plane : Plane
        The robust fit.
    x, y : ndarray of float64, shapes (columns,) and (rows,)
        Cell centres, mm.
    dz : ndarray of float32, shape (rows, columns)
    held : ndarray of bool, shape (rows, columns)
        Cells that hold still, all measured.
    """
    across, along = x - plane.centre[0], y - plane.centre[1]
    offset, a, b = (np.float32(each) for each in plane.level)
    off = np.where(held, dz - (offset + a * across.astype(np.float32) + b * along.astype(np.float32)[:, None]), 0)
    bound = TAIL * max(plane.residual, 1e-9)
    above, below = int((off > bound).sum()), int((off < -bound).sum())
    if abs(above - below) > LOPSIDED * (above + below) + 4 * np.sqrt(above + below):
        return plane
    use = held & (np.abs(off) < MISTAKE * max(plane.residual, 1e-9))
    off = np.where(use, off, np.float32(0))
    by_row, by_column = use.sum(axis=1, dtype=np.float64), use.sum(axis=0, dtype=np.float64)
    mixed = float(along @ (use @ across))
    normal = np.array(
        [
            [by_row.sum(), by_column @ across, by_row @ along],
            [by_column @ across, by_column @ across**2, mixed],
            [by_row @ along, mixed, by_row @ along**2],
        ]
    )
    over_rows = off.sum(axis=1, dtype=np.float64)
    right = np.array([over_rows.sum(), off.sum(axis=0, dtype=np.float64) @ across, over_rows @ along])
    if np.linalg.cond(normal) > 1e12:
        return plane
    return replace(plane, level=plane.level + np.linalg.solve(normal, right))


def levelling(plane: Plane, height_mm: float) -> npt.NDArray[np.float64]:
    """Rigid motion (4 x 4) that takes a plane of dz out: a small turn about its centre at this height, and a lift."""
    offset, a, b = plane.level
    # exp of the rotation vector (-b, a, 0) turns (x, y, 0) into (.., .., -a x - b y) to first order
    angle = float(np.hypot(a, b))
    rotation = np.eye(3)
    if angle > 0:
        skew = np.array([[0.0, 0.0, a], [0.0, 0.0, b], [-a, -b, 0.0]]) / angle
        rotation += np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    pivot = np.array([*plane.centre, height_mm])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = pivot - rotation @ pivot - np.array([0.0, 0.0, offset])
    return matrix


@njit(cache=True, nogil=True)
def _at_rank(keys, count, rank):  # type: ignore[no-untyped-def]  # numba infers the types
    """Key of a rank (from 0) among the first `count`: by halving, 32 counts in wide registers."""
    low, high = np.int64(-(2**31)), np.int64(2**31 - 1)
    while low < high:
        middle = (low + high) >> 1
        bound = np.int32(middle)
        below = 0
        for k in range(count):
            below += keys[k] <= bound
        if below > rank:
            high = middle
        else:
            low = middle + 1
    return np.int32(low)


@njit(cache=True, nogil=True)
def _ordered(bits):  # type: ignore[no-untyped-def]  # as above
    """Bits of a float32 to a whole number in the order of the floats, and back."""
    return np.int32(bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF)))


@njit(cache=True, nogil=True)
def _patches(dz, patch, medians, rest, first, last):  # type: ignore[no-untyped-def]  # as above
    """Median of each patch of which half is known, and what is left of its cells without it; rows of patches."""
    keys = np.empty(patch * patch, dtype=np.int32)
    for r in range(first, last):
        for c in range(medians.shape[1]):
            count = 0
            for i in range(r * patch, (r + 1) * patch):
                for j in range(c * patch, (c + 1) * patch):
                    if np.isfinite(dz[i, j]):
                        keys[count] = _ordered(np.float32(dz[i, j]).view(np.int32))
                        count += 1
            if 2 * count < patch * patch:
                continue
            lower = np.int32(_ordered(_at_rank(keys, count, (count - 1) // 2))).view(np.float32)
            upper = lower if count % 2 else np.int32(_ordered(_at_rank(keys, count, count // 2))).view(np.float32)
            medians[r, c] = (lower + upper) / np.float32(2)
            for i in range(r * patch, (r + 1) * patch):
                for j in range(c * patch, (c + 1) * patch):
                    rest[i, j] = dz[i, j] - medians[r, c]


@njit(cache=True, nogil=True)
def _agreeing(values, x, y, planes, bound, counts, first, last):  # type: ignore[no-untyped-def]  # as above
    for k in range(first, last):
        c, a, b = planes[k, 0], planes[k, 1], planes[k, 2]
        count = 0
        for p in range(values.size):
            count += abs(values[p] - (c + a * x[p] + b * y[p])) < bound
        counts[k] = count


def largest_consensus(
    dz: npt.NDArray[np.float32], sigma: npt.NDArray[np.float32], patch: int = 12
) -> tuple[npt.NDArray[np.bool_], float]:
    """Find the largest set of cells that one plane of dz explains: where nothing changed but the rig's position.

    Parameters
    ----------
    dz : ndarray of float32, shape (rows, columns)
        Difference of heights, mm, NaN where not measured.
    sigma : ndarray of float32, shape (rows, columns)
        Standard uncertainty of `dz`.
    patch : int
        Side of the square patches that vote, cells.

    Returns
    -------
    stable : ndarray of bool, shape (rows, columns)
    share : float
        Of the patches, how many agree. Below a half, what moved and what stayed cannot be told apart.
    """
    rows, columns = (n // patch for n in dz.shape)
    if rows * columns < 8:
        return np.isfinite(dz), 0.0
    of_patch = np.full((rows, columns), np.nan, dtype=np.float32)
    rest = np.full(dz.shape, np.nan, dtype=np.float32)
    in_slabs(rows, lambda first, last: _patches(dz, patch, of_patch, rest, first, last), least=4)
    full = np.isfinite(of_patch)
    if full.sum() < 8:
        return np.isfinite(dz), 0.0
    noise = median(sigma, _cells_of(full, patch, dz.shape))
    # patches of still ground differ by correlated noise, a good part of one cell's sigma (an imported map may say
    # none), never less than its mean's
    bound = 3 * max(0.3 * np.nan_to_num(noise), robust_sigma(rest) / patch, 1e-6)
    where = np.flatnonzero(full)
    medians = of_patch.ravel()[where].astype(np.float64)
    y, x = (where // columns).astype(np.float64), (where % columns).astype(np.float64)
    design = np.stack([np.ones_like(x), x, y], axis=1)
    random = np.random.default_rng(0)  # a fixed seed: the same scans always give the same answer
    three = np.array([random.choice(medians.size, 3, replace=False) for _ in range(TRIPLES)])
    # three patches in a row say nothing about tilt
    three = three[np.abs(np.linalg.det(design[three])) >= 0.05 * rows * columns / 4]
    best = np.zeros(medians.size, dtype=np.bool_)
    if len(three):
        planes = np.linalg.solve(design[three], medians[three][..., None])[..., 0]
        counts = np.zeros(len(three), dtype=np.intp)
        in_slabs(len(three), lambda *part: _agreeing(medians, x, y, planes, bound, counts, *part), least=32)
        best = np.abs(medians - design @ planes[counts.argmax()]) < bound
    if best.sum() < 3:
        return np.isfinite(dz), 0.0
    for _ in range(3):
        level = np.linalg.lstsq(design[best], medians[best], rcond=None)[0]
        best = np.abs(medians - design @ level) < bound
        if best.sum() < 3:
            return np.isfinite(dz), 0.0
    stable = np.zeros((rows, columns), dtype=np.bool_)
    stable.ravel()[where[best]] = True
    return _cells_of(stable, patch, dz.shape) & np.isfinite(dz), float(best.sum() / full.sum())


def _cells_of(patches: npt.NDArray[np.bool_], patch: int, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Cells of the marked patches; those beyond the last whole patch are of none."""
    whole = np.zeros(shape, dtype=np.bool_)
    cells = patches.repeat(patch, axis=0).repeat(patch, axis=1)
    whole[: cells.shape[0], : cells.shape[1]] = cells
    return whole
