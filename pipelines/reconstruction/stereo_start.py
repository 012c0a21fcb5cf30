"""From corners to a first fit of two pinholes: guesses of both, mirror hypotheses, the pose between the devices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .affine_start import OneLens
from .bundle import Corners, Solution, adjust, adjust_lens, rms_px
from .pinhole import Floats, finite, fit_homography, plane_pose, rotation, rotation_vector

__all__ = ["PoseCorners", "flat", "join_pinholes", "mirror", "pinhole_lens"]

MIRROR_GAIN = 2.0  # a mirror is believed only if it makes the rms this many times smaller


@dataclass(frozen=True, slots=True, eq=False)
class PoseCorners:
    """One pose: corners on the board (n, 2) mm, in the camera (n, 2) px, on the projector (n, 2) px with NaN.

    `agreeing` is the share of the board's decoded pixels that follow one smooth plane.
    """

    name: str
    board: Floats
    camera: Floats
    projector: Floats
    agreeing: float = 1.0


def join_pinholes(
    corners: Corners,
    camera: OneLens,
    projector: OneLens,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    mirrors: Sequence[str] = ("none", "camera"),
) -> Solution:
    """Fit both devices to all corners, none left out, from a fit of each on its own.

    Parameters
    ----------
    corners : Corners
    camera, projector : OneLens
    sizes : ((int, int), (int, int))
        Columns and rows of camera and projector.
    mirrors : sequence of str
        Which devices may be mirrored: ``none``, ``camera``, ``projector``, ``both``; the first one needs no proof.
    """
    best: Solution | None = None
    best_rms = np.inf
    for name in mirrors:
        candidate = adjust(corners, _join(*mirror(camera, projector, name)), sizes, (0.2, 0.3), rounds=25)
        rms = rms_px(candidate, corners, corners.use)[2]
        if best is None or rms * MIRROR_GAIN < best_rms:
            best, best_rms = candidate, rms
    assert best is not None
    return best


def mirror(camera: OneLens, projector: OneLens, name: str) -> tuple[OneLens, OneLens]:
    """Turn the devices round that are mirrored by this name."""
    return (
        _mirror(camera) if name in ("camera", "both") else camera,
        _mirror(projector) if name in ("projector", "both") else projector,
    )


def flat(poses: Sequence[PoseCorners]) -> Corners:
    """All corners of some poses, each board about its own centre; those that were not decoded do not count."""
    lit = np.concatenate([pose.projector for pose in poses])
    return Corners(
        pose=np.concatenate([np.full(len(pose.board), n) for n, pose in enumerate(poses)]),
        board=np.concatenate([pose.board - pose.board.mean(axis=0) for pose in poses]),
        camera=np.concatenate([pose.camera for pose in poses]),
        projector=lit,
        use=finite(lit),
    )


def pinhole_lens(
    corners: Corners, image: Floats, size: tuple[int, int], shifts: tuple[float, ...], loose: float
) -> tuple[OneLens, float]:
    """Calibrate one device on its own, from several first guesses; gives lens and poses, and the rms in px.

    Raises
    ------
    ValueError
        If no lens explains the corners.
    """
    use = corners.use
    homographies = [
        fit_homography(corners.board[use & (corners.pose == n)], image[use & (corners.pose == n)])
        for n in range(int(corners.pose.max()) + 1)
    ]
    best: OneLens | None = None
    best_rms = np.inf
    for shift in shifts:
        centre = np.array([(size[0] - 1) / 2, shift * (size[1] - 1)])
        for focal in _focal_guesses(homographies, centre, size):
            K = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])
            six = []
            for H in homographies:
                R, t = plane_pose(K, H)
                six.append(np.concatenate([rotation_vector(R), t]))
            lens = np.array([*focal, *centre, 0.0, 0.0, 0.0, 0.0])
            lens, fitted, rms = adjust_lens(
                corners.pose[use], corners.board[use], image[use], lens, np.array(six), size, shift=loose
            )
            if lens[0] > 0 and lens[1] > 0 and (fitted[:, 5] > 0).all() and rms < 0.98 * best_rms:
                best, best_rms = (lens, fitted), rms
    if best is None:
        raise ValueError("no lens explains the corners: are the poses tilted, and the corners those of the board?")
    return best, best_rms


def _focal_guesses(homographies: Sequence[Floats], centre: Floats, size: tuple[int, int]) -> list[tuple[float, float]]:
    """Zhang's closed form for fx and fy with a known principal point, or common lenses where it has no answer."""
    rows, rhs = [], []
    shift = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1.0]])
    for H in homographies:
        a, b = (shift @ H)[:, 0], (shift @ H)[:, 1]
        scale = np.linalg.norm(a[:2]) * np.linalg.norm(b[:2])
        rows += [
            np.array([a[0] * b[0], a[1] * b[1]]) / scale,
            np.array([a[0] ** 2 - b[0] ** 2, a[1] ** 2 - b[1] ** 2]) / scale,
        ]
        rhs += [-a[2] * b[2] / scale, -(a[2] ** 2 - b[2] ** 2) / scale]
    inverse = np.linalg.lstsq(np.array(rows), np.array(rhs), rcond=None)[0]
    if (inverse > 0).all():
        fx, fy = 1 / np.sqrt(inverse)
        if 0.2 < fx / size[0] < 50 and 0.2 < fy / size[1] < 50:
            return [(float(fx), float(fy))]
    return [(f * size[0], f * size[0] * r) for f in (1.5, 5.0, 15.0) for r in (1.0, 2.0, 0.5)]


