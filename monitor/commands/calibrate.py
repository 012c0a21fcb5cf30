"""``microrelief calibrate``: a rig's calibration from captures of a chessboard."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from configs import InputError
from pipelines.reconstruction import (
    Board,
    CharucoBoard,
    Decoded,
    calibrate_decoded,
    describe_calibration,
    locate,
)
from storage import read_capture, read_patterns, whole_file

from .. import __version__
from ..progress import progress

__all__ = ["calibrate"]


def calibrate(
    *poses: Path,
    square_mm: float,
    board: str = "",
    board_squares: str = "",
    charuco: str = "",
    marker_mm: float | None = None,
    patterns: Path | None = None,
    reference: Path | None = None,
    mirrored: Literal["auto", "none", "camera", "projector", "both"] = "auto",
    projector_side: Literal["auto", "left", "right", "above", "below"] = "auto",
    corners: Literal["plane", "local"] = "plane",
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("calibration.json"),
    report: Path | None = None,
) -> None:
    """Calibrate a rig from captures of a chessboard or ChArUco board in at least 3 poses.

    Each pose is a capture folder: the full set of patterns on the board at another tilt. Image inversion, mirrored
    optics and the end that the board is counted from are found, not asked for.

    Parameters
    ----------
    poses
        Capture folders of the board, at least 3.
    square_mm
        Side of a square.
    board
        Inner corners of the board, such as 15x8, in either order.
    board_squares
        Squares of the board instead, such as 6x7: a board of 6x7 squares has 5x6 inner corners.
    charuco
        The board is a ChArUco board with markers of this dictionary, such as DICT_5X5_100; it may be seen in part.
        Give its squares as --board-squares, columns first, as it was made.
    marker_mm
        Side of a marker of a ChArUco board.
    patterns
        Pattern file, where the captures do not say what was projected.
    reference
        The pose whose board is the plane that heights are measured from; by default the first one.
    mirrored
        Which device's optics mirror, if you know. `auto` finds out whether one of the two does and takes the camera.
    projector_side
        Where the projector stands beside the camera, as the camera's image shows it. Only two telecentric lenses need
        it: their corners cannot tell heights from depths.
    corners
        How decoded pixels are carried to the corners: `plane` uses the whole board, `local` the pixels at each one.
    out
        Where the calibration goes.
    report
        Also write residuals, coverage and uncertainty as one HTML page with pictures.

    Example
    -------
    microrelief calibrate poses/* --board 15x8 --square-mm 0.85 --patterns patterns.yaml --out calibration.json
    """
    chessboard = _board(board, board_squares, square_mm, charuco, marker_mm)
    folders = list(poses)
    if reference is not None and not any(_same(reference, folder) for folder in folders):
        folders.append(reference)
    for index, folder in enumerate(folders):
        if any(_same(folder, earlier) for earlier in folders[:index]):
            raise InputError(f"{folder}: given twice; each pose is the board at another tilt")
    if len(folders) < 3:
        raise InputError(f"{len(folders)} poses given, at least 3 are needed: capture the board at more tilts")
    if out.suffix.lower() != ".json":
        raise InputError(f"--out {out}: a calibration is a .json file")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise InputError(f"--out {out}: is a folder, name a file")
    if report is not None:
        if report.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--report {report}: a report is an .html file")
        if not report.parent.is_dir():
            raise InputError(f"--report {report}: there is no folder {report.parent}")
        if report.is_dir():
            raise InputError(f"--report {report}: is a folder, name a file")
    names = [folder.name if len({each.name for each in folders}) == len(folders) else str(folder) for folder in folders]
    index = next((n for n, folder in enumerate(folders) if reference is not None and _same(reference, folder)), 0)
    decoded, projector_size = _decode(folders, patterns)
    try:
        calibration = calibrate_decoded(
            decoded,
            projector_size,
            chessboard,
            names=names,
            reference=index,
            software=f"microrelief {__version__}",
            method=corners,
            mirrored=mirrored,
            projector_side=projector_side,
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    with whole_file(out) as file:
        file.write_text(calibration.to_json(), encoding="utf-8")
    for line in describe_calibration(calibration):
        print(line)
    print(f"wrote {out} (id {calibration.id}); heights count from the board of {names[index]}")
    if report is not None:
        from dashboards import calibration_page

        with whole_file(report) as file:
            file.write_text(calibration_page(calibration), encoding="utf-8")
        print(f"wrote {report}")


def _decode(folders: list[Path], patterns: Path | None) -> tuple[list[Decoded], tuple[int, int]]:
    pattern_set = read_patterns(patterns) if patterns is not None else None
    decoded: list[Decoded] = []
    size: tuple[int, int] | None = None
    with progress("decoding poses") as step:
        for number, folder in enumerate(folders, start=1):
            frames = read_capture(folder, pattern_set)
            if 0 in frames.patterns.bits:
                raise InputError(f"{folder}: calibration needs patterns along both axes, these code only one")
            if size is not None and frames.patterns.size != size:
                raise InputError(f"{folder}: its patterns are for another projector than those of {folders[0]}")
            size = frames.patterns.size
            decoded.append(locate(frames))
            step(number, len(folders))
    assert size is not None
    return decoded, size


def _board(corners: str, squares: str, square_mm: float, charuco: str, marker_mm: float | None) -> Board | CharucoBoard:
    if charuco and (corners or not squares or marker_mm is None):
        raise InputError(
            "a ChArUco board needs --charuco DICT --board-squares 7x5 --square-mm and --marker-mm, no --board"
        )
    if marker_mm is not None and not charuco:
        raise InputError("--marker-mm is for ChArUco boards: name the markers with --charuco, such as DICT_5X5_100")
    if bool(corners) == bool(squares):
        raise InputError("give the board's size either as --board 15x8 (inner corners) or as --board-squares 16x9")
    if not (math.isfinite(square_mm) and square_mm > 0):
        raise InputError(f"--square-mm {square_mm:g}: the side of a square must be a positive number of mm")
    option, text = ("--board", corners) if corners else ("--board-squares", squares)
    match = re.fullmatch(r"\s*(\d+)\s*[xX×,*]\s*(\d+)\s*", text)
    if not match:
        raise InputError(f"{option} {text}: write two numbers such as 15x8")
    size = int(match[1]), int(match[2])
    try:
        if charuco and marker_mm is not None:
            return CharucoBoard(size, square_mm, marker_mm, charuco)
        return Board(size, square_mm) if corners else Board.of_squares(size, square_mm)
    except ValueError as error:
        raise InputError(f"{option} {text}: {error}") from None


def _same(one: Path, two: Path) -> bool:
    return one.resolve() == two.resolve()
