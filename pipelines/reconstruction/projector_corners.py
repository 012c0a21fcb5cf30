"""Where the projector "sees" the board's corners: dense decoded positions carried to the corners, to sub-pixel.

Two ways, which the calibration can choose between (docs/decisions/0003-projector-calibration.md):

`plane`  one homography of the whole board per pose, and a cubic for what both lenses distort;
`local`  one homography per corner, from the pixels around it (Moreno and Taubin 2012; US patent 10,008,007).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .pinhole import finite, fit_homography, map_homography
from .pixel_maps import Decoded

__all__ = ["CornerMethod", "LitCorners", "corner_spacing_px", "inside", "lattice_of", "outline", "projector_corners"]

CornerMethod = Literal["plane", "local"]
Floats = npt.NDArray[np.float64]
Lattice = npt.NDArray[np.int_]

GROSS_PX = 3.0  # a decoded pixel further than this from its neighbours' homography is a decoding error
MOST_PIXELS = 20_000  # of a board: more make the fit slower and no better
CUBIC = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]


@dataclass(frozen=True, slots=True, eq=False)
class LitCorners:
    """Where the projector sees the corners, and how well the decoded pixels of the board agree on it.

    `at` (n, 2) px with NaN; `agreeing` the share of decoded pixels that follow the fit; `spread_px` their robust
    standard deviation about it.
    """

    at: Floats
    agreeing: float
    spread_px: float


def projector_corners(decoded: Decoded, corners: Floats, lattice: Lattice, method: CornerMethod) -> LitCorners:
    """Projector position of each camera corner.

    Parameters
    ----------
    decoded : Decoded
        Both axes.
    corners : ndarray of float64, shape (corner, 2)
        (column, row) in the camera's image.
    lattice : ndarray of int, shape (corner, 2)
        Which corner of the board each one is: (column, row), counted from any end.
    method : {"plane", "local"}

    Returns
    -------
    LitCorners
        NaN where too little was decoded.
    """
    return _local(decoded, corners, lattice) if method == "local" else _plane(decoded, corners, lattice)


def lattice_of(inner_corners: tuple[int, int]) -> Lattice:
    """(column, row) of each corner of a whole board, row by row: shape (corner, 2)."""
    columns, rows = inner_corners
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([x.ravel(), y.ravel()], axis=1)


def corner_spacing_px(corners: Floats, lattice: Lattice) -> float:
    """Median distance of neighbouring corners in the image."""
    apart = np.abs(lattice[:, None] - lattice).sum(axis=-1)
    one, other = np.nonzero(np.triu(apart == 1))
    return float(np.median(np.linalg.norm(corners[one] - corners[other], axis=1)))


def _local(decoded: Decoded, corners: Floats, lattice: Lattice) -> LitCorners:
    half = round(min(max(0.35 * corner_spacing_px(corners, lattice), 6), 40))
    H, W = decoded.column.shape
    random = np.random.default_rng(0)  # which triples are tried; fixed, so that a calibration repeats
    result = np.full(corners.shape, np.nan)
    agreeing, spreads = [], []
    for n, (u, v) in enumerate(corners):
        c0, r0 = round(u) - half, round(v) - half
        if c0 < 0 or r0 < 0 or c0 + 2 * half >= W or r0 + 2 * half >= H:
            continue
        window = slice(r0, r0 + 2 * half + 1), slice(c0, c0 + 2 * half + 1)
        target = np.stack([decoded.column[window], decoded.row[window]], axis=-1).astype(np.float64)
        rows, columns = np.nonzero(np.isfinite(target).all(axis=-1))
        if len(rows) < max(40, 0.2 * (2 * half + 1) ** 2):
            continue
        source = np.stack([columns + c0 - u, rows + r0 - v], axis=1).astype(np.float64)
        target = target[rows, columns]
        fit = _robust_homography(source, target, random)
        if fit is not None:
            result[n] = map_homography(fit, np.zeros(2))
            error = np.abs(map_homography(fit, source) - target).max(axis=1)
            spreads.append(1.4826 * float(np.median(error)))
            agreeing.append(float((error < min(max(4 * spreads[-1], 1.0), GROSS_PX)).mean()))
    if not spreads:
        return LitCorners(result, 0.0, np.nan)
    return LitCorners(result, float(np.mean(agreeing)), float(np.median(spreads)))


def _robust_homography(source: Floats, target: Floats, random: np.random.Generator) -> Floats | None:
    """RANSAC over affine maps for the inliers, then a homography by iterated reweighting (Tukey)."""
    ones = np.ones((len(source), 1))
    full = np.concatenate([source, ones], axis=1)
    best, most = None, 0
    sample = full[:: max(1, len(full) // 300)], target[:: max(1, len(full) // 300)]
    for _ in range(40):
        triple = random.choice(len(source), 3, replace=False)
        basis = full[triple]
        if abs(np.linalg.det(basis)) < 0.05 * len(source):  # nearly on a line
            continue
        affine = np.linalg.solve(basis, target[triple])
        inside = int((np.abs(sample[0] @ affine - sample[1]).max(axis=1) < GROSS_PX).sum())
        if inside > most:
            best, most = affine, inside
    if best is None or most < 0.5 * len(sample[0]):
        return None
    weight = (np.abs(full @ best - target).max(axis=1) < GROSS_PX).astype(np.float64)
    H = fit_homography(source, target, weight)
    for _ in range(4):
        error = np.linalg.norm(map_homography(H, source) - target, axis=1)
        scale = max(1.4826 * float(np.median(error[weight > 0])), 0.05)
        weight = np.clip(1 - (error / (4 * scale)) ** 2, 0, None) ** 2
        H = fit_homography(source, target, weight)
    return H


def _plane(decoded: Decoded, corners: Floats, lattice: Lattice) -> LitCorners:
    hull = outline(corners, lattice)
    nothing = LitCorners(np.full(corners.shape, np.nan), 0.0, np.nan)
    H, W = decoded.column.shape
    c0, r0 = np.maximum(np.floor(hull.min(axis=0)).astype(int), 0)
    c1, r1 = np.minimum(np.ceil(hull.max(axis=0)).astype(int) + 1, [W, H])
    step = max(1, math.isqrt(max(r1 - r0, 0) * max(c1 - c0, 0) // MOST_PIXELS))
    rows, columns = np.mgrid[r0:r1:step, c0:c1:step]
    source = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    window = slice(r0, r1, step), slice(c0, c1, step)
    both = np.stack([decoded.column[window], decoded.row[window]], axis=-1)
    target: Floats = both.reshape(-1, 2).astype(np.float64)
    keep = finite(target) & inside(source, hull)
    source, target = source[keep], target[keep]
    if len(source) < 500:
        return nothing
    # Start: the median decoded position near each corner is immune to gross errors, and so is their homography.
    anchors, seen = _medians(decoded, corners, corner_spacing_px(corners, lattice))
    if len(anchors) < 0.5 * len(corners):
        return nothing
    plane = fit_homography(anchors, seen)
    for _ in range(5):
        off = np.linalg.norm(map_homography(plane, anchors) - seen, axis=1)
        plane = fit_homography(anchors, seen, np.clip(1 - (off / max(6 * float(np.median(off)), 0.5)) ** 2, 0, None))
    centre, scale = corners.mean(axis=0), np.abs(corners - corners.mean(axis=0)).max()
    design, at_corners = _cubic((source - centre) / scale), _cubic((corners - centre) / scale)
    residual = np.ascontiguousarray((target - map_homography(plane, source)).T)
    coefficients = np.zeros((len(CUBIC), 2))
    coefficients[0] = np.median(residual, axis=1)
    for turn in range(8):
        error = np.abs(residual - _sum(coefficients, design)).max(axis=0)
        spread = max(1.4826 * float(np.median(error)), 0.05)
        reach = 4 * spread + (8 - turn) * 0.5
        weight = np.clip(1 - (error / reach) ** 2, 0, None) ** 2
        weighted = design * weight
        normal = np.einsum("in,jn->ij", weighted, design)  # einsum's own loops: no threads, the same bits every time
        coefficients = np.linalg.solve(normal, np.einsum("in,cn->ic", weighted, residual))
    at = map_homography(plane, corners) + _sum(coefficients, at_corners).T
    return LitCorners(at, float((error < min(max(4 * spread, 1.0), GROSS_PX)).mean()), spread)


def _cubic(points: Floats) -> Floats:
    """Terms of a cubic, shape (term, n): memory runs along the points."""
    x, y = points[:, 0], points[:, 1]
    return np.stack([x**i * y**j for i, j in CUBIC])


def _sum(coefficients: Floats, design: Floats) -> Floats:
    result = np.zeros((2, design.shape[1]))
    for k, term in enumerate(design):
        result += coefficients[k][:, None] * term
    return result


def _medians(decoded: Decoded, corners: Floats, spacing: float) -> tuple[Floats, Floats]:
    half = max(3, round(0.2 * spacing))
    where, seen = [], []
    for u, v in corners:
        c, r = round(u), round(v)
        window = slice(max(r - half, 0), r + half + 1), slice(max(c - half, 0), c + half + 1)
        both = np.stack([decoded.column[window], decoded.row[window]], axis=-1).reshape(-1, 2)
        both = both[np.isfinite(both).all(axis=1)]
        if len(both) >= 10:
            where.append((u, v))
            seen.append(np.median(both, axis=0))
    return np.array(where, dtype=np.float64), np.array(seen, dtype=np.float64)


def outline(corners: Floats, lattice: Lattice) -> Floats:
    """Give the four outer corners of the lattice, moved outwards by 0.6 of a square."""
    H = fit_homography(lattice.astype(np.float64), corners)
    (a, c), (b, d) = lattice.min(axis=0) - 0.6, lattice.max(axis=0) + 0.6
    return map_homography(H, np.array([[a, c], [b, c], [b, d], [a, d]]))


def inside(points: Floats, quadrangle: Floats) -> npt.NDArray[np.bool_]:
    """Whether points (n, 2) lie inside a convex quadrangle (4, 2) of either sense."""
    p, q = quadrangle, np.roll(quadrangle, -1, axis=0)
    side = (q - p)[:, 0] * (points[:, None, 1] - p[:, 1]) - (q - p)[:, 1] * (points[:, None, 0] - p[:, 0])
    left = (side > 0).sum(axis=1)
    result: npt.NDArray[np.bool_] = (left == 0) | (left == 4)
    return result