def _mirror(one: OneLens) -> OneLens:
    """The same picture by a mirrored lens: x of the device's frame turns round, and each board's normal with it."""
    lens, poses = one[0].copy(), one[1].copy()
    lens[0] = -lens[0]
    lens[7] = -lens[7]
    flip = np.diag([-1.0, 1.0, 1.0])
    for pose in poses:
        pose[:3] = rotation_vector(flip @ rotation(pose[:3]) @ np.diag([1.0, 1.0, -1.0]))
        pose[3] = -pose[3]
    return lens, poses


def _join(camera: OneLens, projector: OneLens) -> Solution:
    """Find the pose between the devices that most boards agree on.

    A plane seen through a long lens has two poses, tilted to either side, that look nearly alike: both are tried.
    """
    seen = [_both_tilts(pose) for pose in camera[1]]
    lit = [_both_tilts(pose) for pose in projector[1]]
    count = len(seen)
    best_cost, best = np.inf, None
    for n in range(count):
        for a in seen[n]:
            for b in lit[n]:
                R = b[0] @ a[0].T
                t = b[1] - R @ a[1]
                cost, chosen = 0.0, []
                for m in range(count):
                    options = []
                    for c in seen[m]:
                        for d in lit[m]:
                            turn = np.arccos(np.clip((np.trace(R @ c[0] @ d[0].T) - 1) / 2, -1, 1))
                            off = np.linalg.norm(R @ c[1] + t - d[1]) / np.linalg.norm(d[1])
                            options.append((turn + off, c))
                    least = min(options, key=lambda option: option[0])
                    cost += min(least[0], 0.5)
                    chosen.append(least[1])
                if cost < best_cost:
                    best_cost, best = cost, (R, t, chosen)
    assert best is not None
    R, t, chosen = best
    return Solution(
        camera[0],
        projector[0],
        rotation_vector(R),
        t,
        np.array([rotation_vector(pose[0]) for pose in chosen]),
        np.array([pose[1] for pose in chosen]),
    )


def _both_tilts(pose: Floats) -> list[tuple[Floats, Floats]]:
    R, t = rotation(pose[:3]), pose[3:]
    axis = t / np.linalg.norm(t)  # mirror the normal about the line of sight
    normal = R[:, 2]
    other = 2 * (normal @ axis) * axis - normal
    twist = np.cross(normal, other)
    sine, cosine = np.linalg.norm(twist), float(normal @ other)
    if sine < 1e-9:
        return [(R, t)]
    return [(R, t), (rotation(twist / sine * np.arctan2(sine, cosine)) @ R, t)]
