"""Calibration from board poses: corners in the images, their place on the projector, and the joint adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from .board import Board, CharucoBoard
from .corner_evidence import MIN_POSES
from .corner_search import find_board, find_corners
from .frames import Frames
from .pinhole import finite
from .pixel_maps import Decoded
from .projector_corners import CornerMethod, projector_corners
from .rig_model import Calibration
from .solve import solve
from .stereo_start import PoseCorners
from .subpixel import locate

__all__ = ["MIN_POSES", "Mirrored", "ProjectorSide", "calibrate", "calibrate_decoded", "find_corners"]

Mirrored = Literal["auto", "none", "camera", "projector", "both"]
ProjectorSide = Literal["auto", "left", "right", "above", "below"]


def calibrate(
    poses: Sequence[Frames],
    board: Board | CharucoBoard,
    names: Sequence[str] | None = None,
    reference: int = 0,
    software: str = "",
    method: CornerMethod = "plane",
    mirrored: Mirrored = "auto",
    projector_side: ProjectorSide = "auto",
) -> Calibration:
    """Calibrate a rig from captures of a chessboard in at least 3 poses.

    See `calibrate_decoded`; this decodes the frames first.
    """
    return calibrate_decoded(
        [locate(frames) for frames in poses],
        poses[0].patterns.size if poses else (0, 0),
        board,
        names=names,
        reference=reference,
        software=software,
        method=method,
        mirrored=mirrored,
        projector_side=projector_side,
    )


def calibrate_decoded(
    poses: Sequence[Decoded],
    projector_size: tuple[int, int],
    board: Board | CharucoBoard,
    names: Sequence[str] | None = None,
    reference: int = 0,
    software: str = "",
    method: CornerMethod = "plane",
    mirrored: Mirrored = "auto",
    projector_side: ProjectorSide = "auto",
) -> Calibration:
    """Calibrate a rig from decoded captures of a chessboard.

    Corners come from the lit image, their projector positions from the decoded pixels (`method`), and one bundle
    adjustment finds both lenses, the pose between them and all boards. Corners beyond 6 standard deviations are left
    out and named; a pose that fits none of the others is left out as a whole and says why (`PoseResidual.advice`).

    A half turn of the image or of the projector needs no handling: turning a device about its own axis by 180
    degrees is a rotation, and so part of R. Nor does the end that a board was found from: all four ways of counting a
    lattice are rigid motions of the same plane, and no number of the result depends on the choice.

    A mirror is no rotation. If exactly one of the two devices is mirrored, each of them still fits alone, but no pose
    between them fits all boards; both hypotheses are tried and the one with the lower rms is kept. What cannot be
    known: *which* of the two is mirrored, and whether both are, because a chessboard's lattice looks the same in a
    mirror. With ``mirrored="auto"`` it is then assumed that the camera is the mirrored one, or that neither is;
    if that is wrong, heights, distances and volumes stay right and the map is seen in a mirror. The markers of a
    ChArUco board read in one way only, so with one both devices are known.

    A lens far away for its field (telecentric, or nearly) is taken to be affine where a pinhole fits no better
    (`first_fit`). If both are, nothing in the corners tells heights from depths: `projector_side` does, and without it
    ``notes`` of the calibration say what was assumed.

    Parameters
    ----------
    poses : sequence of Decoded
        At least 3, both axes decoded, all of one image size.
    projector_size : (int, int)
        Projector columns, rows.
    board : Board or CharucoBoard
    names : sequence of str, optional
        Of the poses, for messages and residuals.
    reference : int
        Pose whose board is the plane z = 0 of the site frame.
    software : str
        Name and version of what calibrates.
    method : {"plane", "local"}
        How decoded pixels are carried to the corners; see `projector_corners`.
    mirrored : {"auto", "none", "camera", "projector", "both"}
    projector_side : {"auto", "left", "right", "above", "below"}
        Where the projector stands, seen in the camera's image; it decides where the corners do not.

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        Fewer than 3 (good) poses, images of different sizes, a board that is not found, or too little decoded on it.
    """
    labels = list(names) if names is not None else [f"pose {n}" for n in range(len(poses))]
    if len(poses) < MIN_POSES:
        raise ValueError(
            f"{len(poses)} pose{'s' * (len(poses) != 1)} given ({', '.join(labels) or 'none'}), "
            f"at least {MIN_POSES} are needed: capture the board at more tilts"
        )
    shape = poses[0].column.shape
    for label, decoded in zip(labels, poses, strict=True):
        if decoded.column.shape != shape:
            raise ValueError(
                f"{label}: images of {decoded.column.shape[1]}x{decoded.column.shape[0]}, but {labels[0]} has "
                f"{shape[1]}x{shape[0]}: take all poses with the same camera settings"
            )
    seen, flips = [], []
    for label, decoded in zip(labels, poses, strict=True):
        here = find_board(decoded.texture, board, label)
        lit = projector_corners(decoded, here.corners, here.lattice, method)
        found = finite(lit.at)
        if found.mean() < 0.5:
            raise ValueError(
                f"{label}: the board is found, but only {int(found.sum())} of {len(found)} corners are decoded: "
                "is it lit by the projector, and are these the right patterns? Capture it again, or leave it out"
            )
        points = here.lattice.astype(np.float64) * board.square_mm
        seen.append(PoseCorners(label, points, here.corners, lit.at, lit.agreeing))
        flips.append(here.flipped)
    if len(set(flips)) > 1:
        one, other = labels[flips.index(True)], labels[flips.index(False)]
        raise ValueError(f"{one} shows the board in a mirror, {other} does not: take all poses with the same optics")
    size = shape[1], shape[0]
    return solve(
        seen, size, projector_size, board, reference, software, mirrored, flipped=flips[0], side=projector_side
    )
