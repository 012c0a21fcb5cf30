"""Which corners and poses count: left out by evidence, never to a quota, and a damaged pose is named as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .bundle import Corners, Solution, adjust, lens_residuals, rms_px
from .lens_choice import first_fit
from .pinhole import Floats, finite
from .pose_spread import copies
from .stereo_start import PoseCorners, flat

__all__ = ["MIN_POSES", "Fit", "fit", "without"]

MIN_POSES = 3
OUTLIER = 6.0
"""Standard deviations: normal errors in two dimensions reach this once in 65 million corners; what lies between 2 and 6
only weighs less (Huber)."""
TAIL = 0.8  # errors of real corners have longer tails than normal ones: the scale of outliers is read here
TAIL_SIGMA = 1.794  # what 80 % of normal errors in two dimensions stay below, in standard deviations
BAD_SHARE = 0.3  # of a pose's corners: more outliers than this are no outliers, the pose itself is suspect
FEW = 0.05  # of all corners: fewer outliers than this are nobody's fault
DOUBT_PX = 0.5  # corners that scatter by more than this in projector or camera, and one pose may have spoilt them all
BAD_GAIN = 3.0  # a pose is bad if all corners of the others fit this many times better without it
AGREEING = 0.6  # of a board's decoded pixels: fewer that follow one plane, and the decoding is damaged

Sizes = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The bundle of the poses that count.

    `poses` gives their numbers, in the order of `corners.pose`; `noise_px` the standard deviation of a corner's
    coordinate in camera and projector; `bad` says of each pose that was left out why; `notes` what had to be assumed.
    """

    poses: tuple[int, ...]
    corners: Corners
    solution: Solution
    noise_px: tuple[float, float]
    bad: dict[int, str]
    notes: tuple[str, ...] = ()


def fit(
    poses: Sequence[PoseCorners], sizes: Sizes, mirrors: Sequence[str], side: str = "auto", reference: int = 0
) -> Fit:
    """Fit the poses, without outlying corners, copies of a pose, and a pose that fits none of the others.

    `reference` is a pose that is not to be left out for a copy of it.

    Raises
    ------
    ValueError
        If fewer than 3 poses count; the message names the bad ones.
    """
    bad = {
        n: f"{1 - pose.agreeing:.0%} of its decoded pixels do not lie on one plane, so its frames are damaged, out of "
        "order, or something moved while they were taken: capture it again"
        for n, pose in enumerate(poses)
        if pose.agreeing < AGREEING
    }
    bad |= _repeated(poses, bad, reference)
    _enough(poses, bad)
    here = _fit(poses, sizes, mirrors, bad, side)
    while (suspects := _suspects(here)) and len(here.poses) > MIN_POSES:
        whole = rms_px(here.solution, here.corners, finite(here.corners.projector))[2]
        best, best_rms, worst = here, np.inf, -1
        for n in suspects:
            try:
                other = _fit(poses, sizes, mirrors, {**bad, n: ""}, side)
            except ValueError:  # without this one there is nothing left to go by
                continue
            rms = rms_px(other.solution, other.corners, finite(other.corners.projector))[2]
            if rms < best_rms:
                best, best_rms, worst = other, rms, n
        if best_rms * BAD_GAIN > whole:
            return here  # no single pose is to blame
        bad[worst] = (
            f"it does not fit the others (stereo rms {whole:.2g} px with it, {best_rms:.2g} px without): board or rig "
            "moved during the capture, its frames are out of order, or the patterns are others: capture it again"
        )
        here = replace(best, bad=dict(bad))
    if suspects and len(here.poses) == MIN_POSES and _lost(here).max() > BAD_SHARE:
        name = poses[_most_lost(here)].name
        raise ValueError(
            f"{name}: {_lost(here).max():.0%} of its corners do not fit the other poses, and {MIN_POSES} poses are too "
            "few to do without it: capture it again, or give more poses"
        )
    return here


