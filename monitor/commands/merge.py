"""``microrelief merge``: views of one object from several sides to one height map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError
from pipelines import Calibration, Motion
from pipelines import reconstruction as rec
from storage import read_patterns, read_stage

from ..outputs import check_out
from ..progress import progress
from ..surfaces import Surface, read_surfaces
from ..views import Aligned, align, pose_matrix
from .mosaic import write_merged
from .reconstruct import read_calibration

__all__ = ["merge"]

Floats = npt.NDArray[np.float64]

MISFIT = 8.0
"""Views that differ by so many times what their sigmas predict do not show one surface, or lie elsewhere."""


def merge(
    *views: Path,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    calibration: Annotated[tuple[Path, ...], Parameter(negative="")] = (),
    stage: Path | None = None,
    same_board: Annotated[bool, Parameter(negative="")] = False,
    patterns: Path | None = None,
    pitch_mm: float | None = None,
) -> None:
    """Merge views of one object from several sides: what one does not see, another may.

    Where each view lies is told by --stage (an object turned or shifted before one rig), by --same-board (rigs whose
    calibrations count heights from one board that did not move), or all lie in one frame already; then they are
    registered to the first view by what both see. Where views see different surfaces the majority counts, and nothing
    is averaged; cells without a majority are marked in `level`.

    A stage file is CSV with the header tile,x_mm,y_mm,z_mm,turn_deg, or YAML such as `tiles: {front: [0, 0, 0, 0],
    back: [0, 0, 0, 180]}`: how far the object had been turned about the vertical through the site frame's origin,
    counter-clockwise seen from above, and then shifted.

    Parameters
    ----------
    views
        Capture folders, files of `microrelief reconstruct`, or height maps (.npz, .nc, .tif); the first one's frame is
        the result's.
    out
        Where the height map goes: .npz, .nc, .tif or .ply.
    calibration
        The calibration.json of the rig; given once for all views, or once for each in their order.
    stage
        The stage file.
    same_board
        The calibrations' reference poses show one board that did not move between them.
    patterns
        Pattern file, where the captures do not say what was projected.
    pitch_mm
        Side of a cell, for captures and points; by default about one camera pixel.

    Example
    -------
    microrelief merge front back --stage turns.csv --calibration calibration.json --out both.tif
    """
    check_out(out, pitch_mm)
    if len(views) < 2:
        raise InputError("merging needs two views or more")
    if len(calibration) not in (0, 1, len(views)):
        raise InputError(f"--calibration: give one, or one for each of the {len(views)} views, not {len(calibration)}")
    given = [read_calibration(file) for file in calibration]
    one = given[0] if given else None
    rigs: list[Calibration | None] = [*given] if len(given) == len(views) else [one] * len(views)
    guesses = _guesses(views, rigs, stage, same_board)
    pattern_set = read_patterns(patterns) if patterns is not None else None
    surfaces = read_surfaces(views, rigs, pattern_set, pitch_mm)
    aligned = [Aligned(np.eye(4), Motion.none())]
    with progress("registering views") as step:
        for number in range(1, len(views)):
            found = align(surfaces[number].scan, surfaces[0].scan, guesses[number])
            if found.motion.verdict == "failed":
                raise InputError(
                    f"{surfaces[number].name}: does not fit {surfaces[0].name}: {found.motion.reason}; "
                    "say how it was turned with --stage"
                )
            aligned.append(found)
            step(number, len(views) - 1)
    for line in _about_poses(surfaces, aligned):
        print(line)
    scans, matrices = [surface.scan for surface in surfaces], [each.matrix for each in aligned]
    first = scans[0].grid
    pitch = max(scan.grid.pitch_mm for scan in scans)
    whole = rec.covering_grid(scans, matrices, pitch, (first.x0_mm, first.y0_mm))
    placed = [rec.regrid(scan, matrix, whole) for scan, matrix in zip(scans, matrices, strict=True)]
    for number in range(1, len(placed)):
        seam = rec.seam_between(placed[0], placed[number])
        if seam.over_sigma > MISFIT:
            raise InputError(
                f"{surfaces[number].name}: does not fit {surfaces[0].name}: they differ by {seam.over_sigma:.0f} times "
                "what their sigmas predict; say how it was turned with --stage"
            )
        print(
            f"  {surfaces[number].name} less {surfaces[0].name}: {seam.cells} common cells, bias "
            f"{1000 * seam.bias_mm:+.2f} um, robust sd {1000 * seam.sd_mm:.2f} um, "
            f"{seam.over_sigma:.2f} times what sigma predicts"
        )
    merged = rec.merge(
        [
            rec.View(scan, each.motion.sigma_z_mm, _finite(each.motion.sigma_xy_mm), surface.bow_mm)
            for scan, each, surface in zip(placed, aligned, surfaces, strict=True)
        ],
        whole,
    )
    write_merged(merged, out)


def _guesses(
    views: tuple[Path, ...], rigs: list[Calibration | None], stage: Path | None, same_board: bool
) -> list[list[Floats]]:
    """Where each view may lie in the first one's frame."""
    if stage is not None and same_board:
        raise InputError("--stage and --same-board: a view's place is told by one of them")
    if stage is not None:
        told = read_stage(stage)
        poses = []
        for view in views:
            position = told.position(view)
            if position is None:
                raise InputError(
                    f"{stage}: has no position of view {view.name or view}; it names {', '.join(told.tiles)}"
                )
            poses.append(pose_matrix(position.x_mm, position.y_mm, position.z_mm, position.turn_deg))
        home = np.linalg.inv(poses[0])
        return [[home @ pose] for pose in poses]
    if same_board:
        if rigs[0] is None:
            raise InputError(
                "--same-board needs the calibrations of the views' rigs: --calibration, once for each view"
            )
        guesses: list[list[Floats]] = []
        for view, rig in zip(views, rigs, strict=True):
            assert rig is not None
            try:
                guesses.append(rec.site_to_site(rig, rigs[0]))
            except ValueError as error:
                raise InputError(f"{view}: --same-board: {error}") from None
        return guesses
    return [[np.eye(4)] for _ in views]


def _about_poses(surfaces: list[Surface], aligned: list[Aligned]) -> list[str]:
    lines = []
    for surface, each in zip(surfaces[1:], aligned[1:], strict=True):
        x, y, z = each.matrix[:3, 3]
        turn = np.rad2deg(np.arctan2(each.matrix[1, 0], each.matrix[0, 0]))
        doubt = f"; doubtful: {each.motion.reason}" if each.motion.verdict == "doubtful" else ""
        lines.append(
            f"{surface.name}: turned {turn:+.3f} deg, shifted {x:+.4f}, {y:+.4f}, {z:+.4f} mm onto {surfaces[0].name} "
            f"(+-{1000 * each.motion.sigma_xy_mm:.2g} um sideways, +-{1000 * each.motion.sigma_z_mm:.2g} um up){doubt}"
        )
    return lines


def _finite(value: float) -> float:
    return value if np.isfinite(value) else 0.0
