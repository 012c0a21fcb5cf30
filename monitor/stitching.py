"""Tiles of a large area find their places: neighbours are registered, the stage's axes found, all adjusted at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import Grid, Scan
from pipelines.change import Motion, register
from pipelines.reconstruction import Offset, Placement, place_tiles

from .stage_axes import ORIENTATIONS, in_site

__all__ = ["LonelyTileError", "Stitched", "overlap_of", "stitch"]

Floats = npt.NDArray[np.float64]

LEAST_SIDE = 20
LEAST_CELLS = 1500
"""Fewer common cells than these say too little about where a tile lies."""
DOUBT = 5.0
"""An offset from a doubtful registration counts as if its uncertainty were so many times larger."""
TRIED_PAIRS = 3
DECIDED = 1.5
"""The best way to lay the stage's axes must fit so many times better than the next one."""


@dataclass(frozen=True, slots=True, eq=False)
class Stitched:
    """Where the tiles lie in the site frame (how far the stage had moved the sample), and how that was found.

    `axes` names the entry of `ORIENTATIONS` that was used; `verdicts` belongs to the offsets, in their order; `failed`
    lists pairs that overlap but could not be registered, with the reason.
    """

    placement: Placement
    commanded_mm: Floats
    axes: tuple[str, str]
    offsets: tuple[Offset, ...]
    verdicts: tuple[Motion, ...]
    failed: tuple[tuple[int, int, str], ...]

    def doubts(self, names: Sequence[str]) -> list[str]:
        """Tell of each overlap that was used with care, or not at all; those that do not fit first."""
        told = [f"{names[i]} and {names[j]}: overlap, but do not fit: {reason}" for i, j, reason in self.failed]
        for offset, motion, counts in zip(self.offsets, self.verdicts, self.placement.counts, strict=True):
            pair = f"{names[offset.first]} and {names[offset.second]}"
            if not counts:
                told.append(f"{pair}: their offset contradicts the others and was left out")
            elif motion.verdict == "doubtful":
                told.append(f"{pair}: doubtful: {motion.reason}")
        return told


def overlap_of(first: Scan, second: Scan, apart_mm: Floats) -> tuple[Scan, Scan, Floats] | None:
    """Cut the common part out of two tiles, without resampling: the second is moved by whole cells.

    Parameters
    ----------
    first, second : Scan
        Of one pitch.
    apart_mm : ndarray of float64, shape (2,) or (3,)
        Position of the second less that of the first.

    Returns
    -------
    (Scan, Scan, ndarray) or None
        Both parts on one grid, and by how much the second was moved onto the first (x, y, 0), mm; None where too few
        cells are common.
    """
    a, b = first.grid, second.grid
    pitch = a.pitch_mm
    column = round((b.x0_mm - apart_mm[0] - a.x0_mm) / pitch)
    row = round((b.y0_mm - apart_mm[1] - a.y0_mm) / pitch)
    top, bottom = max(row, 0), min(a.rows, row + b.rows)
    left, right = max(column, 0), min(a.columns, column + b.columns)
    if min(bottom - top, right - left) < LEAST_SIDE:
        return None
    grid = Grid(bottom - top, right - left, pitch, a.x0_mm + left * pitch, a.y0_mm + top * pitch)
    ours = _cut(first, grid, top, left)
    theirs = _cut(second, grid, top - row, left - column)
    if int((np.isfinite(ours.height) & np.isfinite(theirs.height)).sum()) < LEAST_CELLS:
        return None
    moved = np.array([a.x0_mm + column * pitch - b.x0_mm, a.y0_mm + row * pitch - b.y0_mm, 0.0])
    return ours, theirs, moved


def stitch(
    scans: Sequence[Scan],
    stage_mm: Floats,
    *,
    axes: tuple[str, str] | None,
    stage_sigma_mm: float,
    bow_mm: float = 0.0,
    step: Callable[[int, int], None] = lambda done, total: None,
) -> Stitched:
    """Place tiles from what the stage was told and from what the surface shows where they overlap.

    Parameters
    ----------
    scans : sequence of Scan
        Of one pitch, each in the site frame of its rig.
    stage_mm : ndarray of float64, shape (tiles, 3)
        Commanded displacement of the sample, stage axes.
    axes : (str, str) or None
        Key of `ORIENTATIONS`; None tries all and takes the one under which overlapping tiles agree.
    stage_sigma_mm : float
        How far off the stage may be.
    bow_mm : float
        Shared part of the tiles' sigma: neighbours meet with different ends of it.
    step : callable
        Told of (pairs done, pairs in all).

    Raises
    ------
    InputError
        If the pitches differ, a tile overlaps no other, or nothing tells how the stage's axes lie.
    """
    pitches = {scan.grid.pitch_mm for scan in scans}
    if max(pitches) - min(pitches) > 1e-9:
        raise InputError(
            f"tiles have cells of {min(pitches):g} and {max(pitches):g} mm: give all one pitch (--pitch-mm)"
        )
    axes = _find_axes(scans, stage_mm) if axes is None else axes
    commanded = in_site(stage_mm, axes)
    pairs = _pairs(scans, commanded)
    _refuse_lonely(len(scans), pairs)
    sigma = (stage_sigma_mm, stage_sigma_mm, 10 * stage_sigma_mm)  # a stage's plane is tilted against the site's
    found: dict[tuple[int, int], tuple[Offset, Motion]] = {}
    position = commanded
    used: dict[tuple[int, int], Floats] = {}
    placement = place_tiles(commanded, [], sigma)
    for turn in range(2):
        for done, (i, j) in enumerate(pairs, start=1):
            apart = position[j] - position[i]
            pitch = scans[0].grid.pitch_mm
            known = (i, j) in found and np.abs(apart - used[i, j])[:2].max() < pitch
            if not known and (turn == 0 or np.abs(apart - used[i, j])[:2].max() > pitch / 2):
                used[i, j] = apart
                found[i, j] = _offset(i, j, scans[i], scans[j], apart, bow_mm)
            if turn == 0:
                step(done, len(pairs))
        good = {pair: each for pair, each in found.items() if each[1].verdict != "failed"}
        placement = place_tiles(commanded, [offset for offset, _ in good.values()], sigma)
        position = placement.position_mm
    failed = tuple((i, j, motion.reason) for (i, j), (_, motion) in found.items() if motion.verdict == "failed")
    offsets, verdicts = tuple(each[0] for each in good.values()), tuple(each[1] for each in good.values())
    return Stitched(placement, commanded, axes, offsets, verdicts, failed)


