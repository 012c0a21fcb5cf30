"""Centre lines as a graph in the site frame: lines, where they meet, and at which angle one goes on into another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from .crack_lines import CrackLines

__all__ = ["CrackGraph", "Line", "graph_of"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

GATE_CELLS = 2.0
"""A centre line lies within half the crack's width and so many cells of where it lay before."""
LEAST_GATE_MM = 0.04
AHEAD_CELLS = 6.0
"""The direction of a line at its end is that to the point so far along it, or three half widths."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line between two meetings.

    `points` are the numbers of its points in order, `ends` the meetings at its first and its last point (-1 for a
    ring), `stub` says that it is no longer than the crack is wide and lies within a junction.
    """

    points: Ints
    ends: tuple[int, int]
    stub: bool


@dataclass(frozen=True, slots=True, eq=False)
class CrackGraph:
    """The centre lines of one scan as a graph.

    Parameters
    ----------
    places : ndarray of float64, shape (n, 2)
        x and y of the points, mm, site frame.
    step_mm : ndarray of float64, shape (n,)
        Length that each point stands for.
    half_mm : ndarray of float64, shape (n,)
        Half the crack's width there.
    gate_mm : ndarray of float64, shape (n,)
        How far a point may lie from where its crack lay before.
    core : ndarray of bool, shape (n,)
        Further than two gates from the nearest junction.
    lines : tuple of Line
    meeting : tuple of tuples of (line, end)
        For each meeting the ends of lines that are there, stubs left out; one end alone is a tip, or leaves the field.
    centres : ndarray of float64, shape (meetings, 2)
        x and y, mm.
    reach_mm : ndarray of float64, shape (meetings,)
        Gate there.
    leaves : ndarray of bool, shape (meetings,)
        At the border of the field or of the region: no tip.
    """

    places: Floats
    step_mm: Floats
    half_mm: Floats
    gate_mm: Floats
    core: npt.NDArray[np.bool_]
    lines: tuple[Line, ...]
    meeting: tuple[tuple[tuple[int, int], ...], ...]
    centres: Floats
    reach_mm: Floats
    leaves: npt.NDArray[np.bool_]

    def end_point(self, line: int, end: int) -> int:
        """Number of the point at end 0 or 1 of a line."""
        return int(self.lines[line].points[0 if end == 0 else -1])

    def outward(self, line: int, end: int) -> Floats:
        """Unit vector in which a line leaves at one end."""
        points = self.lines[line].points if end == 0 else self.lines[line].points[::-1]
        steps = np.hypot(*np.diff(self.places[points], axis=0).T)
        ahead = max(3 * float(self.half_mm[points[0]]), AHEAD_CELLS * float(np.median(steps)) if steps.size else 0.0)
        k = min(int(np.searchsorted(np.cumsum(steps), ahead)) + 1, points.size - 1)
        away = self.places[points[0]] - self.places[points[k]]
        unit: Floats = away / max(float(np.hypot(*away)), 1e-12)
        return unit

    def turn(self, one: tuple[int, int], other: tuple[int, int]) -> float:
        """Angle by which a way turns that comes along one line and leaves along the other; 0 is straight on."""
        cosine = -float(self.outward(*one) @ self.outward(*other))
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def graph_of(lines: CrackLines, grid: Grid, region: npt.NDArray[np.bool_] | None = None) -> CrackGraph:
    """Build the graph of the centre lines of one scan.

    Junctions that lie no farther apart than the crack is wide are one meeting: a crossing is seen as two forks.

    Parameters
    ----------
    lines : CrackLines
    grid : Grid
    region : ndarray of bool, shape (rows, columns), optional
        Where cracks were looked for; a line that ends at its border leaves it.
    """
    pitch = grid.pitch_mm
    places = np.stack([grid.x0_mm + lines.column * pitch, grid.y0_mm + lines.row * pitch], axis=1)
    half, step = lines.half_width * pitch, lines.step * pitch
    gate = np.maximum(half + GATE_CELLS * pitch, LEAST_GATE_MM)
    pieces = np.split(np.arange(lines.segment.size), np.flatnonzero(np.diff(lines.segment)) + 1) if step.size else []
    owner = np.arange(len(lines.nodes))
    stubs = []
    for points, (a, b) in zip(pieces, lines.ends, strict=True):
        wide = 1.5 * max(half[points[0]], half[points[-1]]) + pitch
        forks = a >= 0 and lines.degree[a] > 2 and lines.degree[b] > 2
        stubs.append(bool(forks and a != b and step[points].sum() <= wide))
        if stubs[-1]:
            owner[owner == owner[b]] = owner[a]
    kept, meeting_of = np.unique(owner, return_inverse=True)
    node_places = np.stack([grid.x0_mm + lines.nodes[:, 1] * pitch, grid.y0_mm + lines.nodes[:, 0] * pitch], axis=1)
    centres = (
        np.stack([np.bincount(meeting_of, weights=node_places[:, k], minlength=kept.size) for k in (0, 1)], axis=1)
        / np.maximum(np.bincount(meeting_of, minlength=kept.size), 1)[:, None]
    )
    leaves = np.zeros(kept.size, dtype=np.bool_)
    leaves[meeting_of[lines.leaves]] = True
    if region is not None and kept.size:
        from scipy import ndimage

        row, column = np.rint(lines.nodes).astype(np.intp).T
        # the skeleton ends half a width before the mask does
        inside = ndimage.distance_transform_edt(region)[row, column] * pitch
        near = np.full(len(lines.nodes), np.inf)
        for points, (a, b) in zip(pieces, lines.ends, strict=True):
            if a >= 0:
                near[[a, b]] = half[points[0]], half[points[-1]]
        leaves[meeting_of[(inside <= near + 2 * pitch) & (lines.degree == 1)]] = True
    named = []
    meeting: list[list[tuple[int, int]]] = [[] for _ in range(kept.size)]
    reach = np.zeros(kept.size)
    core = np.ones(step.size, dtype=np.bool_)
    for number, (points, (a, b), stub) in enumerate(zip(pieces, lines.ends, stubs, strict=True)):
        ends = (int(meeting_of[a]), int(meeting_of[b])) if a >= 0 else (-1, -1)
        named.append(Line(points, ends, stub))
        if a < 0:
            continue
        along = np.cumsum(step[points]) - 0.5 * step[points]
        for end, node, gone in ((0, a, along), (1, b, along[-1] - along)):
            tip = points[0 if end == 0 else -1]
            reach[ends[end]] = max(reach[ends[end]], gate[tip])
            if not stub:
                meeting[ends[end]].append((number, end))
            if lines.degree[node] > 2:
                core[points] &= gone > 2 * gate[tip]
    return CrackGraph(places, step, half, gate, core, tuple(named), tuple(map(tuple, meeting)), centres, reach, leaves)
