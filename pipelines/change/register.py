"""Register a scan to its baseline: drift from what moves with the sample, height and tilt from what stands still."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..scan import Scan
from .difference import subtracted
from .drift import Drift, lateral_drift
from .follow import followed_drift
from .motion import Motion, Verdict
from .move import apply_motion
from .ranks import median
from .stable import Plane, every_of, fit_plane, largest_consensus, mean_plane

__all__ = ["LEAST_CELLS", "find_motion", "register"]

LEAST_OVERLAP = 0.3
LEAST_CELLS = 50
"""Ground of fewer measured cells tells no height and tilt: twice as many as share one error (below)."""
LEAST_CONDITIONING = 0.02
LEAST_CONSENSUS = 0.5
TOLERABLE_RESIDUAL = 3.0, 8.0
"""Residual over what the scans' own sigmas predict: doubtful above the first, failed above the second."""
SHARED_ERROR_CELLS = 25.0
"""Neighbouring cells of a height map share errors over about 5 x 5 cells (stripe width, gridding)."""
MOST_CELLS = 40_000
"""More cells than this do not make the plane better: the correlated error stays."""
THIN = 4
"""A scan that follows another is levelled on every fourth cell each way: those between share their errors."""
LEAST_FOLLOWED = 160_000
"""Fewer cells are registered in full: that takes no longer, and a sixteenth of them would be too few."""


def register(
    scan: Scan, baseline: Scan, stable: npt.NDArray[np.bool_] | None = None, near: Motion | None = None
) -> Motion:
    """Find the rigid motion that takes a scan onto its baseline.

    Height and tilt come from a robust plane through the difference on the stable areas alone, lateral drift from
    band-passed relief and texture with robust weights. Rotation about the vertical is not estimated.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    stable : ndarray of bool, shape (rows, columns), optional
        Ground that does not move (frame, fiducials). Without it the largest set of patches is used that one plane
        of dz explains; uniform settlement of everything cannot be seen then. Where that is less than half of the
        patches, everything is used with robust weights, and the verdict is doubtful.
    near : Motion, optional
        Of a scan shortly before, onto the same baseline: drift is then sought from there, on a quarter of the rows.
        Where no search could have found another shift nearly as good, height and tilt follow on every fourth cell each
        way. If all of it is good, that is the motion; anything else is registered in full.

    Returns
    -------
    Motion
        ``failed`` where the overlap is below 0.3, nothing fits or the residual is above 8 times what the sigmas
        predict: do not use the difference. ``doubtful`` with its reason where it can be used with care.

    Raises
    ------
    ValueError
        If the grids differ or `stable` has another shape.
    """
    return find_motion(scan, baseline, stable, near)[0]


def find_motion(
    scan: Scan, baseline: Scan, stable: npt.NDArray[np.bool_] | None, near: Motion | None = None
) -> tuple[Motion, npt.NDArray[np.bool_]]:
    """`register`, and the cells that were held to be stable."""
    if scan.grid != baseline.grid:
        raise ValueError(f"scan and baseline lie on different grids: {scan.grid} and {baseline.grid}")
    if stable is not None and stable.shape != baseline.grid.shape:
        raise ValueError(f"stable mask has shape {stable.shape}, the grid {baseline.grid.shape}")
    ground = np.isfinite(baseline.height)
    if stable is not None:
        ground &= stable
    count = int(np.count_nonzero(ground))
    overlap = int(np.count_nonzero(ground & np.isfinite(scan.height))) / max(1, count)
    nowhere = np.zeros(baseline.grid.shape, dtype=np.bool_)
    if stable is not None and count < LEAST_CELLS:
        told = f"the stable areas hold fewer than {LEAST_CELLS} measured cells of the baseline"
        return _failed(overlap, told), nowhere
    if overlap < LEAST_OVERLAP:
        return _failed(overlap, f"only {overlap:.0%} of the stable cells were measured again"), nowhere
    drift = None
    if near is not None and near.verdict != "failed" and count >= LEAST_FOLLOWED:
        drift = followed_drift(scan, baseline, ground, near)
    if drift is not None:
        thin = _thinned(baseline)
        motion, held = _levelled(scan, thin, ground[::THIN, ::THIN], stable is None, drift, overlap)
        if motion.verdict == "good":
            return motion, ground if stable is not None else ground & _widened(held, ground.shape)
    else:
        drift = lateral_drift(scan, baseline, ground)
    return _levelled(scan, baseline, ground, stable is None, drift, overlap)


