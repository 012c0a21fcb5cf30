"""Which lenses the corners ask for: pinholes, or affine ones where a pinhole predicts no better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .affine_start import OneLens, as_pinhole, join_parallel, odd_mirror, parallel_lens, reversed_scene
from .bundle import Corners, Solution, adjust, lens_residuals, robust_cost
from .bundle_prior import CAMERA_SHIFT, PROJECTOR_SHIFT
from .pinhole import Floats, rotation
from .stereo_start import join_pinholes, mirror, pinhole_lens

__all__ = ["SIDES", "first_fit"]

PLAUSIBLE = 1.5  # an affine lens that misses the corners by this many times the pinhole's rms is out of the question,
LONG = 0.002  # unless by less than this share of the image: then the pinhole is far away, and affine fits lead to it
CLOSE_PX = 0.25  # rms of an affine lens that needs no pinhole of another origin beside it
DISTANCES = (6.0, 25.0, 150.0)  # widths of the field: where a pinhole is looked for that is nearly affine
SURE = 25.0  # squared standard deviations: by so much one side of the projector must fit better to be believed
SIDES = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "above": (0.0, -1.0), "below": (0.0, 1.0)}
"""Where the projector may stand, seen in the camera's image: (column, row)."""

Sizes = tuple[tuple[int, int], tuple[int, int]]


def first_fit(
    corners: Corners, sizes: Sizes, mirrors: Sequence[str], side: str = "auto"
) -> tuple[Solution, tuple[str, ...]]:
    """Fit all corners, none left out, from nothing but the corners, and choose the lenses' models.

    A pinhole far away is an affine lens: it has one parameter more, its distance. It is taken if the corners ask for
    it by Schwarz's criterion (BIC): the robust squared errors, in units of their own variance, must fall by more than
    ln(number of coordinates). See docs/decisions for why.

    Parameters
    ----------
    corners : Corners
    sizes : ((int, int), (int, int))
        Columns and rows of camera and projector.
    mirrors : sequence of str
        Which devices may be mirrored: ``none``, ``camera``, ``projector``, ``both``; the first one needs no proof.
    side : str
        Where the projector stands (`SIDES`), or ``auto``. It decides only where the corners do not.

    Returns
    -------
    solution : Solution
    notes : tuple of str
        What the corners could not tell and had to be assumed.

    Raises
    ------
    ValueError
        If no lens explains the corners, or they contradict `side`.
    """
    far = (
        parallel_lens(corners, corners.camera, sizes[0], CAMERA_SHIFT, square=True),
        parallel_lens(corners, corners.projector, sizes[1], PROJECTOR_SHIFT, square=False),
    )
    near: list[tuple[OneLens, float] | None] = [None, None]
    failed = None
    for place, (image, shifts, loose) in enumerate(
        ((corners.camera, (0.5,), CAMERA_SHIFT), (corners.projector, (0.5, 0.0, 1.0), PROJECTOR_SHIFT))
    ):
        try:
            if far[place][1] > CLOSE_PX:
                near[place] = pinhole_lens(corners, image, sizes[place], shifts, loose)
        except ValueError as error:
            failed = error
    may = tuple(
        one is None or other[1] < max(PLAUSIBLE * one[1], LONG * size[0])
        for one, other, size in zip(near, far, sizes, strict=True)
    )
    candidates: list[Solution] = []
    if near[0] is not None and near[1] is not None:
        candidates.append(join_pinholes(corners, near[0][0], near[1][0], sizes, mirrors))
    if any(may):
        lenses = [
            one[0] if held or other is None else other[0] for one, other, held in zip(far, near, may, strict=True)
        ]
        candidates += _with_parallel(corners, sizes, mirrors, lenses, (may[0], may[1]))
    if not candidates:
        raise failed or ValueError("the optics mirror otherwise than --mirrored says: leave it out")
    if len(candidates) == 1:
        return candidates[0], ()
    return _chosen(candidates, corners, side)


