"""From corners to a calibration: the fit, its residuals, how sure it is, and the site frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .affine_start import parallel_tilts
from .board import Board, CharucoBoard
from .board_check import check_board, corner_points, held_out
from .bundle import Solution, lens_residuals, rms_px
from .calibration_sigma import parameter_sigma, require_determined
from .corner_evidence import Fit, fit
from .pinhole import Floats, finite, fit_homography, plane_pose, project, rotation, undistort
from .rig_model import Calibration, CornerResidual, PoseResidual
from .site_frame import lens_of, site_frame
from .stereo_start import PoseCorners

__all__ = ["solve"]


def solve(
    poses: Sequence[PoseCorners],
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
    board: Board | CharucoBoard,
    reference: int,
    software: str,
    mirrored: str = "auto",
    flipped: bool | None = None,
    side: str = "auto",
) -> Calibration:
    """Calibrate from corners; parameters as in `calibrate_decoded`.

    `flipped` says whether a board that reads in one way only had to be read in a mirror; None where it does not tell.
    """
    sizes = (camera_size, projector_size)
    if mirrored != "auto":
        mirrors: Sequence[str] = (mirrored,)
    elif flipped is None:
        mirrors = ("none", "camera")
    else:
        mirrors = ("camera", "both") if flipped else ("none", "projector")
    here = fit(poses, sizes, mirrors, side, reference)
    if reference in here.bad:
        raise ValueError(f"{poses[reference].name}: {here.bad[reference]} (heights are to count from its board)")
    rig = _rig(here, here.solution, here.poses.index(reference), sizes)
    sigma = parameter_sigma(here, here.poses.index(reference), sizes, [poses[n].name for n in here.poses])
    require_determined(sigma, here.solution)
    total = rms_px(here.solution, here.corners, here.corners.use)
    kept = [poses[n] for n in here.poses]
    use = [here.corners.use[here.corners.pose == place] for place in range(len(kept))]
    return replace(
        rig,
        rms_px={"camera": total[0], "projector": total[1], "stereo": total[2]},
        poses=tuple(
            _bad(pose, here.bad[n], rig) if n in here.bad else _residual(here, n, pose) for n, pose in enumerate(poses)
        ),
        board=board.as_mapping(),
        software=software,
        sigma=sigma,
        squares=tuple(check_board(rig, pose, board.square_mm, mine) for pose, mine in zip(kept, use, strict=True)),
        notes=here.notes,
        held_out=held_out(here, kept, board.square_mm, lambda solution: _rig(here, solution, 0, sizes), sizes),
    )


def _rig(here: Fit, solution: Solution, place: int, sizes: tuple[tuple[int, int], tuple[int, int]]) -> Calibration:
    """The rig alone, without figures of merit; heights count from the board at `place`."""
    normal, point = rotation(solution.pose_turns[place])[:, 2], solution.pose_shifts[place]
    R, shift = rotation(solution.turn), solution.shift
    if solution.parallel[0]:  # no place of its own: its frame begins where its axis meets the reference plane
        away = float(point @ normal) / float(normal[2])
        point, shift = point - np.array([0.0, 0.0, away]), shift + R[:, 2] * away
    if solution.parallel[1]:
        shift = shift * np.array([1.0, 1.0, 0.0])  # and its distance is nothing
    return Calibration(
        camera=lens_of(solution.camera, sizes[0], solution.parallel[0]),
        projector=lens_of(solution.projector, sizes[1], solution.parallel[1]),
        R=R,
        t_mm=shift,
        reference=site_frame(normal, point, bool(solution.camera[0] < 0)),
        rms_px={},
    )


def _residual(here: Fit, n: int, pose: PoseCorners) -> PoseResidual:
    corners = here.corners
    mine = corners.pose == here.poses.index(n)
    used = corners.use & mine
    seen, lit = (error[mine] for error in lens_residuals(here.solution, corners))
    rms = rms_px(here.solution, corners, used)
    lost = corners.camera[mine & ~corners.use].round(1)
    return PoseResidual(
        pose.name,
        rms[0],
        rms[1],
        int(used.sum()),
        int(mine.sum()),
        tuple((float(column), float(row)) for column, row in lost),
        corners=_corner_residuals(pose, seen, lit, corners.use[mine]),
    )


def _bad(pose: PoseCorners, why: str, rig: Calibration) -> PoseResidual:
    """What a pose that was left out looks like to the calibration from the others."""
    ok = finite(pose.projector)
    seen, lit = min(
        (_missed(rig, pose, *at) for at in _seen_at(rig, pose)), key=lambda off: float(abs(off[1][ok]).sum())
    )
    off = [float(np.sqrt((e**2).sum(axis=1).mean())) if len(e) else 0.0 for e in (seen, lit[ok])]
    corners = _corner_residuals(pose, seen, lit, np.zeros(len(seen), dtype=bool))
    return PoseResidual(pose.name, off[0], off[1], 0, len(pose.board), advice=why, corners=corners)


def _missed(rig: Calibration, pose: PoseCorners, R: Floats, t: Floats) -> tuple[Floats, Floats]:
    points = np.concatenate([pose.board, np.zeros((len(pose.board), 1))], axis=1) @ R.T + t
    seen = project(rig.camera, points) - pose.camera
    return seen, project(rig.projector, points @ rig.R.T + rig.t_mm) - pose.projector


def _seen_at(rig: Calibration, pose: PoseCorners) -> list[tuple[Floats, Floats]]:
    """Where the camera alone sees the board; an affine one sees two tilts, and the projector tells how far."""
    H = fit_homography(pose.board, undistort(rig.camera, pose.camera))
    if not rig.camera.parallel:
        return [plane_pose(np.eye(3), H)]
    points = corner_points(rig, pose.camera, pose.projector)[finite(pose.projector)]
    away = float(np.median(points[:, 2])) if len(points) else 0.0
    middle = np.append(H[:2, 2], away)
    return [(R, middle) for R in parallel_tilts(H[:2, :2])]


def _corner_residuals(pose: PoseCorners, seen: Floats, lit: Floats, use: np.ndarray) -> tuple[CornerResidual, ...]:
    """Rounded to what a picture needs; errors come as fitted less seen."""
    rows = []
    for at, off, there, missed, used in zip(pose.camera, -seen, pose.projector, -lit, use, strict=True):
        known = bool(np.isfinite(there).all())
        there_px = [round(float(v), 2) if known else None for v in there]
        missed_px = [round(float(v), 4) if known else None for v in missed]
        (u, v), (du, dv) = (float(x) for x in at), (float(x) for x in off)
        here = round(u, 2), round(v, 2), round(du, 4), round(dv, 4)
        rows.append(CornerResidual(*here, there_px[0], there_px[1], missed_px[0], missed_px[1], bool(used)))
    return tuple(rows)
