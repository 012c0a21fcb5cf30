"""Whether the boards of a calibration differ: copies tell nothing new, and how much of the field they reached."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .pinhole import Floats, finite, project
from .rig_model import Calibration
from .sight import in_front, on_plane
from .stereo_start import PoseCorners

__all__ = ["copies", "covered_share"]

MOVED = 0.01  # of the board's size in the image: a board that moved by less, for both devices, stands where it stood
NODES = (48, 36)


def copies(poses: Sequence[PoseCorners], wanted: int) -> dict[int, int]:
    """Tell which poses show the board where another one shows it: the copy's number, and the one that it repeats.

    Parameters
    ----------
    poses : sequence of PoseCorners
    wanted : int
        A pose that is no copy: the others are copies of it.
    """
    order = sorted(range(len(poses)), key=lambda n: n != wanted)
    kept: list[int] = []
    found: dict[int, int] = {}
    for n in order:
        twin = next((m for m in kept if _same_place(poses[m], poses[n])), None)
        if twin is None:
            kept.append(n)
        else:
            found[n] = twin
    return dict(sorted(found.items()))


def _same_place(one: PoseCorners, other: PoseCorners) -> bool:
    both, here, there = _common(one.board, other.board)
    if both < 4:
        return False
    for a, b in ((one.camera[here], other.camera[there]), (one.projector[here], other.projector[there])):
        seen = finite(a) & finite(b)
        if seen.sum() < 4:
            return False
        size = float(np.linalg.norm(a[seen].max(axis=0) - a[seen].min(axis=0)))
        if float(np.median(np.linalg.norm(a[seen] - b[seen], axis=1))) > MOVED * size:
            return False
    return True


def _common(one: Floats, other: Floats) -> tuple[int, list[int], list[int]]:
    """Corners of the board that both poses found: their count, and where each of them stands in both lists."""
    places = {tuple(place): n for n, place in enumerate(one.tolist())}
    pairs = [(places[tuple(place)], n) for n, place in enumerate(other.tolist()) if tuple(place) in places]
    return len(pairs), [a for a, _ in pairs], [b for _, b in pairs]


def covered_share(calibration: Calibration) -> float | None:
    """Share of what camera and projector both see of the reference plane that lay within some board's corners.

    None where the calibration keeps no corners, or the two see nothing in common.
    """
    from scipy.spatial import Delaunay, QhullError

    corners = [
        np.array([(corner.column, corner.row) for corner in pose.corners if corner.used]) for pose in calibration.poses
    ]
    if not any(len(each) > 3 for each in corners):
        return None
    axes = (np.linspace(0, side - 1, count) for side, count in zip(calibration.camera.size, NODES, strict=True))
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    points = on_plane(calibration.camera, calibration.reference, pixels)
    lit = points @ calibration.R.T + calibration.t_mm
    seen = in_front(calibration.projector, lit) & in_front(calibration.camera, points)
    there = project(calibration.projector, lit[seen])
    field = pixels[seen][((there >= 0) & (there <= np.array(calibration.projector.size) - 1)).all(axis=1)]
    if len(field) == 0:
        return None
    covered = np.zeros(len(field), dtype=bool)
    for each in corners:
        if len(each) > 3:
            try:
                covered |= Delaunay(each).find_simplex(field) >= 0
            except QhullError:  # all on one line: no area
                continue
    return float(covered.mean())
