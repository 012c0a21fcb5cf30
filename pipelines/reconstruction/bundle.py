"""Joint bundle adjustment of camera, projector and board poses: robust, with weak priors, exact derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .pinhole import Array, Floats, distort, rotation

__all__ = ["LENS", "Corners", "Solution", "adjust", "adjust_lens", "lens_residuals"]

LENS = 8  # fx fy cx cy k1 k2 p1 p2; k3 stays 0: it overfits
STEP = 1e-30  # complex step: the derivative is exact to rounding
CAMERA_SHIFT, PROJECTOR_SHIFT = 0.05, 0.5  # principal point off the centre, in image widths: projectors shift theirs
SQUARE = 0.01  # camera pixels are square to this


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """All corners of all poses, flat.

    `pose` (n,) counts poses, `board` (n, 2) mm, `camera` and `projector` (n, 2) px,
    `use` (n,) whether the corner counts.
    """

    pose: npt.NDArray[np.intp]
    board: Floats
    camera: Floats
    projector: Floats
    use: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Both lenses (8,) each, camera to projector, board to camera per pose (rotation vectors and mm)."""

    camera: Floats
    projector: Floats
    turn: Floats
    shift: Floats
    pose_turns: Floats
    pose_shifts: Floats

    def packed(self) -> Floats:
        """One vector: lenses, stereo, then six numbers per pose."""
        poses = np.concatenate([self.pose_turns, self.pose_shifts], axis=1).ravel()
        return np.concatenate([self.camera, self.projector, self.turn, self.shift, poses])

    @staticmethod
    def unpacked(vector: Floats) -> Solution:
        """Read `packed` back."""
        poses = vector[2 * LENS + 6 :].reshape(-1, 6)
        a, b = vector[:LENS], vector[LENS : 2 * LENS]
        c, d = vector[2 * LENS : 2 * LENS + 3], vector[2 * LENS + 3 : 2 * LENS + 6]
        return Solution(a, b, c, d, poses[:, :3], poses[:, 3:])


def adjust(
    corners: Corners,
    start: Solution,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    noise_px: tuple[float, float],
    rounds: int = 60,
) -> Solution:
    """Minimise the robust sum of both devices' reprojection errors.

    Long focal lengths make f, the principal point and the distance nearly degenerate, so weak priors hold what the
    corners leave open (standard deviations): the camera's principal point within 5 % of its image's width around the
    centre, the projector's within 50 % (projectors shift their image), square camera pixels within 1 %, and distortion
    at the image's corner of some per cent. The projector's pixels may have any shape: some mirror arrays are 1:2.

    Parameters
    ----------
    corners : Corners
    start : Solution
    sizes : ((int, int), (int, int))
        Columns and rows of camera and projector.
    noise_px : (float, float)
        Standard deviation of a corner's coordinate in camera and projector.
    rounds : int
        Most evaluations of the derivative.

    Returns
    -------
    Solution
    """
    used = _used(corners)
    prior = _Prior((start.camera, start.projector), sizes, (CAMERA_SHIFT, PROJECTOR_SHIFT))
    rows_pose = np.tile(np.repeat(used.pose, 2), 2)
    vector = _minimise(lambda v: _data(v, used, noise_px), start.packed(), prior, rows_pose, 2 * LENS + 6, rounds)
    return Solution.unpacked(vector)


def adjust_lens(
    pose: npt.NDArray[np.intp],
    board: Floats,
    image: Floats,
    lens: Floats,
    poses: Floats,
    size: tuple[int, int],
    noise_px: float = 0.3,
    shift: float = 0.5,
) -> tuple[Floats, Floats, float]:
    """Adjust one device alone: lens (8,), poses (pose, 6); gives both refined and the rms in px."""
    prior = _Prior((lens,), (size,), (shift,))

    def data(vector: Array) -> Array:
        six = vector[LENS:].reshape(-1, 6)
        points = _on_board(six[:, :3], six[:, 3:], pose, board)
        result: Array = ((_view(vector[:LENS], points) - image) / noise_px).ravel()
        return result

    vector = _minimise(data, np.concatenate([lens, poses.ravel()]), prior, np.repeat(pose, 2), LENS, 60)
    rms = float(np.sqrt(2 * np.mean(data(vector) ** 2)) * noise_px)
    return vector[:LENS], vector[LENS:].reshape(-1, 6), rms


def _minimise(
    data: Callable[[Array], Array],
    start: Floats,
    prior: _Prior,
    rows_pose: npt.NDArray[np.intp],
    shared: int,
    rounds: int,
) -> Floats:
    """Levenberg and Marquardt's method on the normal equations, scaled by their diagonal (More 1978).

    scipy's `least_squares` reaches the same minimum, but spends seconds in singular values of a tall matrix.
    """

    def residuals(vector: Floats) -> Floats:
        return np.concatenate([_soft(data(vector)), prior.residuals(vector)])

    vector, now = start, residuals(start)
    cost, damping = float(now @ now), 1e-3
    for _ in range(rounds):
        J = _jacobian(data, vector, rows_pose, shared) * _soft_slope(data(vector))[:, None]
        J = np.concatenate([J, prior.jacobian(vector)])
        normal, slope = J.T @ J, J.T @ now
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        normal, slope = normal * np.outer(scale, scale), slope * scale
        for _attempt in range(12):
            step = -scale * np.linalg.solve(normal + damping * np.eye(len(slope)), slope)
            ahead = residuals(vector + step)
            new_cost = float(ahead @ ahead)
            if np.isfinite(new_cost) and new_cost <= cost:
                break
            damping *= 8
        else:
            return vector
        gain = cost - new_cost
        vector, now, cost = vector + step, ahead, new_cost
        damping = max(damping / 10, 1e-12)
        if gain <= 1e-10 * cost:
            return vector
    return vector