def _with_parallel(
    corners: Corners, sizes: Sizes, mirrors: Sequence[str], lenses: Sequence[OneLens], parallel: tuple[bool, bool]
) -> list[Solution]:
    """Fits with affine lenses, and with pinholes far away in their places, for both sides of the projector."""
    odd = odd_mirror(corners)
    name = next((each for each in mirrors if (each in ("camera", "projector")) == odd), None)
    if name is None:
        return []
    joined = join_parallel(*mirror(lenses[0], lenses[1], name), parallel)
    found = []
    for scene in (joined, reversed_scene(joined)):
        flat = adjust(corners, scene, sizes, (0.2, 0.3), rounds=25)
        found.append(flat)
        for which in ((True, True), (True, False), (False, True)):
            if which == (which[0] and parallel[0], which[1] and parallel[1]):
                far = [adjust(corners, as_pinhole(flat, which, d), sizes, (0.2, 0.3), rounds=25) for d in DISTANCES]
                found.append(min(far, key=lambda each: robust_cost(each, corners, corners.use, (0.2, 0.3))))
    return found


def _chosen(candidates: Sequence[Solution], corners: Corners, side: str) -> tuple[Solution, tuple[str, ...]]:
    noise = min((_noise(each, corners) for each in candidates), key=lambda pair: pair[0] ** 2 + pair[1] ** 2)
    costs = np.array([robust_cost(each, corners, corners.use, noise) for each in candidates])
    count = 4 * int(corners.use.sum())
    freedom = max(count - len(candidates[0].packed()), 1)
    costs /= costs.min() / freedom
    pinholes = np.array([2 - sum(each.parallel) for each in candidates])
    scores = costs + pinholes * np.log(count)
    stands = np.array([_stands(each) for each in candidates])
    best = int(np.argmin(scores))
    wanted = SIDES.get(side) or _usual(stands[best])
    there = stands @ np.array(wanted) > 0
    agrees = stands @ stands[best] > 0
    margin = float((scores[~agrees] - scores[best]).min()) if (~agrees).any() else np.inf
    if margin >= SURE:
        if side != "auto" and not there[best]:
            raise ValueError(
                f"--projector-side {side}: the corners say that it stands {_name(stands[best])} of the camera: "
                "look at the rig from behind the camera, as the image shows it, or leave the option out"
            )
        return candidates[best], ()
    if not there.any():
        raise ValueError(f"--projector-side {side}: the corners say {_name(stands[best])} or opposite of it")
    chosen = candidates[int(np.argmin(np.where(there, scores, np.inf)))]
    if side != "auto":
        return chosen, ()
    name = _name(_stands(chosen))
    return chosen, (
        "both lenses see along parallel rays, so corners cannot tell heights from depths: the projector is taken to "
        f"stand {name} of the camera, as the image shows it (if it does not, give --projector-side {OTHER[name]})",
    )


OTHER = {"right": "left", "left": "right", "above": "below", "below": "above"}


def _noise(solution: Solution, corners: Corners) -> tuple[float, float]:
    """Standard deviation of a coordinate in camera and projector, by the median."""
    seen, lit = (np.linalg.norm(error[corners.use], axis=1) for error in lens_residuals(solution, corners))
    a, b = (max(float(np.median(error)) / 1.177, 0.01) for error in (seen, lit))
    return max(a, 0.25 * b), max(b, 0.25 * a)


def _stands(solution: Solution) -> Floats:
    """Where the projector stands, seen in the camera's image: (column, row), against the way its light goes."""
    away = -rotation(solution.turn)[2, :2]
    return np.array([np.sign(solution.camera[0]) * away[0], away[1]])


def _usual(stands: Floats) -> tuple[float, float]:
    """The side that is assumed: right or above, whichever is along the line that the corners tell."""
    return SIDES["right"] if abs(stands[0]) >= abs(stands[1]) else SIDES["above"]


def _name(stands: Floats) -> str:
    return max(SIDES, key=lambda name: float(np.dot(SIDES[name], stands)))
