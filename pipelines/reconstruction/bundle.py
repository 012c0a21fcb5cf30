"""Joint bundle adjustment of camera, projector and board poses: robust, with weak priors, exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .bundle_prior import CAMERA_SHIFT, PROJECTOR_SHIFT, Prior
from .pinhole import Array, Floats, distort, rotation

__all__ = [
    "LENS",
    "Corners",
    "Solution",
    "adjust",
    "adjust_lens",
    "information",
    "lens_residuals",
    "rms_px",
    "robust_cost",
    "view_slopes",
]

LENS = 8  # fx fy cx cy k1 k2 p1 p2; k3 stays 0: it overfits


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
    """Both lenses (8,) each, camera to projector, board to camera per pose (rotation vectors and mm).

    `parallel` says which lenses are affine (camera, projector): the same eight numbers, with the point's own x and y in
    the place of x/z and y/z, so fx and fy are px per mm. Such a lens knows no distance; where it is counted from is
    held by a prior (`bundle_prior`).
    """

    camera: Floats
    projector: Floats
    turn: Floats
    shift: Floats
    pose_turns: Floats
    pose_shifts: Floats
    parallel: tuple[bool, bool] = (False, False)

    def packed(self) -> Floats:
        """One vector: lenses, stereo, then six numbers per pose."""
        poses = np.concatenate([self.pose_turns, self.pose_shifts], axis=1).ravel()
        return np.concatenate([self.camera, self.projector, self.turn, self.shift, poses])

    @staticmethod
    def unpacked(vector: Floats, parallel: tuple[bool, bool] = (False, False)) -> Solution:
        """Read `packed` back."""
        poses = vector[2 * LENS + 6 :].reshape(-1, 6)
        a, b = vector[:LENS], vector[LENS : 2 * LENS]
        c, d = vector[2 * LENS : 2 * LENS + 3], vector[2 * LENS + 3 : 2 * LENS + 6]
        return Solution(a, b, c, d, poses[:, :3], poses[:, 3:], parallel)


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
    problem = _pair(_used(corners), noise_px, start.parallel)
    return Solution.unpacked(_minimise(problem, start.packed(), _prior(start, sizes), rounds), start.parallel)


def adjust_lens(
    pose: npt.NDArray[np.intp],
    board: Floats,
    image: Floats,
    lens: Floats,
    poses: Floats,
    size: tuple[int, int],
    noise_px: float = 0.3,
    shift: float = 0.5,
    parallel: bool = False,
) -> tuple[Floats, Floats, float]:
    """Adjust one device alone: lens (8,), poses (pose, 6); gives both refined and the rms in px."""
    still = tuple(LENS + 6 * n + 5 for n in range(len(poses))) if parallel else ()
    prior = Prior((lens,), (size,), (shift,), still)
    problem = _Problem(pose, board, (_Device(0, None, image, noise_px, parallel),), LENS)
    vector = _minimise(problem, np.concatenate([lens, poses.ravel()]), prior, 60)
    rms = float(np.sqrt(2 * np.mean(problem.errors(vector) ** 2)) * noise_px)
    return vector[:LENS], vector[LENS:].reshape(-1, 6), rms


def information(
    corners: Corners,
    solution: Solution,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    noise_px: tuple[float, float],
) -> tuple[Floats, float, Floats]:
    """What the corners that count tell of the parameters.

    Returns
    -------
    normal : ndarray of float64, shape (parameter, parameter)
        J^T J of errors in standard deviations, priors included; order of `Solution.packed`.
    variance : float
        Sum of squared errors over degrees of freedom: 1 where `noise_px` is right.
    prior : ndarray of float64, shape (parameter,)
        The part of the diagonal that the priors give.
    """
    prior = _prior(solution, sizes)
    vector = solution.packed()
    errors, normal, _ = _pair(_used(corners), noise_px, solution.parallel).equations(vector, soft=False)
    J, believed = prior.jacobian(vector), prior.residuals(vector)
    freedom = max(errors.size + len(believed) - len(vector), 1)
    variance = float((errors**2).sum() + (believed**2).sum()) / freedom
    held = np.einsum("ki,ki->i", J, J)
    return normal + np.einsum("ki,kj->ij", J, J), variance, held


def _prior(solution: Solution, sizes: tuple[tuple[int, int], tuple[int, int]]) -> Prior:
    """Hold one distance per affine lens: of the first board from the camera, and of the camera from the projector."""
    places = (2 * LENS + 6 + 5, 2 * LENS + 5)
    still = tuple(place for place, held in zip(places, solution.parallel, strict=True) if held)
    return Prior((solution.camera, solution.projector), sizes, (CAMERA_SHIFT, PROJECTOR_SHIFT), still)


def robust_cost(
    solution: Solution, corners: Corners, use: npt.NDArray[np.bool_], noise_px: tuple[float, float]
) -> float:
    """Sum of Huber's loss over both coordinates in both devices, in squared standard deviations."""
    problem = _pair(_used(replace(corners, use=use)), noise_px, solution.parallel)
    return float((_soft(problem.errors(solution.packed())) ** 2).sum())


