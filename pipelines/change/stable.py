"""Vertical offset and tilt from ground that did not move; and such ground, found where nobody marked it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit

from ..slabs import in_slabs
from .ranks import at_rank, median, ordered, robust_sigma

__all__ = ["Plane", "every_of", "fit_plane", "largest_consensus", "levelling", "mean_plane"]

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
    level[0] = median(z)
    normal = np.zeros((design.shape[1], design.shape[1]))
    residual = 0.0
    for _ in range(20):
        r = z - design @ level
        residual = robust_sigma(r)
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
    bounds = (np.float32(each * max(plane.residual, 1e-9)) for each in (TAIL, MISTAKE))
    given = dz, held, across, along, plane.level.astype(np.float32), *bounds
    sums = in_slabs(len(dz), lambda first, last: _plane_sums(*given, first, last), least=256)
    above, below, n, sx, sy, sxx, sxy, syy, r, rx, ry = np.sum(sums, axis=0)
    if abs(above - below) > LOPSIDED * (above + below) + 4 * np.sqrt(above + below):
        return plane
    normal, right = np.array([[n, sx, sy], [sx, sxx, sxy], [sy, sxy, syy]]), np.array([r, rx, ry])
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
def _plane_sums(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    dz, held, across, along, level, tail, mistake, first, last
):
    """How many residuals lie in either tail; the normal equations of a plane through those that are no mistakes."""
    above = below = 0
    n = sx = sy = sxx = sxy = syy = r = rx = ry = 0.0
    for i in range(first, last):
        y = along[i]
        m = mx = mxx = s = sx_off = 0.0
        for j in range(dz.shape[1]):
            off = dz[i, j] - (level[0] + level[1] * np.float32(across[j]) + level[2] * np.float32(y))
            good = held[i, j] and abs(off) < mistake
            above += held[i, j] and off > tail
            below += held[i, j] and off < -tail
            w, off, x = (1.0 if good else 0.0), (np.float64(off) if good else 0.0), across[j]
            m += w
            mx += w * x
            mxx += w * x * x
            s += off
            sx_off += off * x
        n, sx, sxx, r, rx = n + m, sx + mx, sxx + mxx, r + s, rx + sx_off
        sy, sxy, syy, ry = sy + m * y, sxy + mx * y, syy + m * y * y, ry + s * y
    return float(above), float(below), n, sx, sy, sxx, sxy, syy, r, rx, ry


@njit(cache=True, nogil=True)
def _every(held, every, rows, columns):  # type: ignore[no-untyped-def]  # as above
    ahead = kept = 0
    for i in range(held.shape[0]):
        for j in range(held.shape[1]):
            if held[i, j]:
                if ahead == 0:
                    rows[kept], columns[kept] = i, j
                    kept += 1
                    ahead = every
                ahead -= 1


def every_of(held: npt.NDArray[np.bool_], every: int, count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Row and column of the first and then every so-manieth of the `count` marked cells."""
    rows, columns = np.empty((2, -(-count // every)), dtype=np.intp)
    _every(held, every, rows, columns)
    return rows, columns


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
                        keys[count] = ordered(np.float32(dz[i, j]).view(np.int32))
                        count += 1
            if 2 * count < patch * patch:
                continue
            lower = np.int32(ordered(at_rank(keys, count, (count - 1) // 2))).view(np.float32)
            upper = lower if count % 2 else np.int32(ordered(at_rank(keys, count, count // 2))).view(np.float32)
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
