"""Cracks followed from scan to scan: which is which, how each grows, branches and runs into another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ..instant import Instant
from ..scan import Scan
from .crack_depths import crack_depths
from .crack_graph import CrackGraph, graph_of
from .crack_names import CrackEvent, CrackMemory, name_cracks
from .crack_sizes import CrackSize, crack_cells, crack_sizes
from .crack_tips import CrackTip, TipMemory, crack_tips
from .crack_widths import crack_openings
from .cracks import CrackRule, crack_mask

__all__ = ["CrackHistory", "CrackLine", "CrackSighting", "CrackSightings", "follow_cracks", "next_cracks"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CrackSighting:
    """One crack at one time.

    Parameters
    ----------
    identity : int
        The same for one crack in every scan, from 1.
    size : CrackSize
    tips : tuple of CrackTip
        Its free ends inside the field.
    branched_from : int or None
        The crack at which it began; None where it began alone or was there in the first scan.
    meets : tuple of int
        Cracks that it touches.
    """

    identity: int
    size: CrackSize
    tips: tuple[CrackTip, ...]
    branched_from: int | None
    meets: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CrackLine:
    """A stretch of one crack's centre line, between two meetings or ends.

    Parameters
    ----------
    identity : int
    x_mm, y_mm : ndarray of float64, shape (n,)
        Its points in order, site frame.
    """

    identity: int
    x_mm: Floats
    y_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class CrackHistory:
    """What was seen of cracks before a scan: a value, from which the next scan goes on."""

    memory: CrackMemory = field(default_factory=CrackMemory)
    tips: Mapping[int, tuple[TipMemory, ...]] = field(default_factory=lambda: MappingProxyType({}))
    parent: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True, eq=False)
class CrackSightings:
    """All cracks of one scan.

    Parameters
    ----------
    time : Instant
    cracks : tuple of CrackSighting
        By identity.
    identities : ndarray of int32, shape (rows, columns)
        Crack that each cell belongs to, 0 for none.
    lines : tuple of CrackLine
        Where they run.
    events : tuple of CrackEvent
        What began, branched, met and merged since the scan before.
    history : CrackHistory
        Goes into `next_cracks` with the next scan.
    """

    time: Instant
    cracks: tuple[CrackSighting, ...]
    identities: npt.NDArray[np.int32]
    lines: tuple[CrackLine, ...]
    events: tuple[CrackEvent, ...]
    history: CrackHistory


def follow_cracks(
    scans: Iterable[Scan], rule: CrackRule | None = None, region: npt.NDArray[np.bool_] | None = None
) -> Iterator[CrackSightings]:
    """Follow cracks through scans of one surface.

    Parameters
    ----------
    scans : iterable of Scan
        In the order of time, registered to one baseline.
    rule : CrackRule, optional
    region : ndarray of bool, shape (rows, columns), optional
        Where to look.

    Yields
    ------
    CrackSightings
        One for each scan. What a scan shows depends on the scans up to it, not on how they were handed over.
    """
    history = CrackHistory()
    for scan in scans:
        found = next_cracks(scan, history, rule, region)
        history = found.history
        yield found


def next_cracks(
    scan: Scan,
    history: CrackHistory | None = None,
    rule: CrackRule | None = None,
    region: npt.NDArray[np.bool_] | None = None,
) -> CrackSightings:
    """Find the cracks of one more scan, and which they are (`name_cracks`), how large, and where their tips are.

    Parameters
    ----------
    scan : Scan
    history : CrackHistory, optional
        Of the scans before; none before the first.
    rule : CrackRule, optional
    region : ndarray of bool, shape (rows, columns), optional

    Returns
    -------
    CrackSightings
    """
    history = CrackHistory() if history is None else history
    mask = crack_mask(scan, rule)
    if region is not None:
        mask &= region
    openings = crack_openings(scan, mask, rule=rule)
    depths = crack_depths(scan, mask, openings.lines)
    graph = graph_of(openings.lines, scan.grid, region)
    named = name_cracks(graph, history.memory)
    cells = crack_cells(mask, openings, named.identity)
    counted = mask.size if region is None else int(region.sum())
    sizes = crack_sizes(scan, cells, openings, depths, named.identity, counted)
    merged = {event.identity: event.other for event in named.events if event.kind == "merged" and event.other}
    tips_before = _merged_tips(history.tips, merged)
    tips = crack_tips(graph, named.identity, tips_before, scan.time, scan.grid.pitch_mm)
    parent = {**history.parent, **named.parent}
    cracks = tuple(
        CrackSighting(
            one,
            sizes[one],
            tips.get(one, ()),
            parent.get(one),
            tuple(sorted(other for pair in named.contacts if one in pair for other in pair if other != one)),
        )
        for one in sorted(sizes)
    )
    remembered = dict(tips_before)
    for one, seen in tips.items():
        newest = {memory.tip.number: memory for memory in remembered.get(one, ())}
        newest |= {tip.number: TipMemory(tip, scan.time) for tip in seen}
        remembered[one] = tuple(newest[number] for number in sorted(newest))
    after = CrackHistory(named.memory, MappingProxyType(remembered), MappingProxyType(parent))
    return CrackSightings(scan.time, cracks, cells, _lines(graph, named.identity), named.events, after)


def _lines(graph: CrackGraph, identity: npt.NDArray[np.intp]) -> tuple[CrackLine, ...]:
    """Cut each line of the graph where its name changes: two cracks that meet may share one."""
    found = []
    for line in graph.lines:
        for points in np.split(line.points, np.flatnonzero(np.diff(identity[line.points])) + 1):
            if points.size > 1 and identity[points[0]] > 0:
                x, y = graph.places[points].T
                found.append(CrackLine(int(identity[points[0]]), x, y))
    return tuple(found)


def _merged_tips(
    tips: Mapping[int, tuple[TipMemory, ...]], merged: Mapping[int, int]
) -> dict[int, tuple[TipMemory, ...]]:
    """Tips of cracks that have become one, under one name and numbered on."""
    found = {one: memories for one, memories in tips.items() if one not in merged}
    for one, other in sorted(merged.items()):
        own = found.get(other, ())
        last = max((memory.tip.number for memory in own), default=0)
        found[other] = own + tuple(
            TipMemory(replace(memory.tip, number=last + 1 + k), memory.at) for k, memory in enumerate(tips.get(one, ()))
        )
    return found