def _minimise(problem: _Problem, start: Floats, prior: Prior, rounds: int) -> Floats:
    """Levenberg and Marquardt's method on the normal equations, scaled by their diagonal (More 1978).

    scipy's `least_squares` reaches the same minimum, but spends seconds in singular values of a tall matrix.
    """

    def total(vector: Floats) -> float:
        return float((_soft(problem.errors(vector)) ** 2).sum() + (prior.residuals(vector) ** 2).sum())

    vector, cost, damping = start, total(start), 1e-3
    for _ in range(rounds):
        _, normal, slope = problem.equations(vector)
        J = prior.jacobian(vector)
        normal = normal + np.einsum("ki,kj->ij", J, J)
        slope = slope + np.einsum("ki,k->i", J, prior.residuals(vector))
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        normal, slope = normal * np.outer(scale, scale), slope * scale
        for _attempt in range(12):
            step = -scale * np.linalg.solve(normal + damping * np.eye(len(slope)), slope)
            new_cost = total(vector + step)
            if np.isfinite(new_cost) and new_cost <= cost:
                break
            damping *= 8
        else:
            return vector
        gain = cost - new_cost
        vector, cost = vector + step, new_cost
        damping = max(damping / 10, 1e-12)
        if gain <= 1e-10 * cost:
            return vector
    return vector


def lens_residuals(solution: Solution, corners: Corners) -> tuple[Floats, Floats]:
    """Reprojection errors (n, 2) in px of camera and projector, of all corners, used or not."""
    everything = replace(corners, use=np.ones(len(corners.pose), dtype=bool))
    flat = _pair(everything, (1.0, 1.0), solution.parallel).errors(solution.packed())
    return flat[0], flat[1]


def rms_px(solution: Solution, corners: Corners, use: npt.NDArray[np.bool_]) -> tuple[float, float, float]:
    """Root mean square distances in px as OpenCV defines them: camera, projector, stereo."""
    seen, lit = lens_residuals(solution, corners)
    a = float(np.sqrt((seen[use] ** 2).sum(axis=1).mean()))
    b = float(np.sqrt((lit[use] ** 2).sum(axis=1).mean()))
    return a, b, float(np.sqrt((a * a + b * b) / 2))


