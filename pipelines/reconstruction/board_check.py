"""A board measured in 3D by a calibration: is it flat, and are its squares as large as they were made?"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from .bundle import Solution
from .corner_evidence import MIN_POSES, Fit, without
from .pinhole import Floats, finite, undistort
from .rig_model import BoardCheck, Calibration
from .sight import projector_rows, sight
from .stereo_start import PoseCorners

__all__ = ["check_board", "corner_points", "held_out"]


def corner_points(rig: Calibration, camera: Floats, projector: Floats) -> Floats:
    """Points (n, 3) mm, camera frame, of positions (n, 2) px in camera and projector.

    The point lies on the camera's ray, where it misses the projector's position least (both axes alike, px).
    """
    start, ray = sight(rig.camera, camera)
    lit = undistort(rig.projector, projector)
    R, shift = projector_rows(rig)
    d, t = np.einsum("ij,nj->ni", R, ray), np.einsum("ij,nj->ni", R, start) + shift
    focal = np.abs([rig.projector.K[0, 0], rig.projector.K[1, 1]])
    a, b = focal * (d[:, :2] - lit * d[:, 2:]), focal * (t[:, :2] - lit * t[:, 2:])
    points: Floats = start + ray * (-(a * b).sum(axis=1) / (a * a).sum(axis=1))[:, None]
    return points


def check_board(
    rig: Calibration, pose: PoseCorners, square_mm: float, use: npt.NDArray[np.bool_] | None = None
) -> BoardCheck:
    """Measure a board in 3D.

    Parameters
    ----------
    rig : Calibration
    pose : PoseCorners
    square_mm : float
        Side of a square, which tells neighbours.
    use : ndarray of bool, shape (corner,), optional
        Corners that count; by default all that were decoded.
    """
    keep = finite(pose.projector) if use is None else use & finite(pose.projector)
    points = corner_points(rig, pose.camera[keep], pose.projector[keep])
    board = np.rint(pose.board[keep] / square_mm).astype(np.intp)
    one, other = np.nonzero(np.triu(np.abs(board[:, None] - board).sum(axis=-1) == 1))
    sides = np.linalg.norm(points[one] - points[other], axis=1)
    sd = float(sides.std(ddof=1)) if len(sides) > 1 else 0.0
    return BoardCheck(pose.name, _off_plane(points), float(sides.mean()), sd, len(sides))


def held_out(
    here: Fit,
    poses: Sequence[PoseCorners],
    square_mm: float,
    rig_of: Callable[[Solution], Calibration],
    sizes: tuple[tuple[int, int], tuple[int, int]],
) -> tuple[BoardCheck, ...]:
    """Measure each board with a calibration from all other poses; nothing for fewer than 4 poses.

    All decoded corners of the board count, those too that the whole fit rejected.
    """
    if len(poses) <= MIN_POSES:
        return ()
    return tuple(check_board(rig_of(without(here, n, sizes)), pose, square_mm) for n, pose in enumerate(poses))


def _off_plane(points: Floats) -> float:
    """Robust standard deviation (1.4826 MAD) about the plane that fits without far points, mm."""
    keep = np.ones(len(points), dtype=bool)
    spread = 0.0
    for _ in range(6):
        centre = points[keep].mean(axis=0)
        off = points[keep] - centre
        _, axes = np.linalg.eigh(np.einsum("ni,nj->ij", off, off))
        distance = (points - centre) @ axes[:, 0]
        spread = float(1.4826 * np.median(np.abs(distance - np.median(distance))))
        keep = np.abs(distance) <= max(4 * spread, 1e-9)
    return spread
