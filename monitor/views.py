"""Views of one object from several sides are aligned: from where they should lie to where their surfaces meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pipelines import Grid, Motion, Scan
from pipelines.change import apply_motion, register

__all__ = ["Aligned", "align", "pose_matrix"]

Floats = npt.NDArray[np.float64]

ROUNDS = 6
BLOCKS = 3
"""Shifts of so many by so many parts of the common area tell a turn about the vertical."""
LEAST_SIDE = 24
ENOUGH_DEG = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """The motion that takes a view onto the first one (4x4, mm), and the last registration, which judges it."""

    matrix: Floats
    motion: Motion


def pose_matrix(x_mm: float, y_mm: float, z_mm: float, turn_deg: float) -> Floats:
    """Take the site frame to the frame of a sample that was turned about the vertical, then shifted."""
    angle = np.deg2rad(turn_deg)
    placed: npt.NDArray[np.floating] = np.eye(4)
    placed[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    placed[:3, 3] = x_mm, y_mm, z_mm
    back: Floats = np.linalg.inv(placed).astype(np.float64)
    return back


def align(view: Scan, first: Scan, guesses: Sequence[Floats]) -> Aligned:
    """Register a view to the first one.

    Shift, height and tilt come from `register`, the turn about the vertical from the shifts of nine parts of the
    common area. The view is put on the first one's grid anew for each round, so errors of resampling do not add up.

    Parameters
    ----------
    view, first : Scan
    guesses : sequence of ndarray of float64, shape (4, 4)
        Where the view may lie (x_first = matrix @ x_view): the one that fits best is taken.

    Returns
    -------
    Aligned
        Use it only where its verdict is not ``failed``.
    """
    every = [_align(view, first, guess) for guess in guesses]
    return min(every, key=_badness)


def _badness(each: Aligned) -> tuple[int, float]:
    rank = ("good", "doubtful", "failed").index(each.motion.verdict)
    return rank, each.motion.residual_mm if np.isfinite(each.motion.residual_mm) else np.inf


def _align(view: Scan, first: Scan, guess: Floats) -> Aligned:
    matrix = guess
    motion = register(_moved(view, matrix, first.grid), first, put_back=False)
    for _ in range(ROUNDS):
        if motion.verdict == "failed":
            break
        matrix = motion.matrix @ matrix
        moved = _moved(view, matrix, first.grid)
        turn = _turn(moved, first)
        matrix = turn @ matrix
        motion = register(_moved(view, matrix, first.grid), first, put_back=False)
        if abs(np.rad2deg(np.arctan2(turn[1, 0], turn[0, 0]))) < ENOUGH_DEG:
            break
    return Aligned(motion.matrix @ matrix if motion.verdict != "failed" else matrix, motion)


def _moved(view: Scan, matrix: Floats, grid: Grid) -> Scan:
    """Resampled by interpolation: gridding moves the finest relief by whole cells only, which a small turn must not."""
    return apply_motion(view, Motion.guess(matrix), grid)


def _turn(moved: Scan, first: Scan) -> Floats:
    """The turn about the vertical that the shifts of parts of the common area show; none where they are too few."""
    both = np.isfinite(moved.height) & np.isfinite(first.height)
    rows, columns = np.flatnonzero(both.any(axis=1)), np.flatnonzero(both.any(axis=0))
    if min(rows.size, columns.size) < BLOCKS * LEAST_SIDE:
        return np.eye(4)
    along = np.linspace(rows[0], rows[-1] + 1, BLOCKS + 1).astype(int)
    across = np.linspace(columns[0], columns[-1] + 1, BLOCKS + 1).astype(int)
    places, shifts, weights = [], [], []
    for top, bottom in pairwise(along):
        for left, right in pairwise(across):
            part = (slice(top, bottom), slice(left, right))
            if both[part].mean() < 0.5:
                continue
            one, two = _cut(moved, part), _cut(first, part)
            motion = register(one, two, put_back=False)
            if motion.verdict == "failed" or not np.isfinite(motion.sigma_xy_mm):
                continue
            middle = np.array([one.grid.x_mm.mean(), one.grid.y_mm.mean(), float(np.nanmean(one.height)), 1.0])
            places.append(middle[:2])
            shifts.append((motion.matrix @ middle - middle)[:2])
            weights.append(1 / motion.sigma_xy_mm**2)
    if len(places) < 4:
        return np.eye(4)
    place, shift, weight = np.array(places), np.array(shifts), np.array(weights)
    for _ in range(10):  # a part whose registration went astray must not turn the whole
        centre, mean = np.average(place, axis=0, weights=weight), np.average(shift, axis=0, weights=weight)
        arm, off = place - centre, shift - mean
        curl = arm[:, 0] * off[:, 1] - arm[:, 1] * off[:, 0]
        angle = float((weight * curl).sum() / (weight * (arm**2).sum(axis=1)).sum())
        left_over = np.hypot(off[:, 0] + angle * arm[:, 1], off[:, 1] - angle * arm[:, 0])
        weight = np.array(weights) / np.maximum(left_over / max(1.5 * float(np.median(left_over)), 1e-9), 1) ** 2
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:2, 3] = centre + mean - matrix[:2, :2] @ centre
    return matrix


def _cut(scan: Scan, part: tuple[slice, slice]) -> Scan:
    rows, columns = part
    height, sigma = np.ascontiguousarray(scan.height[part]), np.ascontiguousarray(scan.sigma[part])
    texture, level = np.ascontiguousarray(scan.texture[part]), np.ascontiguousarray(scan.level[part])
    x0, y0 = float(scan.grid.x_mm[columns.start]), float(scan.grid.y_mm[rows.start])
    grid = Grid(height.shape[0], height.shape[1], scan.grid.pitch_mm, x0, y0)
    return Scan(grid, scan.time, height, sigma, texture, level, scan.calibration_id)