def _used(corners: Corners) -> Corners:
    keep = corners.use
    return Corners(
        corners.pose[keep], corners.board[keep], corners.camera[keep], corners.projector[keep], corners.use[keep]
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Device:
    """One device: where its lens begins in the vector, and its pose from the camera (None: it is the camera)."""

    lens: int
    stereo: int | None
    image: Floats
    noise_px: float
    parallel: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Corners seen by one device or two; the first `shared` numbers of the vector concern all corners."""

    pose: npt.NDArray[np.intp]
    board: Floats
    devices: tuple[_Device, ...]
    shared: int

    def errors(self, vector: Floats) -> Floats:
        """Errors (device, n, 2) in standard deviations."""
        poses = vector[self.shared :].reshape(-1, 6)
        points = _on_board(poses[:, :3], poses[:, 3:], self.pose, self.board)
        return np.stack([self._error(vector, device, points) for device in self.devices])

    def _error(self, vector: Floats, device: _Device, points: Floats) -> Floats:
        if device.stereo is not None:
            turn, shift = np.split(vector[device.stereo : device.stereo + 6], 2)
            points = _turned(rotation(turn), points) + shift
        result: Floats = (
            _view(vector[device.lens : device.lens + LENS], points, device.parallel) - device.image
        ) / device.noise_px
        return result

    def equations(self, vector: Floats, soft: bool = True) -> tuple[Floats, Floats, Floats]:
        """Errors (device, n, 2), J^T J and J^T e, of the robust loss or of the plain squares."""
        poses = vector[self.shared :].reshape(-1, 6)
        points = _on_board(poses[:, :3], poses[:, 3:], self.pose, self.board)
        inner = points - poses[self.pose, 3:]
        by_pose = np.concatenate(  # how a corner moves with its pose: (n, 3, 6)
            [_turn_slopes(poses[:, :3], self.pose, inner), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2
        )
        errors, slopes = [], []
        for device in self.devices:
            errors.append(self._error(vector, device, points))
            J = np.zeros((len(points), 2, self.shared + 6))
            lens = vector[device.lens : device.lens + LENS]
            if device.stereo is None:
                by_lens, by_point = view_slopes(lens, points, device.parallel)
            else:
                turn, shift = np.split(vector[device.stereo : device.stereo + 6], 2)
                R = rotation(turn)
                turned = _turned(R, points)
                by_lens, by_point = view_slopes(lens, turned + shift, device.parallel)
                whole = np.zeros(len(points), dtype=np.intp)
                J[:, :, device.stereo : device.stereo + 3] = by_point @ _turn_slopes(turn[None], whole, turned)
                J[:, :, device.stereo + 3 : device.stereo + 6] = by_point
                by_point = by_point @ R
            J[:, :, device.lens : device.lens + LENS] = by_lens
            J[:, :, self.shared :] = by_point @ by_pose
            slopes.append(J / device.noise_px)
        normal, slope = self._gathered(np.stack(errors), np.stack(slopes), soft)
        return np.stack(errors), normal, slope

    def _gathered(self, errors: Floats, slopes: Floats, soft: bool) -> tuple[Floats, Floats]:
        """Normal equations from compact rows: einsum's own loops, whose sums do not depend on threads."""
        count = int(self.pose.max()) + 1
        total = self.shared + 6 * count
        normal, slope = np.zeros((total, total)), np.zeros(total)
        weights = _soft_slope(errors) if soft else np.ones_like(errors)
        values = _soft(errors) if soft else errors
        for n in range(count):
            mine = self.pose == n
            J = (slopes[:, mine] * weights[:, mine][..., None]).reshape(-1, slopes.shape[-1])
            J = np.ascontiguousarray(J.T)
            here = np.concatenate([np.arange(self.shared), self.shared + 6 * n + np.arange(6)])
            normal[np.ix_(here, here)] += np.einsum("in,jn->ij", J, J)
            slope[here] += np.einsum("in,n->i", J, values[:, mine].ravel())
        return normal, slope


def _pair(corners: Corners, noise_px: tuple[float, float], parallel: tuple[bool, bool] = (False, False)) -> _Problem:
    camera = _Device(0, None, corners.camera, noise_px[0], parallel[0])
    projector = _Device(LENS, 2 * LENS, corners.projector, noise_px[1], parallel[1])
    return _Problem(corners.pose, corners.board, (camera, projector), 2 * LENS + 6)


def _turned(R: Array, points: Array) -> Array:
    """Points (n, 3) turned by R, without a matrix library: the same bits whatever the number of threads."""
    result: Array = points[:, :1] * R[:, 0] + points[:, 1:2] * R[:, 1] + points[:, 2:] * R[:, 2]
    return result


def _view(lens: Array, points: Array, parallel: bool) -> Array:
    z = np.ones_like(points[:, 2]) if parallel else points[:, 2]
    x, y = distort(
        points[:, 0] / z,
        points[:, 1] / z,
        np.concatenate([lens[4:8], np.zeros(1, dtype=lens.dtype)]),
    )
    return np.stack([lens[0] * x + lens[2], lens[1] * y + lens[3]], axis=1)


def view_slopes(lens: Floats, points: Floats, parallel: bool = False) -> tuple[Floats, Floats]:
    """Derivatives of a pixel by the lens (n, 2, 8) and by the point in the device's frame (n, 2, 3)."""
    fx, fy, k1, k2, p1, p2 = lens[0], lens[1], lens[4], lens[5], lens[6], lens[7]
    z = np.ones_like(points[:, 2]) if parallel else points[:, 2]
    x, y = points[:, 0] / z, points[:, 1] / z
    r2 = x * x + y * y
    radial, rise = 1 + r2 * (k1 + k2 * r2), 2 * (k1 + 2 * k2 * r2)
    xd, yd = distort(x, y, np.array([k1, k2, p1, p2, 0.0]))
    by_lens = np.zeros((len(z), 2, LENS))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = xd, yd
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1
    by_lens[:, 0, 4], by_lens[:, 1, 4] = fx * x * r2, fy * y * r2
    by_lens[:, 0, 5], by_lens[:, 1, 5] = fx * x * r2 * r2, fy * y * r2 * r2
    by_lens[:, 0, 6], by_lens[:, 1, 6] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
    by_lens[:, 0, 7], by_lens[:, 1, 7] = fx * (r2 + 2 * x * x), fy * 2 * x * y
    xx = radial + rise * x * x + 2 * p1 * y + 6 * p2 * x
    xy = rise * x * y + 2 * p1 * x + 2 * p2 * y
    yy = radial + rise * y * y + 6 * p1 * y + 2 * p2 * x
    by_point = np.stack(
        [
            np.stack([fx * xx, fx * xy, -fx * (xx * x + xy * y)], axis=1),
            np.stack([fy * xy, fy * yy, -fy * (xy * x + yy * y)], axis=1),
        ],
        axis=1,
    )
    if parallel:
        by_point[:, :, 2] = 0
    return by_lens, by_point / z[:, None, None]


def _turn_slopes(turns: Floats, which: npt.NDArray[np.intp], turned: Floats) -> Floats:
    """Derivatives (n, 3, 3) of turned points by their rotation vector: -[R p] times the left Jacobian of SO(3)."""
    angle = np.sqrt((turns * turns).sum(-1) + 1e-30)
    half = np.sin(angle / 2) / angle
    across = _cross(turns)
    squared = np.einsum("nij,njk->nik", across, across)
    thin = np.where(angle < 1e-4, 1 / 6, (angle - np.sin(angle)) / angle**3)
    left = np.eye(3) + (2 * half * half)[:, None, None] * across + thin[:, None, None] * squared
    slopes: Floats = -np.einsum("nij,njk->nik", _cross(turned), left[which])
    return slopes


def _cross(vectors: Floats) -> Floats:
    """Matrices (n, 3, 3) of the cross product with vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)


def _on_board(turns: Array, shifts: Array, pose: npt.NDArray[np.intp], board: Floats) -> Array:
    R = rotation(turns)[pose]
    points: Array = R[:, :, 0] * board[:, :1] + R[:, :, 1] * board[:, 1:] + shifts[pose]
    return points


# Huber's loss as a transformed residual: quadratic to 2 standard deviations, linear beyond.
HUBER = 2.0


def _soft(data: Floats) -> Floats:
    size = np.abs(data)
    return np.where(size <= HUBER, data, np.sign(data) * np.sqrt(HUBER * (2 * np.maximum(size, HUBER) - HUBER)))


def _soft_slope(data: Floats) -> Floats:
    size = np.abs(data)
    return np.where(size <= HUBER, 1.0, HUBER / np.sqrt(HUBER * (2 * np.maximum(size, HUBER) - HUBER)))
