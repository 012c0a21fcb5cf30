"""Corners of a board in an image: found on a reduced image, made sharp on the full one; ChArUco boards in part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .board import Board, CharucoBoard
from .pinhole import Floats
from .projector_corners import corner_spacing_px, lattice_of

__all__ = ["FoundBoard", "find_board", "find_corners"]

SIDES = (640, 1280)  # the search runs on an image of this many pixels first, and on the whole one last
LEAST_CORNERS = 8  # of a ChArUco board: fewer leave its tilt open

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class FoundBoard:
    """Corners in an image.

    `corners` (n, 2) px as (column, row); `lattice` (n, 2) which corner of the board each one is; `flipped` whether the
    board could only be read in a mirror (None: a chessboard, which looks the same in it).
    """

    corners: Floats
    lattice: npt.NDArray[np.int_]
    flipped: bool | None = None


def find_board(image: Image, board: Board | CharucoBoard, label: str) -> FoundBoard:
    """Find a board's inner corners, to sub-pixel; see `find_corners`.

    A ChArUco board may be seen in part, and in a mirror.
    """
    if isinstance(board, CharucoBoard):
        return _find_charuco(image, board, label)
    corners, inner = find_corners(image, board, label)
    return FoundBoard(corners, lattice_of(inner))


def find_corners(image: Image, board: Board, label: str) -> tuple[Floats, tuple[int, int]]:
    """Find a chessboard's inner corners, to sub-pixel.

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
    likely: tuple[int, int] | None = None
    for small, scale in _reduced(image):
        for size in dict.fromkeys([(across, along), (along, across)]):
            found, seen = _search(small, size)
            if found is not None and sorted(seen) == sorted(board.inner_corners):
                return _sharpened(image, (found + 0.5) * scale - 0.5, lattice_of(seen)), seen
            if found is not None and math.prod(seen) > math.prod(board.inner_corners):
                likely = seen
                break
    likely = likely or _guess(image)
    if likely is not None and sorted(likely) != sorted(board.inner_corners):
        size_text = f"{max(likely)}x{min(likely)}"
        raise ValueError(
            f"{label}: no board of {board.size_text} inner corners, but the board looks like "
            f"{size_text}: give --board {size_text}, or show the whole board"
        )
    raise ValueError(
        f"{label}: no board of {board.size_text} inner corners found: is it whole in the image, lit and sharp?"
    )


def _reduced(image: Image) -> list[tuple[Image, float]]:
    """Ever larger images to search, each with its scale; the last one is the image itself."""
    import cv2

    images = []
    for side in SIDES:
        scale = max(image.shape) / side
        if scale > 1.2:
            size = round(image.shape[1] / scale), round(image.shape[0] / scale)
            small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
            images.append((small, scale))
    return [*images, (image, 1.0)]


def _search(image: Image, size: tuple[int, int]) -> tuple[Floats | None, tuple[int, int]]:
    """Corners of the largest board of at least this size, and its own size."""
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    ok, corners, meta = cv2.findChessboardCornersSBWithMeta(image, size, flags)
    if ok and meta is not None:
        return np.asarray(corners, dtype=np.float64).reshape(-1, 2), (meta.shape[1], meta.shape[0])
    ok, corners = cv2.findChessboardCorners(image, size)
    return (np.asarray(corners, dtype=np.float64).reshape(-1, 2) if ok else None), size


def _sharpened(image: Image, corners: Floats, lattice: npt.NDArray[np.int_], reach: float = 0.35) -> Floats:
    """Corners to sub-pixel, from what lies within `reach` squares of each."""
    import cv2

    half = max(2, round(reach * corner_spacing_px(corners, lattice)))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    refined = cv2.cornerSubPix(image, corners.astype(np.float32).reshape(-1, 1, 2), (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _guess(image: Image) -> tuple[int, int] | None:
    """Give the size of the largest board in the image."""
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    for least in ((4, 5), (3, 3)):  # the smaller one finds only a part of some large boards
        for small, _ in _reduced(image):
            ok, _, meta = cv2.findChessboardCornersSBWithMeta(small, least, flags)
            if ok and meta is not None:
                return int(meta.shape[1]), int(meta.shape[0])
    return None


def _find_charuco(image: Image, board: CharucoBoard, label: str) -> FoundBoard:
    best: FoundBoard | None = None
    markers = 0
    for flipped in (False, True):
        seen = np.ascontiguousarray(image[:, ::-1]) if flipped else image
        for legacy in (False, True):  # OpenCV before 4.6 began a board of an even number of rows with a white square
            corners, numbers, count = _charuco(seen, board, legacy)
            markers = max(markers, count)
            if best is None or len(numbers) > len(best.lattice):
                if flipped:
                    corners = np.stack([image.shape[1] - 1 - corners[:, 0], corners[:, 1]], axis=1)
                best = FoundBoard(corners, lattice_of(board.inner_corners)[numbers], flipped)
        if best is not None and len(best.lattice) >= LEAST_CORNERS:
            break
    assert best is not None
    spans = np.ptp(best.lattice, axis=0) if len(best.lattice) else np.zeros(2)
    if len(best.lattice) < LEAST_CORNERS or min(spans) < 1:
        total = math.prod(board.inner_corners)
        why = (
            f"no marker of {board.dictionary} is seen: is it the board's dictionary, lit and sharp?"
            if markers == 0
            else f"{markers} markers are seen, but only {len(best.lattice)} of {total} corners (at least "
            f"{LEAST_CORNERS} in two rows are needed): are the number of squares, their order and the marker's size "
            "right, and is enough of the board in the image?"
        )
        raise ValueError(f"{label}: no ChArUco board of {board.size_text} squares: {why}")
    return best


def _charuco(image: Image, board: CharucoBoard, legacy: bool) -> tuple[Floats, npt.NDArray[np.intp], int]:
    """Corners, their numbers on the board, and how many markers were seen."""
    import cv2

    made = cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, _dictionary(board.dictionary))
    made.setLegacyPattern(legacy)
    corners, numbers, _, markers = cv2.aruco.CharucoDetector(made).detectBoard(image)
    count = 0 if markers is None else len(markers)
    if corners is None or numbers is None or len(numbers) < 4:
        return np.empty((0, 2)), np.empty(0, dtype=np.intp), count
    which = np.asarray(numbers, dtype=np.intp).ravel()
    order = np.argsort(which)
    flat = np.asarray(corners, dtype=np.float64).reshape(-1, 2)[order]
    lattice = lattice_of(board.inner_corners)[which[order]]
    if min(np.ptp(lattice, axis=0)) < 1:  # all on a line
        return np.empty((0, 2)), np.empty(0, dtype=np.intp), count
    reach = 0.4 * (1 - board.marker_mm / board.square_mm)  # up to the nearest marker, and not into it
    return _sharpened(image, flat, lattice, reach), which[order], count


def _dictionary(name: str) -> Any:
    """Find OpenCV's dictionary of markers by name.

    Raises
    ------
    ValueError
        If there is none; the message lists them.
    """
    import cv2

    full = name.upper() if name.upper().startswith("DICT_") else f"DICT_{name.upper()}"
    number = getattr(cv2.aruco, full, None)
    if not isinstance(number, int):
        known = sorted(each for each in dir(cv2.aruco) if each.startswith("DICT_"))
        raise ValueError(f"no marker dictionary {name!r}; there are {', '.join(known)}")
    return cv2.aruco.getPredefinedDictionary(number)
