"""Register a scan to its baseline: drift from what moves with the sample, height and tilt from what stands still."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..scan import Scan
from .difference import subtracted
from .drift import REACH, Drift, lateral_drift
from .follow import followed_drift
from .motion import Motion, Verdict
from .move import apply_motion
from .put_back import place_put_back, stands_out
from .ranks import median
from .stable import Plane, every_of, fit_plane, largest_consensus, levelling, mean_plane

__all__ = ["LEAST_CELLS", "find_motion", "register"]

Mask = npt.NDArray[np.bool_]
Matrix = npt.NDArray[np.float64]

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
TURNS = 5
"""A turn is found in so many rounds at most; of small ones the first is right to a hundredth."""
TURNED_SIGMAS = 5.0
"""A turn counts if it is so many of its standard uncertainties."""
TURNED_CELLS = 1.0
"""One that moves the corners of the map by more cells is taken out before the shift is sought once more."""
STILL_CELLS = 0.01
"""A tilt that moves what is high sideways by no more is taken out in one round."""
PUT_BACK_DEG = 0.5
"""No rig drifts by such a turn or tilt."""
NOT_FOUND = "nothing of the baseline is found again"
LEAST_FOLLOWED = 160_000
"""Fewer cells are registered in full: that takes no longer, and a sixteenth of them would be too few."""


def register(
    scan: Scan,
    baseline: Scan,
    stable: Mask | None = None,
    near: Motion | None = None,
    *,
    put_back: bool = True,
) -> Motion:
    """Find the rigid motion that takes a scan onto its baseline.

    Height and tilt come from a robust plane through the difference on the stable areas alone, lateral drift and the
    turn about the vertical from band-passed relief and texture with robust weights. Where no drift makes the scan look
    like its baseline, it is sought as a sample that was put back by hand: anywhere, at any turn, somewhat tilted.
    Then `reason` tells how far away it lay, whatever the verdict.

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
    put_back : bool
        Seek it anywhere; without, no farther than a drift goes.

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
    return find_motion(scan, baseline, stable, near, put_back)[0]


def find_motion(
    scan: Scan, baseline: Scan, stable: Mask | None, near: Motion | None = None, put_back: bool = True
) -> tuple[Motion, Mask]:
    """`register`, and the cells that were held to be stable."""
    if scan.grid != baseline.grid:
        raise ValueError(f"scan and baseline lie on different grids: {scan.grid} and {baseline.grid}")
    if stable is not None and stable.shape != baseline.grid.shape:
        raise ValueError(f"stable mask has shape {stable.shape}, the grid {baseline.grid.shape}")
    ground = np.isfinite(baseline.height)
    if stable is not None:
        ground &= stable
    if stable is not None and np.count_nonzero(ground) < LEAST_CELLS:
        told = f"the stable areas hold fewer than {LEAST_CELLS} measured cells of the baseline"
        return Motion.failed(0.0, told), np.zeros_like(ground)
    lay = np.eye(4)
    if near is not None and near.verdict != "failed":
        # of a sample that was put back only where it lies now is near; a drift is sought on the grid
        lay, near = (near.matrix, Motion.none()) if _lies_apart(near.matrix, baseline.grid) else (lay, near)
        followed = _followed(scan, baseline, ground, stable is None, near, lay)
        if followed is not None:
            return followed
    motion, held, sure = _placed(scan, baseline, ground, stable is None, lay)
    if motion.verdict == "good" or not put_back:
        return motion, held
    doubtful = motion.verdict == "doubtful"
    there = doubtful and (sure or stands_out(scan, baseline, motion.matrix))
    if there and not _lies_apart(motion.matrix, baseline.grid):
        return motion, held
    # of a video it would be sought each time, seconds long
    sought = near is None or not doubtful
    start = place_put_back(scan, baseline, motion.matrix if there else None) if sought else None
    if start is not None:
        # a tilt moves what is high sideways: the second time there is none left
        first, *_ = _placed(scan, baseline, ground, stable is None, start)
        again, still, _ = _placed(scan, baseline, ground, stable is None, first.matrix)
        better = again.residual_mm < motion.residual_mm if there else stands_out(scan, baseline, again.matrix)
        if again.verdict != "failed" and better:
            return again, still
    if doubtful and there is False and motion.covariance is None:
        return Motion.failed(motion.overlap, f"{NOT_FOUND}, where it lay or elsewhere"), held
    return motion, held


