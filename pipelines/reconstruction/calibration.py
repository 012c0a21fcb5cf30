"""Calibration from board poses: corners in the images, their place on the projector, and the joint adjustment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from .board import Board
from .frames import Frames
from .pinhole import Floats, finite
from .pixel_maps import Decoded
from .projector_corners import CornerMethod, corner_spacing_px, projector_corners
from .rig_model import Calibration
from .stereo_start import PoseCorners, solve
from .subpixel import locate

__all__ = ["MIN_POSES", "Mirrored", "calibrate", "calibrate_decoded", "find_corners"]

MIN_POSES = 3
Mirrored = Literal["auto", "none", "camera", "projector"]


def calibrate(
    poses: Sequence[Frames],
    board: Board,
    names: Sequence[str] | None = None,
    reference: int = 0,
    software: str = "",
    method: CornerMethod = "plane",
    mirrored: Mirrored = "auto",
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
    )


def calibrate_decoded(
    poses: Sequence[Decoded],
    projector_size: tuple[int, int],
    board: Board,
    names: Sequence[str] | None = None,
    reference: int = 0,
    software: str = "",
    method: CornerMethod = "plane",
    mirrored: Mirrored = "auto",
) -> Calibration:
    """Calibrate a rig from decoded captures of a chessboard.

    Corners come from the lit image, their projector positions from the decoded pixels (`method`), and one bundle
    adjustment finds both lenses, the pose between them and all boards, with outlying corners (5 % at most) rejected.

    A half turn of the image or of the projector needs no handling: turning a device about its own axis by 180
    degrees is a rotation, and so part of R. Nor does the end that a board was found from: all four ways of counting a
    lattice are rigid motions of the same plane, and no number of the result depends on the choice.

    A mirror is no rotation. If exactly one of the two devices is mirrored, each of them still fits alone, but no pose
    between them fits all boards; both hypotheses are tried and the one with the lower rms is kept. What cannot be
    known: *which* of the two is mirrored, and whether both are, because a chessboard's lattice looks the same in a
    mirror. With ``mirrored="auto"`` it is then assumed that the camera is the mirrored one, or that neither is;
    if that is wrong, heights, distances and volumes stay right and the map is seen in a mirror.

    Parameters
    ----------
    poses : sequence of Decoded
        At least 3, both axes decoded, all of one image size.
    projector_size : (int, int)
        Projector columns, rows.
    board : Board
    names : sequence of str, optional
        Of the poses, for messages and residuals.
    reference : int
        Pose whose board is the plane z = 0 of the site frame.
    software : str
        Name and version of what calibrates.
    method : {"plane", "local"}
        How decoded pixels are carried to the corners; see `projector_corners`.
    mirrored : {"auto", "none", "camera", "projector"}

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        Fewer than 3 poses, images of different sizes, a board that is not found, or too little decoded on it.
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
    seen = []
    for label, decoded in zip(labels, poses, strict=True):
        corners, inner = find_corners(decoded.texture, board, label)
        lit = projector_corners(decoded, corners, inner, method)
        found = finite(lit)
        if found.mean() < 0.5:
            raise ValueError(
                f"{label}: the board is found, but only {int(found.sum())} of {len(found)} corners are decoded: "
                "is it lit by the projector, and are these the right patterns?"
            )
        seen.append(PoseCorners(label, Board(inner, board.square_mm).points_mm, corners, lit))
    return solve(seen, (shape[1], shape[0]), projector_size, board, reference, software, mirrored)


def find_corners(image: npt.NDArray[np.uint8], board: Board, label: str) -> tuple[Floats, tuple[int, int]]:
    """Find the board's inner corners, to sub-pixel.

    Parameters
    ----------
    image : ndarray of uint8, shape (row, column)
    board : Board
    label : str
        Name of the pose, for the message.

    Returns
    -------
    corners : ndarray of float64, shape (corner, 2)
        (column, row), row by row of the board.
    inner_corners : (int, int)
        The board's size in the order in which it was found.

    Raises
    ------
    ValueError
        If there is no such board; the message names the size that the board seems to have.
    """
    across, along = board.inner_corners
    sizes = [(across, along), (along, across)] if across != along else [(across, along)]
    found = next(((corners, size) for size in sizes if (corners := _corners(image, size)) is not None), None)
    likely = _guess(image)
    if found is not None and (likely is None or math.prod(likely) <= math.prod(found[1])):
        return found
    if likely is not None and sorted(likely) != sorted(board.inner_corners):
        raise ValueError(
            f"{label}: no board of {board.size_text} inner corners, but the board looks like "
            f"{likely[0]}x{likely[1]}: give --board {likely[0]}x{likely[1]}, or show the whole board"
        )
    raise ValueError(
        f"{label}: no board of {board.size_text} inner corners found: is it whole in the image, lit and sharp?"
    )


def _corners(image: npt.NDArray[np.uint8], size: tuple[int, int]) -> Floats | None:
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    ok, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
    if not ok:
        ok, corners = cv2.findChessboardCorners(image, size)
    if not ok:
        return None
    half = max(2, round(0.35 * corner_spacing_px(np.asarray(corners, dtype=np.float64).reshape(-1, 2), size)))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    refined = cv2.cornerSubPix(image, np.asarray(corners, dtype=np.float32), (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _guess(image: npt.NDArray[np.uint8]) -> tuple[int, int] | None:
    """Give the size of the largest board in the image, longer side first."""
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    for least in ((4, 5), (3, 3)):  # the smaller one finds only a part of some large boards
        ok, _, meta = cv2.findChessboardCornersSBWithMeta(image, least, flags)
        if ok and meta is not None:
            rows, columns = meta.shape[:2]
            return max(columns, rows), min(columns, rows)
    return None
