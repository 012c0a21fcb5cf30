"""Two rigs that were calibrated on one board: how the site frame of one lies in that of the other."""

from __future__ import annotations

import numpy as np

from .gridding import on_reference
from .pinhole import Floats
from .rig_model import Calibration

__all__ = ["site_to_site"]

FITS = 0.05  # of a square: corners that miss by more are not those of the reference pose


def site_to_site(second: Calibration, first: Calibration) -> list[Floats]:
    """Give the motions that may take the second rig's site frame to the first one's.

    Both rigs saw one board that did not move as the pose that heights count from. Its corners as each rig's camera saw
    them, laid on the reference plane, are matched; corners may be counted from either end of the board, so
    there are two motions, half a turn apart: registration of what both rigs see decides.

    Parameters
    ----------
    second, first : Calibration
        With the corners of their poses (``calibration.json`` of `microrelief calibrate` has them).

    Returns
    -------
    list of ndarray of float64, shape (4, 4)
        x_first = matrix @ x_second, mm; the best fit first.

    Raises
    ------
    ValueError
        If the boards differ, or a calibration holds no corners of its reference pose.
    """
    if (first.board or {}) != (second.board or {}) or not first.board:
        raise ValueError("the two calibrations are not of one board")
    one, two = _on_board(first), _on_board(second)
    square = float(first.board["square_mm"])
    found = []
    for flipped in (two, two[::-1], two[:, ::-1], two[::-1, ::-1]):
        matrix, rms = _rigid(flipped.reshape(-1, 2), one.reshape(-1, 2))
        if rms < FITS * square:
            found.append((rms, matrix))
    if not found:
        raise ValueError("the reference poses of the two calibrations do not show one board")
    return [matrix for _, matrix in sorted(found, key=lambda each: each[0])]


def _on_board(calibration: Calibration) -> Floats:
    """Corners of the reference pose in the site frame, shape (rows, columns, 2), mm."""
    assert calibration.board is not None
    columns, rows = calibration.board["inner_corners"]
    square = float(calibration.board["square_mm"])
    lattice = square * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    best, least = None, FITS * square
    for pose in calibration.poses:
        if len(pose.corners) != columns * rows:
            continue
        pixels = np.array([(corner.column, corner.row) for corner in pose.corners], dtype=np.float64)
        camera = on_reference(calibration, pixels)
        site = camera @ calibration.reference[:, :3].T + calibration.reference[:, 3]
        corners = site[:, :2].reshape(rows, columns, 2)
        # the lattice may be counted in either hand
        rms = min(_rigid(each.reshape(-1, 2), lattice.reshape(-1, 2))[1] for each in (corners, corners[::-1]))
        if rms < least:
            best, least = corners, rms
    if best is None:
        raise ValueError("a calibration holds no corners of its reference pose")
    return best


def _rigid(source: Floats, target: Floats) -> tuple[Floats, float]:
    """Rotation about z and shift that take points to others (Umeyama 1991, without scale), and the rms left."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = np.eye(4)
    matrix[:2, :2] = turn
    matrix[:2, 3] = target.mean(axis=0) - turn @ source.mean(axis=0)
    rms = float(np.sqrt(((a @ turn.T - b) ** 2).sum(axis=1).mean()))
    return matrix, rms