def _followed(
    scan: Scan, baseline: Scan, ground: Mask, sought: bool, near: Motion, lay: Matrix
) -> tuple[Motion, Mask] | None:
    """The motion that is proven to go on from a scan shortly before, and the cells held still; None where it is not."""
    if np.count_nonzero(ground) < LEAST_FOLLOWED:
        return None
    laid = _laid(scan, lay, baseline.grid)
    overlap = _overlap(laid, ground)
    if overlap < LEAST_OVERLAP:
        return None
    drift = followed_drift(laid, baseline, ground, near)
    if drift is None:
        return None
    motion, held = _levelled(scan, _thinned(baseline), ground[::THIN, ::THIN], sought, drift, overlap, lay)
    if motion.verdict != "good":
        return None
    return motion, ground & _widened(held, ground.shape) if sought else ground


def _placed(scan: Scan, baseline: Scan, ground: Mask, sought: bool, lay: Matrix) -> tuple[Motion, Mask, bool]:
    """The motion of a scan that, once it was moved by `lay`, lies within a drift's reach; and the cells held still.

    Last, whether one shift within reach, and no other, is more alike than chance makes one.
    """
    grid = baseline.grid
    for _ in range(TURNS):
        laid = _laid(scan, lay, grid)
        overlap = _overlap(laid, ground)
        if overlap < LEAST_OVERLAP:
            told = f"only {overlap:.0%} of the stable cells were measured again"
            return Motion.failed(overlap, told), np.zeros_like(ground), False
        drift = lateral_drift(laid, baseline, ground)
        if abs(_turned(drift)) * np.hypot(*grid.shape) / 2 <= TURNED_CELLS:
            break
        lay = _taken_out(drift, grid) @ lay
    motion, held = _levelled(scan, baseline, ground, sought, drift, overlap, lay)
    sure = np.isfinite(drift.dx_mm) and not drift.ambiguous and drift.conditioning >= LEAST_CONDITIONING
    return motion, held, bool(sure)


def _levelled(
    scan: Scan,
    baseline: Scan,
    ground: Mask,
    sought: bool,
    drift: Drift,
    overlap: float,
    lay: Matrix,
) -> tuple[Motion, Mask]:
    """The motion whose lateral part is known, and the cells that were held to be stable.

    The baseline may be a thinned one; `ground` is the cells of it that may be used, `sought` that the still ones of
    them are to be found.
    """
    matrix = _taken_out(drift, scan.grid) @ lay
    plane: Plane | None = None
    share = 1.0
    held = ground
    shared = SHARED_ERROR_CELLS * (scan.grid.pitch_mm / baseline.grid.pitch_mm) ** 2
    known = baseline.height
    middle, relief = median(known), float(np.fmax.reduce(known, axis=None) - np.fmin.reduce(known, axis=None))
    for _ in range(2):
        dz, sigma = subtracted(_laid(scan, matrix, baseline.grid), baseline)
        held = ground & np.isfinite(dz)
        if sought:
            agreed, share = largest_consensus(dz, sigma)
            # with no majority, what a minority agrees on may be anything: the middle of everything is safer
            held = held & agreed if share >= LEAST_CONSENSUS else held
        plane = _plane_of(dz, held, baseline, shared)
        if plane is None:
            nothing = np.zeros_like(ground)
            return Motion.failed(overlap, "the stable cells are too few or lie on one line"), nothing
        matrix = levelling(plane, middle) @ matrix
        # how far that moves the highest sideways against the lowest
        if float(np.abs(plane.level[1:]).max()) * relief <= STILL_CELLS * scan.grid.pitch_mm:
            break  # what this plane takes out, no second one finds
    assert plane is not None
    # an imported map may say no sigma: then its residual cannot be judged
    expected = median(sigma, held)
    expected = expected if np.isfinite(expected) else np.inf
    # 1 um keeps a noise-free height map (imported, synthetic) from being judged by its rounding
    verdict, doubt = _judge(drift, plane.residual / max(expected, 1e-3), share)
    # of a sample that is found nowhere, a slope that chance gave tells no place
    found = np.isfinite(drift.dx_mm) or not np.array_equal(lay, np.eye(4))
    reason = "; ".join(filter(None, (_told(matrix, scan.grid) if found else "", doubt)))
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


def _widened(thin: Mask, shape: tuple[int, ...]) -> Mask:
    return thin.repeat(THIN, axis=0).repeat(THIN, axis=1)[: shape[0], : shape[1]]


def _laid(scan: Scan, lay: Matrix, grid: Grid) -> Scan:
    return apply_motion(scan, Motion.guess(lay), grid)


def _overlap(scan: Scan, ground: Mask) -> float:
    return int(np.count_nonzero(ground & np.isfinite(scan.height))) / max(1, int(np.count_nonzero(ground)))


def _turned(drift: Drift) -> float:
    """By what angle a scan is turned, if by more than chance tells."""
    turn = drift.turn
    return turn.angle_rad if abs(turn.angle_rad) > TURNED_SIGMAS * turn.sigma_rad else 0.0