def lens_residuals(solution: Solution, corners: Corners) -> tuple[Floats, Floats]:
    """Reprojection errors (n, 2) in px of camera and projector, of all corners, used or not."""
    everything = replace(corners, use=np.ones(len(corners.pose), dtype=bool))
    flat = _data(solution.packed(), everything, (1.0, 1.0)).reshape(2, -1, 2)
    return flat[0], flat[1]


def _used(corners: Corners) -> Corners:
    keep = corners.use
    return Corners(
        corners.pose[keep], corners.board[keep], corners.camera[keep], corners.projector[keep], corners.use[keep]
    )


def _view(lens: Array, points: Array) -> Array:
    x, y = distort(
        points[:, 0] / points[:, 2],
        points[:, 1] / points[:, 2],
        np.concatenate([lens[4:8], np.zeros(1, dtype=lens.dtype)]),
    )
    return np.stack([lens[0] * x + lens[2], lens[1] * y + lens[3]], axis=1)


def _on_board(turns: Array, shifts: Array, pose: npt.NDArray[np.intp], board: Floats) -> Array:
    R = rotation(turns)[pose]
    points: Array = R[:, :, 0] * board[:, :1] + R[:, :, 1] * board[:, 1:] + shifts[pose]
    return points


def _data(vector: Array, corners: Corners, noise_px: tuple[float, float]) -> Array:
    """Errors of camera (n, 2), then projector (n, 2), in standard deviations, flat."""
    stereo = 2 * LENS
    poses = vector[stereo + 6 :].reshape(-1, 6)
    points = _on_board(poses[:, :3], poses[:, 3:], corners.pose, corners.board)
    R, t = rotation(vector[stereo : stereo + 3]), vector[stereo + 3 : stereo + 6]
    seen = (_view(vector[:LENS], points) - corners.camera) / noise_px[0]
    lit = (_view(vector[LENS:stereo], points @ R.T + t) - corners.projector) / noise_px[1]
    return np.concatenate([seen.ravel(), lit.ravel()])


def _jacobian(data: Callable[[Array], Array], vector: Floats, rows_pose: npt.NDArray[np.intp], shared: int) -> Floats:
    """Exact derivative: one complex step per shared number, and one per number of a pose for all poses at once."""
    rows = np.arange(len(rows_pose))
    J = np.zeros((len(rows), len(vector)))
    for k in range(shared + 6):
        moved = vector.astype(np.complex128)
        if k < shared:
            moved[k] += 1j * STEP
            J[:, k] = data(moved).imag / STEP
        else:  # a corner depends on its own pose only
            moved[k::6] += 1j * STEP
            J[rows, k + 6 * rows_pose] = data(moved).imag / STEP
    return J


# Huber's loss as a transformed residual: quadratic to 2 standard deviations, linear beyond.
HUBER = 2.0


def _soft(data: Floats) -> Floats:
    size = np.abs(data)
    return np.where(size <= HUBER, data, np.sign(data) * np.sqrt(HUBER * (2 * np.maximum(size, HUBER) - HUBER)))


def _soft_slope(data: Floats) -> Floats:
    size = np.abs(data)
    return np.where(size <= HUBER, 1.0, HUBER / np.sqrt(HUBER * (2 * np.maximum(size, HUBER) - HUBER)))


class _Prior:
    """Weak beliefs about lenses, in standard deviations; the first one is the camera, or a device on its own."""

    def __init__(self, lenses: tuple[Floats, ...], sizes: tuple[tuple[int, int], ...], shifts: tuple[float, ...]):
        aims, spreads = [], []
        for lens, size, loose in zip(lenses, sizes, shifts, strict=True):
            aims.append([(size[0] - 1) / 2, (size[1] - 1) / 2, 0, 0, 0, 0])
            r = np.hypot(size[0] / 2 / abs(lens[0]), size[1] / 2 / abs(lens[1]))
            spreads.append([loose * size[0], loose * size[1], 0.05 / r**2, 0.02 / r**4, 0.005 / r, 0.005 / r])
        self.aim, self.spread = np.array(aims, dtype=np.float64), np.array(spreads)
        self.square = shifts[0] <= CAMERA_SHIFT  # a camera's pixels are square

    def residuals(self, vector: Floats) -> Floats:
        count = len(self.aim)
        lenses = vector[: count * LENS].reshape(count, LENS)
        parts = ((lenses[:, 2:] - self.aim) / self.spread).ravel()
        return np.append(parts, np.log(abs(vector[0] / vector[1])) / SQUARE) if self.square else parts

    def jacobian(self, vector: Floats) -> Floats:
        count = len(self.aim)
        J = np.zeros((6 * count + self.square, len(vector)))
        for n in range(count):
            J[np.arange(6) + 6 * n, np.arange(6) + n * LENS + 2] = 1 / self.spread[n]
        if self.square:
            J[-1, 0], J[-1, 1] = 1 / vector[0] / SQUARE, -1 / vector[1] / SQUARE
        return J
