"""``microrelief calibrate``: a rig's calibration from captures of a chessboard."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from configs import InputError
from pipelines import Calibration
from pipelines.reconstruction import Board, Decoded, calibrate_decoded, locate
from storage import read_capture, read_patterns, whole_file

from .. import __version__
from ..progress import progress

__all__ = ["calibrate"]


def calibrate(
    *poses: Path,
    square_mm: float,
    board: str = "",
    board_squares: str = "",
    patterns: Path | None = None,
    reference: Path | None = None,
    mirrored: Literal["auto", "none", "camera", "projector"] = "auto",
    corners: Literal["plane", "local"] = "plane",
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("calibration.json"),
) -> None:
    """Calibrate a rig from captures of a chessboard in at least 3 poses.

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
    patterns
        Pattern file, where the captures do not say what was projected.
    reference
        The pose whose board is the plane that heights are measured from; by default the first one.
    mirrored
        Which device's optics mirror, if you know. `auto` finds out whether one of the two does and takes the camera.
    corners
        How decoded pixels are carried to the corners: `plane` uses the whole board, `local` the pixels at each one.
    out
        Where the calibration goes.

    Example
    -------
    microrelief calibrate poses/* --board 15x8 --square-mm 0.85 --patterns patterns.yaml --out calibration.json
    """
    chessboard = _board(board, board_squares, square_mm)
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
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    with whole_file(out) as file:
        file.write_text(calibration.to_json(), encoding="utf-8")
    for line in describe(calibration):
        print(line)
    print(f"wrote {out} (id {calibration.id}); heights count from the board of {names[index]}")


def describe(calibration: Calibration) -> list[str]:
    """Residuals per pose, rejected corners, mirrors and the verdict, as lines."""
    width = max(len("pose"), *(len(pose.name) for pose in calibration.poses))
    lines = [f"{'pose':{width}}  camera px  projector px  corners"]
    lines += [
        f"{pose.name:{width}}  {pose.camera_px:9.3f}  {pose.projector_px:12.3f}  {pose.kept} of {pose.found}"
        for pose in calibration.poses
    ]
    for pose in calibration.poses:
        if pose.rejected:
            places = ", ".join(f"({column:.0f}, {row:.0f})" for column, row in pose.rejected)
            lines.append(f"{pose.name}: corners left out at image column, row: {places}")
    if calibration.camera.mirrored or calibration.projector.mirrored:
        which = "camera" if calibration.camera.mirrored else "projector"
        lines.append(
            f"the optics mirror: of camera and projector exactly one is mirrored, taken to be the {which} "
            "(if it is the other one, say so with --mirrored)"
        )
    rms = calibration.rms_px
    lines.append(f"camera rms {rms['camera']:.3f} px, projector rms {rms['projector']:.3f} px")
    lines.append(f"stereo rms {rms['stereo']:.3f} px: {verdict(rms['stereo'])}")
    return lines


def verdict(stereo_px: float) -> str:
    """Say what a stereo rms means."""
    if stereo_px < 0.5:
        return "good (under 0.5 px)"
    if stereo_px < 1.0:
        return "usable, not good (0.5 to 1 px): take more poses, sharper and at other tilts"
    return "bad (over 1 px): check the board's size, the pattern file, and that nothing moved during a capture"


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


def _board(corners: str, squares: str, square_mm: float) -> Board:
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
        return Board(size, square_mm) if corners else Board.of_squares(size, square_mm)
    except ValueError as error:
        raise InputError(f"{option} {text}: {error}") from None


def _same(one: Path, two: Path) -> bool:
    return one.resolve() == two.resolve()