def _levelled(
    scan: Scan, baseline: Scan, ground: npt.NDArray[np.bool_], sought: bool, drift: Drift, overlap: float
) -> tuple[Motion, npt.NDArray[np.bool_]]:
    """The motion whose lateral part is known, and the cells that were held to be stable.

    The baseline may be a thinned one; `ground` is the cells of it that may be used, `sought` that the still ones of
    them are to be found.
    """
    known = np.isfinite(drift.dx_mm)
    matrix = np.eye(4)
    if known:
        matrix[:2, 3] = -drift.dx_mm, -drift.dy_mm
    plane: Plane | None = None
    share = 1.0
    held = ground
    shared = SHARED_ERROR_CELLS * (scan.grid.pitch_mm / baseline.grid.pitch_mm) ** 2
    for _ in range(2):
        moved = apply_motion(scan, _candidate(matrix), baseline.grid)
        dz, sigma = subtracted(moved, baseline)
        held = ground & np.isfinite(dz)
        if sought:
            agreed, share = largest_consensus(dz, sigma)
            # with no majority, what a minority agrees on may be anything: the middle of everything is safer
            held = held & agreed if share >= LEAST_CONSENSUS else held
        plane = _plane_of(dz, held, baseline, shared)
        if plane is None:
            nothing = np.zeros_like(ground)
            return _failed(overlap, "the stable cells are too few or lie on one line"), nothing
        matrix = _levelling(plane, baseline) @ matrix
    assert plane is not None
    # an imported map may say no sigma: then its residual cannot be judged
    expected = median(sigma, held)
    expected = expected if np.isfinite(expected) else np.inf
    # 1 um keeps a noise-free height map (imported, synthetic) from being judged by its rounding
    verdict, reason = _judge(drift, plane.residual / max(expected, 1e-3), share)
    # without a majority the offset is known no better than the change differs from place to place
    sigma_z = plane.residual if share < LEAST_CONSENSUS else float(np.sqrt(plane.covariance[0, 0]))
    motion = Motion(
        matrix=matrix,
        residual_mm=plane.residual,
        overlap=overlap,
        conditioning=drift.conditioning,
        sigma_z_mm=sigma_z,
        sigma_xy_mm=drift.sigma_mm,
        verdict=verdict,
        reason=reason,
        # with no majority the plane is of what changed: nobody knows how sure it is
        covariance=None if share < LEAST_CONSENSUS else _covariance(plane, drift),
    )
    return motion, held


def _thinned(scan: Scan) -> Scan:
    """Every fourth cell of a scan each way, on a grid of their own."""
    grid = scan.grid
    every = (slice(None, None, THIN), slice(None, None, THIN))
    height, sigma = np.ascontiguousarray(scan.height[every]), np.ascontiguousarray(scan.sigma[every])
    thin = Grid(height.shape[0], height.shape[1], grid.pitch_mm * THIN, grid.x0_mm, grid.y0_mm)
    return Scan(thin, scan.time, height, sigma, scan.texture[every], scan.level[every], scan.calibration_id)


def _widened(thin: npt.NDArray[np.bool_], shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    return thin.repeat(THIN, axis=0).repeat(THIN, axis=1)[: shape[0], : shape[1]]


def _covariance(plane: Plane, drift: Drift) -> npt.NDArray[np.float64]:
    """Of shifts along x, y, z and turns about x, y, z: a slope along y is a turn about x, one along x against y."""
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = drift.sigma_mm**2
    levels = np.zeros((6, 3))
    levels[2, 0], levels[3, 2], levels[4, 1] = -1.0, -1.0, 1.0
    covariance += levels @ plane.covariance @ levels.T
    return covariance


def _candidate(matrix: npt.NDArray[np.float64]) -> Motion:
    return Motion(matrix, float("nan"), 0.0, 0.0, float("nan"), float("nan"), "doubtful", "not finished")


def _failed(overlap: float, reason: str) -> Motion:
    nan = float("nan")
    return Motion(np.eye(4), nan, overlap, 0.0, nan, nan, "failed", reason)


def _plane_of(dz: npt.NDArray[np.float32], held: npt.NDArray[np.bool_], baseline: Scan, shared: float) -> Plane | None:
    """Plane through dz on the held cells, robustly from at most MOST_CELLS of them, then from all."""
    count = int(np.count_nonzero(held))
    if count < 50:
        return None
    every = max(1, count // MOST_CELLS)
    rows, columns = every_of(held, every, count)
    grid = baseline.grid
    values = dz[rows, columns].astype(np.float64)
    plane = fit_plane(grid.x_mm[columns], grid.y_mm[rows], values, per_patch=max(1.0, shared / every))
    return None if plane is None else mean_plane(plane, grid.x_mm, grid.y_mm, dz, held)


def _levelling(plane: Plane, baseline: Scan) -> npt.NDArray[np.float64]:
    """The rigid motion that takes a plane of dz out: a small rotation about its centre, and a lift."""
    offset, a, b = plane.level
    # exp of the rotation vector (-b, a, 0) turns (x, y, 0) into (.., .., -a x - b y) to first order
    angle = float(np.hypot(a, b))
    rotation = np.eye(3)
    if angle > 0:
        skew = np.array([[0.0, 0.0, a], [0.0, 0.0, b], [-a, -b, 0.0]]) / angle
        rotation += np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    pivot = np.array([*plane.centre, median(baseline.height)])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = pivot - rotation @ pivot - np.array([0.0, 0.0, offset])
    return matrix


def _judge(drift: Drift, ratio: float, share: float) -> tuple[Verdict, str]:
    """Verdict and reason; the worst comes first."""
    doubtful, failed = TOLERABLE_RESIDUAL
    if share < LEAST_CONSENSUS:
        # the surface changed nearly everywhere: the residual is that change and says nothing about the fit
        return "doubtful", f"no stable areas are given and only {share:.0%} of the surface agrees on one plane"
    if ratio > failed:
        return "failed", f"the stable areas differ by {ratio:.0f} times what the scans' uncertainties predict"
    if ratio > doubtful:
        return "doubtful", f"the stable areas differ by {ratio:.1f} times what the scans' uncertainties predict"
    if not np.isfinite(drift.dx_mm):
        return "doubtful", "neither relief nor texture shows where the sample is: lateral drift is taken as none"
    if drift.ambiguous:
        return "doubtful", "two shifts explain the scan about equally well, the smaller one is taken: mark stable areas"
    if drift.conditioning < LEAST_CONDITIONING:
        return "doubtful", "relief and texture run in one direction only: drift along it is not determined"
    return "good", ""