def _taken_out(drift: Drift, grid: Grid) -> Matrix:
    """The motion that takes a shift out, and a turn about the middle of the cells that told it."""
    matrix = np.eye(4)
    if not np.isfinite(drift.dx_mm):
        return matrix
    turn = _turned(drift)
    c, s = np.cos(turn), np.sin(turn)
    matrix[:2, :2] = [[c, s], [-s, c]]
    about = np.array([grid.x0_mm, grid.y0_mm]) + grid.pitch_mm * np.array(drift.turn.about)
    matrix[:2, 3] = about - matrix[:2, :2] @ (about + np.array([drift.dx_mm, drift.dy_mm]))
    return matrix


def _moves(matrix: Matrix, grid: Grid) -> tuple[float, float, float]:
    """How far a motion moves the middle of a map sideways, mm, and how far it turns and tilts it, degrees."""
    middle = np.array([grid.x_mm.mean(), grid.y_mm.mean(), 0.0, 1.0])
    aside = float(np.hypot(*(matrix @ middle - middle)[:2]))
    turn = abs(float(np.rad2deg(np.arctan2(matrix[1, 0], matrix[0, 0]))))
    return aside, turn, float(np.rad2deg(np.arccos(min(1.0, matrix[2, 2]))))


def _lies_apart(matrix: Matrix, grid: Grid) -> bool:
    """Whether a drift that is sought on the grid cannot follow a scan that lies so."""
    aside, turn, tilt = _moves(matrix, grid)
    cells = np.deg2rad(turn) * np.hypot(*grid.shape) / 2
    return bool(cells > TURNED_CELLS or aside > REACH * min(grid.shape) * grid.pitch_mm or tilt > PUT_BACK_DEG)


def _told(matrix: Matrix, grid: Grid) -> str:
    """What people are told of a sample that no drift brought where it is; empty for any other."""
    aside, turn, tilt = _moves(matrix, grid)
    if max(turn, tilt) <= PUT_BACK_DEG and aside <= REACH * min(grid.shape) * grid.pitch_mm:
        return ""
    tilted = f", tilted by {tilt:.1f} degrees" if tilt > PUT_BACK_DEG else ""
    return f"the sample was put back {aside:.2g} mm and {turn:.1f} degrees away{tilted}, and found again"


def _covariance(plane: Plane, drift: Drift) -> Matrix:
    """Of shifts along x, y, z and turns about x, y, z: a slope along y is a turn about x, one along x against y."""
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = drift.sigma_mm**2
    covariance[5, 5] = drift.turn.sigma_rad**2
    levels = np.zeros((6, 3))
    levels[2, 0], levels[3, 2], levels[4, 1] = -1.0, -1.0, 1.0
    covariance += levels @ plane.covariance @ levels.T
    return covariance


def _plane_of(dz: npt.NDArray[np.float32], held: Mask, baseline: Scan, shared: float) -> Plane | None:
    """Plane through dz on the held cells, robustly from at most MOST_CELLS of them, then from all."""
    count = int(np.count_nonzero(held))
    if count < LEAST_CELLS:
        return None
    every = max(1, count // MOST_CELLS)
    rows, columns = every_of(held, every, count)
    grid = baseline.grid
    values = dz[rows, columns].astype(np.float64)
    plane = fit_plane(grid.x_mm[columns], grid.y_mm[rows], values, per_patch=max(1.0, shared / every))
    return None if plane is None else mean_plane(plane, grid.x_mm, grid.y_mm, dz, held)


def _judge(drift: Drift, ratio: float, share: float) -> tuple[Verdict, str]:
    """Verdict and reason; the worst comes first."""
    doubtful, failed = TOLERABLE_RESIDUAL
    if share < LEAST_CONSENSUS:
        # the surface changed nearly everywhere: the residual is that change and says nothing about the fit
        return "doubtful", f"no stable areas are given and only {share:.0%} of the surface agrees on one plane"
    if ratio > failed:
        differ = f"the stable areas differ by {ratio:.0f} times what the scans' uncertainties predict"
        return "failed", differ if np.isfinite(drift.dx_mm) else f"{NOT_FOUND}: {differ}"
    if ratio > doubtful:
        return "doubtful", f"the stable areas differ by {ratio:.1f} times what the scans' uncertainties predict"
    if not np.isfinite(drift.dx_mm):
        return "doubtful", "neither relief nor texture shows where the sample is: lateral drift is taken as none"
    if drift.ambiguous:
        return "doubtful", "two shifts explain the scan about equally well, the smaller one is taken: mark stable areas"
    if drift.conditioning < LEAST_CONDITIONING:
        return "doubtful", "relief and texture run in one direction only: drift along it is not determined"
    return "good", ""
