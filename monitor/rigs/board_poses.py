"""Board poses: the simulated rig looks at a chessboard, shown as somebody who calibrates would show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipelines import Frames, Instant, PatternSet
from pipelines.scenes import Chessboard

from .simulated import SimulatedRig

__all__ = ["BOARD", "calibration_captures"]

BOARD = Chessboard()
"""The board that is shown: 14x9 inner corners of 0.85 mm."""

BOARD_EXPOSURE_MS = 4.6

POSES: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),  # flat at z = 0: the plane that heights are measured from
    ((13.0, 2.0, 1.5), (0.1, -0.2, 0.4)),
    ((-12.0, 3.0, -2.0), (-0.2, 0.1, -0.5)),
    ((2.0, 14.0, 3.0), (0.2, 0.1, 0.6)),
    ((-3.0, -13.0, -1.0), (-0.1, -0.1, -0.4)),
    ((9.0, -9.0, 4.0), (0.0, 0.2, 0.9)),
    ((-8.0, 10.0, -5.0), (0.1, 0.0, -1.0)),
    ((10.0, 10.0, 8.0), (-0.1, 0.1, 0.0)),
    ((-11.0, -8.0, -7.0), (0.1, -0.2, 1.2)),
)
"""Tilts about x, y, z in degrees and shifts in mm, within the depth of field."""


def calibration_captures(
    options: Mapping[str, Any], patterns: PatternSet, at: Instant, n_poses: int = 6
) -> list[Frames]:
    """Take captures of a board with the optics of a simulated rig.

    Parameters
    ----------
    options : mapping
        The options of the rig that is to be calibrated; its scene, age and faults do not matter.
    patterns : PatternSet
    at : Instant
        Time of the first capture; the next ones follow a minute apart.
    n_poses : int
        3 to 9. In the first the board lies flat at z = 0.

    Returns
    -------
    list of Frames
        To be given to `pipelines.reconstruction.calibrate`, with `BOARD`'s corners and squares. Nothing else leaves the
        simulation.

    Raises
    ------
    ValueError
        If there are not so many poses.
    InputError
        If an option is wrong.
    """
    if not 3 <= n_poses <= len(POSES):
        raise ValueError(f"n_poses must be 3 to {len(POSES)}, not {n_poses}")
    scenery = ("scene", "scene_options", "started", "pace", "faults", "exposure_ms")
    kept = {name: value for name, value in options.items() if name not in scenery}
    rig = SimulatedRig(
        **kept,
        scene="board",
        scene_options={"inner_corners": BOARD.inner_corners, "square_mm": BOARD.square_mm},
        exposure_ms=BOARD_EXPOSURE_MS,
    )
    rig.open()
    try:
        return [
            rig.capture_posed(patterns, at + np.timedelta64(number, "m"), tilt, shift)
            for number, (tilt, shift) in enumerate(POSES[:n_poses])
        ]
    finally:
        rig.close()