def _cut(scan: Scan, grid: Grid, top: int, left: int) -> Scan:
    part = (slice(top, top + grid.rows), slice(left, left + grid.columns))
    height, sigma = np.ascontiguousarray(scan.height[part]), np.ascontiguousarray(scan.sigma[part])
    texture, level = np.ascontiguousarray(scan.texture[part]), np.ascontiguousarray(scan.level[part])
    return Scan(grid, scan.time, height, sigma, texture, level, scan.calibration_id)


def _pairs(scans: Sequence[Scan], position: Floats) -> list[tuple[int, int]]:
    return [
        (i, j)
        for i, j in combinations(range(len(scans)), 2)
        if overlap_of(scans[i], scans[j], position[j] - position[i]) is not None
    ]


def _refuse_lonely(tiles: int, pairs: Sequence[tuple[int, int]]) -> None:
    met = {number for pair in pairs for number in pair}
    lonely = [number for number in range(tiles) if number not in met]
    if lonely:
        raise LonelyTileError(lonely[0])


class LonelyTileError(InputError):
    """A tile that overlaps no other; `number` says which."""

    def __init__(self, number: int) -> None:
        super().__init__(f"tile {number + 1} overlaps no other tile at the stage's coordinates: are they in mm?")
        self.number = number


def _offset(i: int, j: int, first: Scan, second: Scan, apart: Floats, bow_mm: float) -> tuple[Offset, Motion]:
    """Register the common part of two tiles."""
    cut = overlap_of(first, second, apart)
    if cut is None:
        nothing = float("nan")
        unknown = Offset(i, j, (nothing, nothing, nothing), (nothing, nothing, nothing))
        return unknown, Motion.failed(0.0, "too few common cells")
    ours, theirs, moved = cut
    motion = register(theirs, ours, put_back=False)
    both = np.isfinite(ours.height) & np.isfinite(theirs.height)
    rows, columns = np.nonzero(both)
    grid = ours.grid
    middle = np.array([grid.x_mm[columns].mean(), grid.y_mm[rows].mean(), float(ours.height[both].mean()), 1.0])
    total = moved + (motion.matrix @ middle - middle)[:3]
    doubt = DOUBT if motion.verdict == "doubtful" else 1.0
    across = motion.sigma_xy_mm if np.isfinite(motion.sigma_xy_mm) else grid.pitch_mm * min(grid.shape) / 10
    up = float(np.hypot(motion.sigma_z_mm, np.sqrt(2) * bow_mm)) if motion.verdict != "failed" else float("nan")
    sigma = (doubt * across, doubt * across, max(doubt * up, 1e-6))
    # the second tile's sample comes onto the first's by `total`: the stage stood less by that
    return Offset(i, j, (-float(total[0]), -float(total[1]), -float(total[2])), sigma), motion


def _misfit(scans: Sequence[Scan], position: Floats, pairs: Sequence[tuple[int, int]]) -> float:
    """How badly nearest neighbours fit: of those beside each other and those above each other, the worse, mm."""
    worst = 0.0
    apart = {pair: np.abs(position[pair[1]] - position[pair[0]])[:2] for pair in pairs}
    for beside in (True, False):
        ours = [pair for pair in pairs if bool(apart[pair][0] >= apart[pair][1]) == beside]
        near = sorted(ours, key=lambda pair: float(apart[pair].sum()))
        fits = [_offset(i, j, scans[i], scans[j], position[j] - position[i], 0.0)[1] for i, j in near[:TRIED_PAIRS]]
        if fits:
            worst = max(worst, float(np.median([np.inf if m.verdict == "failed" else m.residual_mm for m in fits])))
    return worst


def _find_axes(scans: Sequence[Scan], stage_mm: Floats) -> tuple[str, str]:
    """The orientation under which neighbours agree best."""
    scores: list[tuple[float, tuple[str, str]]] = []
    seen: list[Floats] = []
    for axes in ORIENTATIONS:
        position = in_site(stage_mm, axes)
        if any(np.allclose(position, other) for other in seen):
            continue  # tiles in one row look the same under several
        seen.append(position)
        pairs = _pairs(scans, position)
        if {number for pair in pairs for number in pair} != set(range(len(scans))):
            continue
        scores.append((_misfit(scans, position, pairs), axes))
    scores.sort(key=lambda each: each[0])
    if not scores:
        _refuse_lonely(len(scans), _pairs(scans, in_site(stage_mm, ("x", "y"))))
        raise InputError("some tile overlaps no other, whichever way the stage's axes lie: are its positions in mm?")
    if not np.isfinite(scores[0][0]) or (len(scores) > 1 and scores[1][0] < DECIDED * scores[0][0]):
        raise InputError(
            "the overlaps do not tell how the stage's axes lie against the camera's image: "
            "write `axes: [x, y]` (or -x, y and so on) into the stage file (YAML)"
        )
    return scores[0][1]
