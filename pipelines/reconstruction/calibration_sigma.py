"""How well the corners know each parameter, and what that does to heights over the field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .bundle import LENS, Solution, information, view_slopes
from .corner_evidence import Fit
from .pinhole import Floats, project, rotation
from .rig_model import Lens
from .sight import on_plane
from .site_frame import lens_of, site_frame

__all__ = ["parameter_sigma", "require_determined"]

LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
POINTS = (12, 9)  # of the field, where heights are asked for
BEYOND = 2.0  # where the projector does not reach nothing is measured: no more than this many times the worst elsewhere
DEPTH = 0.05  # heights above the reference plane that tell the scale, in field widths
HELD = 0.5  # a parameter that the corners leave this much of its assumed variance is held by the assumption
WEAK_PX, WEAK_SHARE = 3.0, 0.003  # a principal point or focal length that is less sure than this is named

ROUNDING = 1e-15  # of the scaled normal equations: smaller eigenvalues are nothing
LOOSEST = 2.0  # per cent: a scale of heights or lengths that is less sure is not determined

Sizes = tuple[tuple[int, int], tuple[int, int]]


def parameter_sigma(here: Fit, reference: int, sizes: Sizes, names: Sequence[str]) -> dict[str, Any]:
    """Give the standard uncertainty of each parameter, and of heights.

    The covariance is (J^T J)^-1 s^2 at the minimum, weak priors included, with s^2 the squared errors over their
    degrees of freedom.

    Parameters
    ----------
    here : Fit
    reference : int
        The pose whose board heights count from.
    sizes : ((int, int), (int, int))
        Columns and rows of camera and projector.
    names : sequence of str
        Of the poses.

    Returns
    -------
    dict
        ``camera``, ``projector``: by name (px; none for the distortion). ``turn_deg``, ``t_mm``: camera to projector.
        ``poses``: name, ``turn_deg``, ``t_mm`` of each board. ``weak``: what the corners leave open, in words.
        ``field``: ``height_scale_percent``, ``lateral_scale_percent`` and ``bow_um``, the root mean square of what is
        left of a plane's height error once offset and tilt are taken out, within the box of the image that corners
        covered; ``bow_image_um`` is the same over the whole image, extrapolated, and ``map_um`` (rows, columns) tells
        it at nodes from the first to the last pixel of both axes. Standard uncertainties.
    """
    normal, variance, held = information(here.corners, here.solution, sizes, here.noise_px)
    scale = 1 / np.sqrt(np.diag(normal))
    # Where the corners leave a direction wholly open its eigenvalue is rounding: that is as good as nothing.
    values, axes = np.linalg.eigh(normal * np.outer(scale, scale))
    open_ways = (axes / np.maximum(values, ROUNDING)) @ axes.T
    covariance = open_ways * np.outer(scale, scale) * variance
    sigma = np.sqrt(np.diag(covariance))
    rig, poses = sigma[: 2 * LENS + 6], sigma[2 * LENS + 6 :].reshape(-1, 6)
    by_name = [{name: float(v) for name, v in zip(LENS_NAMES, rig[k : k + LENS], strict=True)} for k in (0, LENS)]
    seen = here.corners.camera[here.corners.use]
    box = seen.min(axis=0), seen.max(axis=0)
    field = _field(here.solution, reference, sizes, covariance, box)
    image = _field(here.solution, reference, sizes, covariance, (np.zeros(2), np.array(sizes[0]) - 1.0))
    return {
        "camera": by_name[0],
        "projector": by_name[1],
        "turn_deg": np.degrees(rig[2 * LENS : 2 * LENS + 3]).tolist(),
        "t_mm": rig[2 * LENS + 3 :].tolist(),
        "poses": [
            {"name": name, "turn_deg": np.degrees(six[:3]).tolist(), "t_mm": six[3:].tolist()}
            for name, six in zip(names, poses, strict=True)
        ],
        "weak": _weak(here.solution, sigma, held * sigma**2 / variance),
        "field": {**field, "bow_image_um": image["bow_um"], "map_um": image["map_um"]},
    }


def require_determined(sigma: Mapping[str, Any], solution: Solution) -> None:
    """Refuse a calibration whose corners leave the scale open, however well it fits them.

    Raises
    ------
    ValueError
        One line: what is open, how the boards were tilted, and what to do.
    """
    field = sigma["field"]
    for what, key in (("heights", "height_scale_percent"), ("lengths", "lateral_scale_percent")):
        loose = field[key]
        if not loose < LOOSEST:
            amount = f"±{loose:.2g} %" if loose < 100 else "less than their own size"
            raise ValueError(
                f"these poses do not determine the rig: the scale of {what} is known to {amount} only "
                f"(the boards' tilts differ by {_tilt_range(solution):.0f} degrees at most): "
                "tilt the board by 10 to 25 degrees to all sides"
            )


def _tilt_range(solution: Solution) -> float:
    """Largest angle between two boards, degrees."""
    normals = np.array([rotation(turn)[:, 2] for turn in solution.pose_turns])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1))).max())


def _weak(solution: Solution, sigma: Floats, share: Floats) -> list[str]:
    words: list[str] = []
    devices = (("camera", solution.camera, 0), ("projector", solution.projector, LENS))
    for (who, lens, first), affine in zip(devices, solution.parallel, strict=True):
        here, held = sigma[first : first + LENS], share[first : first + LENS]
        focal = float(max(here[0] / abs(lens[0]), here[1] / abs(lens[1])))
        if focal > WEAK_SHARE:
            words.append(f"{who}: {'scale' if affine else 'focal length'} known to ±{100 * focal:.2g} %")
        if max(here[2:4]) > WEAK_PX and not affine:
            words.append(f"{who}: principal point known to ±{here[2]:.2g}, {here[3]:.2g} px")
        loose = [name for name, part in zip(LENS_NAMES, held, strict=True) if part > HELD]
        if loose:
            words.append(f"{who}: {', '.join(loose)} held by what lenses usually are, not by these corners")
    return words


def _field(
    solution: Solution, reference: int, sizes: Sizes, covariance: Floats, box: tuple[Floats, Floats]
) -> dict[str, Any]:
    """What the covariance does to a height map of the reference plane, and a little above and below it."""
    camera = lens_of(solution.camera, sizes[0], solution.parallel[0])
    projector = lens_of(solution.projector, sizes[1], solution.parallel[1])
    frame = _frame(solution, reference)
    columns, rows = (np.linspace(box[0][axis], box[1][axis], POINTS[axis]) for axis in (0, 1))
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    level = on_plane(camera, frame, nodes)
    R, t = rotation(solution.turn), solution.shift
    lit = project(projector, level @ R.T + t)
    both = ((lit >= 0) & (lit <= np.array(sizes[1]) - 1)).all(axis=1)
    both = both if both.sum() >= 12 else np.ones(len(nodes), dtype=bool)
    pixels = nodes[both]
    level = level @ frame[:, :3].T + frame[:, 3]
    height = DEPTH * float(np.ptp(level[both, 0]))
    slopes = [_site_slopes(solution, reference, camera, frame, pixels, z) for z in (height, -height)]
    everywhere = _site_slopes(solution, reference, camera, frame, nodes, 0.0)
    slopes = [everywhere[both], *slopes]
    middle = level[both, :2].mean(axis=0)
    x, y = (level[both, :2] - middle).T
    plane = np.stack([np.ones(len(nodes)), *(level[:, :2] - middle).T], axis=1)
    bow = everywhere[:, 2] - plane @ np.linalg.lstsq(plane[both], everywhere[both, 2], rcond=None)[0]
    rise = (slopes[1][:, 2] - slopes[2][:, 2]).mean(axis=0) / (2 * height)
    wide = (x[:, None] * slopes[0][:, 0] + y[:, None] * slopes[0][:, 1]).sum(axis=0) / (x * x + y * y).sum()

    def spread(linear: Floats) -> float:
        return math.sqrt(max(float(linear @ covariance @ linear), 0.0))

    variance = np.maximum(np.einsum("ni,ij,nj->n", bow, covariance, bow), 0.0)
    known = np.minimum(variance, BEYOND**2 * variance[both].max())
    return {
        "height_scale_percent": 100 * spread(rise),
        "lateral_scale_percent": 100 * spread(wide),
        "bow_um": 1000 * float(np.sqrt(variance[both].mean())),
        "map_um": [[float(f"{1000 * v:.3g}") for v in row] for row in np.sqrt(known).reshape(POINTS[1], POINTS[0])],
    }


def _site_slopes(
    solution: Solution, reference: int, camera: Lens, frame: Floats, pixels: Floats, height: float
) -> Floats:
    """Derivatives (n, 3, parameter) of points in the site frame by all parameters, what both devices see held."""
    points = on_plane(camera, frame, pixels, height)
    R = rotation(solution.turn)
    turned = np.einsum("ij,nj->ni", R, points)
    seen_lens, seen = view_slopes(solution.camera, points, solution.parallel[0])
    lit_lens, lit = view_slopes(solution.projector, turned + solution.shift, solution.parallel[1])
    total = len(solution.packed())
    by = np.zeros((len(points), 4, total))
    by[:, :2, :LENS], by[:, 2:, LENS : 2 * LENS] = seen_lens, lit_lens
    nudge = 1e-6
    for k in range(3):
        turn = solution.turn.copy()
        turn[k] += nudge
        moved = np.einsum("ij,nj->ni", rotation(turn), points)
        by[:, 2:, 2 * LENS + k] = np.einsum("nij,nj->ni", lit, (moved - turned) / nudge)
    by[:, 2:, 2 * LENS + 3 : 2 * LENS + 6] = lit
    A = np.concatenate([seen, np.einsum("nij,jk->nik", lit, R)], axis=1)
    weight = np.array([1e4, 1e4, 1.0, 1.0])[:, None]  # the point stays on the camera's ray
    moves = -np.stack([np.linalg.lstsq(a * weight, b * weight, rcond=None)[0] for a, b in zip(A, by, strict=True)])
    slopes: Floats = np.einsum("ij,njk->nik", frame[:, :3], moves)
    first = 2 * LENS + 6 + 6 * reference
    packed = solution.packed()
    for k in range(first, first + 6):  # heights count from this board: it moves, and with it the frame
        step = 1e-6 * max(1.0, abs(float(packed[k])))
        ahead, behind = packed.copy(), packed.copy()
        ahead[k] += step
        behind[k] -= step
        change = (
            _frame(Solution.unpacked(ahead, solution.parallel), reference)
            - _frame(Solution.unpacked(behind, solution.parallel), reference)
        ) / (2 * step)
        slopes[:, :, k] += points @ change[:, :3].T + change[:, 3]
    return slopes


def _frame(solution: Solution, reference: int) -> Floats:
    normal, point = rotation(solution.pose_turns[reference])[:, 2], solution.pose_shifts[reference]
    return site_frame(normal, point, bool(solution.camera[0] < 0))
