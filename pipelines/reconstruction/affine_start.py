"""A first fit with affine lenses, whose rays are parallel: scales, tilts to either side, and the pose between devices.

An affine lens sees a tilted board the same whichever side is the nearer one (Necker's reversal), and sees nothing of
its distance. The other device tells both; if it is affine as well, the reversal of the whole scene stays open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .bundle import Corners, Solution, adjust_lens
from .pinhole import Floats, fit_homography, map_homography, rotation, rotation_vector

__all__ = ["OneLens", "as_pinhole", "join_parallel", "odd_mirror", "parallel_lens", "parallel_tilts", "reversed_scene"]

OneLens = tuple[Floats, Floats]
"""A lens (8,), and the boards' poses in its frame (pose, 6): rotation vectors and mm."""

SHAPES = (1.0, 2.0, 0.5)  # of a projector's pixels: some mirror arrays are 1:2
LEAST_TILT = 0.01  # rad: a board that faces the lens has no slope to start from
REVERSAL = np.diag([1.0, 1.0, -1.0])


def parallel_lens(
    corners: Corners, image: Floats, size: tuple[int, int], loose: float, square: bool
) -> tuple[OneLens, float]:
    """Fit one device on its own as an affine lens; gives lens, poses and the rms in px.

    Each board is tilted to one of its two sides, at no particular distance.
    """
    use = corners.use
    maps = [_affine(corners, image, n) for n in range(int(corners.pose.max()) + 1)]
    best: tuple[OneLens, float] | None = None
    for shape in SHAPES[: 1 if square else None]:
        pixels = np.array([1.0, shape])
        # The longest image of a length is the one that is not foreshortened.
        scale = float(np.median([np.linalg.svd(A[:, :2] / pixels[:, None])[1][0] for A in maps]))
        centre = (np.array(size) - 1) / 2
        lens = np.array([*(scale * pixels), *centre, 0.0, 0.0, 0.0, 0.0])
        six = [
            np.array(
                [*rotation_vector(parallel_tilts(A[:, :2] / lens[:2, None])[0]), *((A[:, 2] - centre) / lens[:2]), 0]
            )
            for A in maps
        ]
        lens, fitted, rms = adjust_lens(
            corners.pose[use], corners.board[use], image[use], lens, np.array(six), size, shift=loose, parallel=True
        )
        if best is None or rms < 0.98 * best[1]:
            best = (lens, fitted), rms
    assert best is not None
    return best


def parallel_tilts(seen: Floats) -> list[Floats]:
    """Both rotations of a board whose plane a lens sees through this 2x2 map, in board units: tilted to either side."""
    U, sizes, V = np.linalg.svd(seen)
    slope = np.sqrt(1 - min(sizes[1] / sizes[0], np.cos(LEAST_TILT)) ** 2)
    flat = U @ np.diag([1.0, np.sqrt(1 - slope**2)]) @ V
    both = []
    for side in (1.0, -1.0):
        x, y = np.append(flat[:, 0], side * slope * V[1, 0]), np.append(flat[:, 1], side * slope * V[1, 1])
        both.append(np.stack([x, y, np.cross(x, y)], axis=1))
    return both


def odd_mirror(corners: Corners) -> bool:
    """Whether exactly one of the two devices mirrors: the map from one image to the other turns its sense round."""
    here = corners.use
    senses = []
    for n in range(int(corners.pose.max()) + 1):
        mine = here & (corners.pose == n)
        A, B = _affine(corners, corners.camera, n), _affine(corners, corners.projector, n)
        senses.append(mine.sum() * np.sign(np.linalg.det(A[:, :2]) * np.linalg.det(B[:, :2])))
    return bool(np.sum(senses) < 0)


def join_parallel(camera: OneLens, projector: OneLens, parallel: tuple[bool, bool]) -> Solution:
    """Find the pose between the devices that most boards agree on, each board tilted to one of two sides."""
    seen, lit = (
        [_both_sides(pose, held) for pose in one[1]] for one, held in zip((camera, projector), parallel, strict=True)
    )
    best_cost, best_R, best_choice = np.inf, np.eye(3), [(0, 0)] * len(seen)
    for n in range(len(seen)):
        for a in seen[n]:
            for b in lit[n]:
                R = b @ a.T
                cost, choice = 0.0, []
                for c, d in zip(seen, lit, strict=True):
                    turns = [[_angle(R @ one @ other.T) for other in d] for one in c]
                    least = np.unravel_index(int(np.argmin(turns)), (len(c), len(d)))
                    cost += min(float(turns[least[0]][least[1]]), 0.5)
                    choice.append((int(least[0]), int(least[1])))
                if cost < best_cost:
                    best_cost, best_R, best_choice = cost, R, choice
    tilts = [options[pick[0]] for options, pick in zip(seen, best_choice, strict=True)]
    shift, away = _places(best_R, camera[1][:, 3:], projector[1][:, 3:], parallel)
    return Solution(
        camera[0],
        projector[0],
        rotation_vector(best_R),
        shift,
        np.array([rotation_vector(R) for R in tilts]),
        camera[1][:, 3:] + away[:, None] * np.array([0.0, 0.0, 1.0]),
        parallel,
    )