def _repeated(poses: Sequence[PoseCorners], bad: dict[int, str], reference: int) -> dict[int, str]:
    """Copies of poses, and why they do not count.

    Raises
    ------
    ValueError
        If too few differ.
    """
    twins = {n: m for n, m in copies(poses, reference).items() if n not in bad}
    distinct = len(poses) - len(bad) - len(twins)
    if twins and distinct < MIN_POSES:
        names = ", ".join(f"{poses[n].name} as in {poses[m].name}" for n, m in twins.items())
        raise ValueError(
            f"{distinct} of {len(poses)} poses differ, at least {MIN_POSES} must: the board stands in {names}: "
            "capture it at other tilts, 10 to 25 degrees to all sides, and in other places"
        )
    return {
        n: f"the board stands where it does in {poses[m].name}, so it tells nothing new: tilt it another way"
        for n, m in twins.items()
    }


def without(here: Fit, place: int, sizes: Sizes) -> Solution:
    """Fit the same corners again without the pose at `place`, from where the whole fit ended."""
    keep = here.corners.pose != place
    c, s = here.corners, here.solution
    pose = c.pose[keep] - (c.pose[keep] > place)
    corners = Corners(pose, c.board[keep], c.camera[keep], c.projector[keep], c.use[keep])
    begin = replace(
        s, pose_turns=np.delete(s.pose_turns, place, axis=0), pose_shifts=np.delete(s.pose_shifts, place, axis=0)
    )
    return adjust(corners, begin, sizes, here.noise_px)


def _fit(poses: Sequence[PoseCorners], sizes: Sizes, mirrors: Sequence[str], bad: dict[int, str], side: str) -> Fit:
    places = tuple(n for n in range(len(poses)) if n not in bad)
    corners = flat([poses[n] for n in places])
    solution, notes = first_fit(corners, sizes, mirrors, side)
    found = finite(corners.projector)
    noise = (0.2, 0.3)
    for _ in range(4):
        seen, lit = (np.linalg.norm(error, axis=1) for error in lens_residuals(solution, corners))
        # The length of a two-dimensional normal error has the median 1.177 sigma.
        a, b = (max(float(np.median(error[found])) / 1.177, 0.01) for error in (seen, lit))
        noise = (max(a, 0.25 * b), max(b, 0.25 * a))
        use = found & (_far(seen, lit, found) < OUTLIER)
        corners = replace(corners, use=_enough_of_each(use, found, corners.pose))
        solution = adjust(corners, solution, sizes, noise)
    return Fit(places, corners, solution, noise, dict(bad), notes)


def _far(seen: Floats, lit: Floats, found: npt.NDArray[np.bool_]) -> Floats:
    """Errors (n,) in standard deviations of the tail: what 80 % of the corners stay below tells them."""
    spread = [max(float(np.quantile(error[found], TAIL)), 1e-3) / TAIL_SIGMA for error in (seen, lit)]
    return np.fmax(seen / max(spread[0], 0.25 * spread[1]), lit / max(spread[1], 0.25 * spread[0]))


def _enough_of_each(
    use: npt.NDArray[np.bool_], found: npt.NDArray[np.bool_], pose: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """A pose that would keep fewer than half of its corners keeps all: it is judged as a whole."""
    use = use.copy()
    for n in range(int(pose.max()) + 1):
        mine = pose == n
        if use[mine].sum() < 0.5 * mine.sum():
            use[mine] = found[mine]
    return use


def _outliers(here: Fit) -> npt.NDArray[np.bool_]:
    seen, lit = (np.linalg.norm(error, axis=1) for error in lens_residuals(here.solution, here.corners))
    found = finite(here.corners.projector)
    far: npt.NDArray[np.bool_] = _far(seen, lit, found) >= OUTLIER
    return far & found


def _lost(here: Fit) -> Floats:
    """Share of outliers of each pose that counts."""
    far = _outliers(here)
    return np.array([far[here.corners.pose == n].mean() for n in range(len(here.poses))])


def _most_lost(here: Fit) -> int:
    return here.poses[int(np.argmax(_lost(here)))]


def _suspects(here: Fit) -> list[int]:
    """Poses that may be bad: all of them, where one has too many outliers or nothing fits: the blame may have moved."""
    spoilt = _outliers(here).mean() > FEW and _lost(here).max() > BAD_SHARE
    return list(here.poses) if spoilt or max(here.noise_px) > DOUBT_PX else []


def _enough(poses: Sequence[PoseCorners], bad: dict[int, str]) -> None:
    if bad and len(poses) - len(bad) < MIN_POSES:
        n, why = next(iter(bad.items()))
        raise ValueError(
            f"{poses[n].name}: {why} ({len(poses) - len(bad)} good poses are left, {MIN_POSES} are needed)"
        )