def reversed_scene(solution: Solution) -> Solution:
    """Give the other reading of what long lenses see: far is near, and the projector stands on the other side.

    The scene is mirrored in depth about the middle of the boards; two affine lenses see the same.
    """
    R, middle = rotation(solution.turn), solution.pose_shifts.mean(axis=0)
    other = REVERSAL @ R @ REVERSAL
    turns = [rotation_vector(REVERSAL @ rotation(turn) @ REVERSAL) for turn in solution.pose_turns]
    return replace(
        solution,
        turn=rotation_vector(other),
        shift=R @ middle + solution.shift - other @ middle,
        pose_turns=np.array(turns),
        pose_shifts=middle + (solution.pose_shifts - middle) @ REVERSAL,
    )


def as_pinhole(solution: Solution, which: tuple[bool, bool], fields: float) -> Solution:
    """Give affine lenses a place, this many widths of their field away from what they see."""
    camera, projector = solution.camera.copy(), solution.projector.copy()
    shift, poses = solution.shift.copy(), solution.pose_shifts.copy()
    R = rotation(solution.turn)
    if which[0]:
        far = fields * _field_mm(camera)
        moved = far - float(poses[:, 2].mean())
        poses[:, 2] += moved
        shift = shift - R[:, 2] * moved
        _stretch(camera, far)
    if which[1]:
        far = fields * _field_mm(projector)
        shift[2] += far - float((poses @ R.T + shift)[:, 2].mean())
        _stretch(projector, far)
    held = solution.parallel[0] and not which[0], solution.parallel[1] and not which[1]
    return replace(solution, camera=camera, projector=projector, shift=shift, pose_shifts=poses, parallel=held)


def _field_mm(lens: Floats) -> float:
    return float(2 * abs(lens[2] / lens[0]))  # the centre lies near the image's


def _stretch(lens: Floats, far: float) -> None:
    lens[:2] *= far
    lens[4] *= far**2
    lens[5] *= far**4
    lens[6:8] *= far


def _affine(corners: Corners, image: Floats, n: int) -> Floats:
    """The affine part (2, 3) of how the image shows the board of pose n, about the board's centre."""
    mine = corners.use & (corners.pose == n)
    H = fit_homography(corners.board[mine], image[mine])
    middle = map_homography(H, np.zeros(2))
    slope = H[:2, :2] - middle[:, None] * H[2, :2]
    return np.concatenate([slope, middle[:, None]], axis=1)


def _both_sides(pose: Floats, parallel: bool) -> Sequence[Floats]:
    """Rotations of a board that its lens cannot tell apart, or hardly."""
    R = rotation(pose[:3])
    axis = np.array([0.0, 0.0, 1.0]) if parallel else pose[3:] / np.linalg.norm(pose[3:])
    mirror = np.eye(3) - 2 * np.outer(axis, axis)
    return [R, mirror @ R @ REVERSAL]


def _angle(R: Floats) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))


def _places(R: Floats, seen: Floats, lit: Floats, parallel: tuple[bool, bool]) -> tuple[Floats, Floats]:
    """Shift (3,) between the devices and what an affine camera's boards (pose,) lie away, by least squares.

    R (seen + away e_z) + shift = lit + beyond e_z; `away` is 0 for a pinhole camera, `beyond` for a pinhole projector.
    """
    count = len(seen)
    rows = np.zeros((3 * count, 3 + 2 * count))
    for n in range(count):
        rows[3 * n : 3 * n + 3, :3] = np.eye(3)
        if parallel[0]:
            rows[3 * n : 3 * n + 3, 3 + n] = R[:, 2]
        if parallel[1]:
            rows[3 * n + 2, 3 + count + n] = -1.0
    found = np.asarray(np.linalg.lstsq(rows, (lit - seen @ R.T).ravel(), rcond=None)[0], dtype=np.float64)
    return found[:3], found[3 : 3 + count]
