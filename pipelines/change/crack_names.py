"""Which crack is which: the centre lines of one scan named by those of the scans before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from .crack_graph import CrackGraph

__all__ = ["CrackEvent", "CrackMemory", "Named", "name_cracks"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

STRAIGHT = np.deg2rad(40.0)
"""A crack goes on through a junction into the line that turns off by less than this."""


@dataclass(frozen=True, slots=True)
class CrackEvent:
    """Something that happened to a crack between the scan before and this one.

    `kind` is ``began`` (alone), ``branched`` (began at `other`), ``met`` (runs into or across `other`) or ``merged``
    (its line and that of `other` have become one, which goes on under the name `other`).
    """

    kind: str
    identity: int
    other: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CrackMemory:
    """All that is known of cracks before a scan: where each was last seen, and which of them meet.

    Parameters
    ----------
    places : ndarray of float64, shape (n, 2)
        x and y of the points of all centre lines, mm; a stretch that was not seen again is remembered.
    identity : ndarray of intp, shape (n,)
        Crack that each point is of.
    length_mm : mapping of int to float
        Length of each crack when last seen.
    contacts : frozenset of (int, int)
        Pairs of cracks that meet, the smaller number first.
    junctions : ndarray of float64, shape (m, 3)
        x, y and identity of each crack that meets another one there.
    named : int
        How many names were given.
    """

    places: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    identity: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    length_mm: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    contacts: frozenset[tuple[int, int]] = frozenset()
    junctions: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    named: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """The centre lines of one scan with their names.

    Parameters
    ----------
    identity : ndarray of intp, shape (n,)
        Crack that each point of the lines is of, from 1.
    contacts : frozenset of (int, int)
        Pairs that meet in this scan.
    parent : mapping of int to int
        Crack from which each that began in this scan branched off.
    events : tuple of CrackEvent
    memory : CrackMemory
        What the next scan needs.
    """

    identity: Ints
    contacts: frozenset[tuple[int, int]]
    parent: Mapping[int, int]
    events: tuple[CrackEvent, ...]
    memory: CrackMemory


def name_cracks(graph: CrackGraph, memory: CrackMemory) -> Named:
    """Name the lines of one scan.

    1. Every point takes the name of the remembered point nearest to it, if that is no farther than half the crack's
       width and two cells. Points close to a junction do not vote. A line takes the name that its points give, and what
       has grown beyond with it. Where they give several, the line is cut between cracks that are known to meet;
       of others the lines have grown into one: the longest keeps its name, the rest have *merged* into it.
    2. A line without a name that leaves a new junction straight on (within 40 degrees) from where a named one ends is
       that one's growth; a junction that was known before ends a crack for good.
    3. What is left is new. Lines that go straight through a junction are one crack. It *branched* from the longest of
       the cracks named before that it touches.

    The answer depends on the order of the scans alone.

    Parameters
    ----------
    graph : CrackGraph
    memory : CrackMemory
        Of the scans before; an empty one before the first.

    Returns
    -------
    Named
    """
    identity = np.zeros(len(graph.places), dtype=np.intp)
    merged = _by_memory(graph, memory, identity)
    _grow(graph, memory, identity)
    fresh = _begin(graph, memory.named, identity)
    _name_stubs(graph, identity)
    contacts, junctions = _meetings(graph, identity)
    first = memory.named == 0
    before = set(memory.length_mm)
    parent: dict[int, int] = {}
    events = [CrackEvent("merged", one, other) for one, other in sorted(merged.items())]
    known = frozenset(_pair(merged.get(a, a), merged.get(b, b)) for a, b in memory.contacts)
    for one in fresh:
        touched = [other for pair in contacts if one in pair for other in pair if other != one and other in before]
        if touched:
            parent[one] = max(touched, key=lambda other: (memory.length_mm[other], -other))
        if not first:
            events.append(CrackEvent("branched" if one in parent else "began", one, parent.get(one)))
    if not first:
        events += [
            CrackEvent("met", b, a) for a, b in sorted(contacts - known) if parent.get(b) != a and parent.get(a) != b
        ]
    lengths = np.bincount(identity, weights=graph.step_mm, minlength=1)
    length_mm = {one: length for one, length in memory.length_mm.items() if one not in merged}
    length_mm |= {int(one): float(lengths[one]) for one in np.unique(identity) if one > 0}
    places, names = _remembered(graph, memory, identity, merged)
    after = CrackMemory(
        places,
        names,
        MappingProxyType(length_mm),
        frozenset(pair for pair in known if pair[0] != pair[1]) | contacts,
        _kept_junctions(memory.junctions, junctions, merged, graph.gate_mm),
        memory.named + len(fresh),
    )
    return Named(identity, contacts, MappingProxyType(parent), tuple(events), after)


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _by_memory(graph: CrackGraph, memory: CrackMemory, identity: Ints) -> dict[int, int]:
    """Name, in place, the lines that were known; gives which cracks have merged into which."""
    from scipy.spatial import cKDTree

    if not len(memory.places) or not len(graph.places):
        return {}
    away, nearest = cKDTree(memory.places).query(graph.places)
    voted = np.where(away <= graph.gate_mm, memory.identity[nearest], 0)
    joined: list[tuple[int, int]] = []
    for line in graph.lines:
        if line.stub:
            continue
        points, gate = line.points, float(np.median(graph.gate_mm[line.points]))
        core = graph.core[points] if graph.core[points].any() else np.ones(points.size, dtype=np.bool_)
        steps = np.where(core, graph.step_mm[points], 0.0)
        given = np.bincount(voted[points], weights=steps)
        given[0] = 0.0
        enough = min(2 * gate, 0.5 * float(steps.sum()))
        names = np.flatnonzero((given >= enough) & (given > 0))
        if not names.size:
            continue
        sure = np.flatnonzero(core & np.isin(voted[points], names))
        # each point as the nearest sure one along the line
        at = np.searchsorted(0.5 * (sure[1:] + sure[:-1]), np.arange(points.size))
        run = voted[points][sure[at]]
        identity[points] = run
        turns = np.flatnonzero(np.diff(run))
        joined += [
            (int(run[k]), int(run[k + 1])) for k in turns if _pair(int(run[k]), int(run[k + 1])) not in memory.contacts
        ]
    into = _merged(joined, memory.length_mm)
    for one, other in into.items():
        identity[identity == one] = other
    return into


def _merged(joined: list[tuple[int, int]], length_mm: Mapping[int, float]) -> dict[int, int]:
    """Of each set of cracks whose lines have become one, the longest keeps its name, the oldest of equals."""
    sets: list[set[int]] = []
    for pair in joined:
        touched = [group for group in sets if group & set(pair)]
        sets = [group for group in sets if group not in touched] + [set(pair).union(*touched)]
    into = {}
    for group in sets:
        survivor = max(group, key=lambda one: (length_mm.get(one, 0.0), -one))
        into.update({one: survivor for one in group if one != survivor})
    return into


def _grow(graph: CrackGraph, memory: CrackMemory, identity: Ints) -> None:
    """Let cracks that reached a new junction go on through it, in place."""
    while True:
        best: tuple[float, int, int] | None = None
        for at, ends in enumerate(graph.meeting):
            names = [int(identity[graph.end_point(line, end)]) for line, end in ends]
            for k, name in enumerate(names):
                if name == 0 or names.count(name) > 1 or _was_junction(graph, at, name, memory.junctions):
                    continue
                for j, other in enumerate(names):
                    if other == 0:
                        turn = graph.turn(ends[k], ends[j])
                        if turn < STRAIGHT and (best is None or turn < best[0]):
                            best = turn, name, ends[j][0]
        if best is None:
            return
        identity[graph.lines[best[2]].points] = best[1]


def _was_junction(graph: CrackGraph, at: int, name: int, junctions: Floats) -> bool:
    mine = junctions[junctions[:, 2] == name, :2]
    away = np.hypot(*(mine - graph.centres[at]).T)
    return bool((away <= 2 * graph.reach_mm[at]).any())


def _begin(graph: CrackGraph, named: int, identity: Ints) -> list[int]:
    """Name what has none, in place: lines that go straight through a junction together; gives the new names."""
    nameless = [n for n, line in enumerate(graph.lines) if not line.stub and identity[line.points[0]] == 0]
    group = {n: n for n in nameless}

    def root(n: int) -> int:
        while group[n] != n:
            n = group[n]
        return n

    for ends in graph.meeting:
        free = [end for end in ends if end[0] in group]
        turns = sorted(
            (turn, a, b)
            for n, a in enumerate(free)
            for b in free[n + 1 :]
            if a[0] != b[0] and (turn := graph.turn(a, b)) < STRAIGHT
        )
        used: set[tuple[int, int]] = set()
        for _, a, b in turns:
            if a not in used and b not in used:
                used |= {a, b}
                group[max(root(a[0]), root(b[0]))] = min(root(a[0]), root(b[0]))
    sizes: dict[int, float] = {}
    for n in nameless:
        sizes[root(n)] = sizes.get(root(n), 0.0) + float(graph.step_mm[graph.lines[n].points].sum())
    names = {
        start: named + 1 + k for k, (start, _) in enumerate(sorted(sizes.items(), key=lambda item: (-item[1], item[0])))
    }
    for n in nameless:
        identity[graph.lines[n].points] = names[root(n)]
    return sorted(names.values())


def _name_stubs(graph: CrackGraph, identity: Ints) -> None:
    """A line no longer than the crack is wide, within a junction, belongs to the crack that passes there, in place."""
    for line in graph.lines:
        if not line.stub:
            continue
        names = [
            int(identity[graph.end_point(other, end)])
            for other, end in graph.meeting[line.ends[0]]
            if not graph.lines[other].stub
        ]
        named = [name for name in names if name > 0]
        if named:
            identity[line.points] = max(named, key=lambda name: (named.count(name), -name))


def _meetings(graph: CrackGraph, identity: Ints) -> tuple[frozenset[tuple[int, int]], Floats]:
    """Pairs of cracks that meet, and where each of them does so: x, y, identity."""
    pairs: set[tuple[int, int]] = set()
    junctions: list[tuple[float, float, float]] = []

    def meet(names: set[int], x: float, y: float) -> None:
        ordered = sorted(names - {0})
        if len(ordered) > 1:
            pairs.update((a, b) for n, a in enumerate(ordered) for b in ordered[n + 1 :])
            junctions.extend((x, y, float(name)) for name in ordered)

    for at, ends in enumerate(graph.meeting):
        x, y = graph.centres[at]
        meet({int(identity[graph.end_point(line, end)]) for line, end in ends}, float(x), float(y))
    for line in graph.lines:
        names = identity[line.points]
        for k in np.flatnonzero(np.diff(names)):
            x, y = graph.places[line.points[k]]
            meet({int(names[k]), int(names[k + 1])}, float(x), float(y))
    return frozenset(pairs), np.array(junctions, dtype=np.float64).reshape(-1, 3)


def _remembered(
    graph: CrackGraph, memory: CrackMemory, identity: Ints, merged: Mapping[int, int]
) -> tuple[Floats, Ints]:
    """The points of now, and those of before that nothing of now replaces."""
    from scipy.spatial import cKDTree

    seen = identity > 0
    places, names = graph.places[seen], identity[seen]
    if not len(memory.places):
        return places, names
    old = memory.identity.copy()
    for one, other in merged.items():
        old[old == one] = other
    if not len(places):
        return memory.places, old
    away, nearest = cKDTree(places).query(memory.places)
    gone = away > graph.gate_mm[seen][nearest]
    return np.concatenate([places, memory.places[gone]]), np.concatenate([names, old[gone]])


def _kept_junctions(old: Floats, new: Floats, merged: Mapping[int, int], gate_mm: Floats) -> Floats:
    if not len(old):
        return new
    old = old.copy()
    for one, other in merged.items():
        old[old[:, 2] == one, 2] = other
    gate = 2 * float(np.median(gate_mm)) if gate_mm.size else 0.0
    if len(new):
        away = np.hypot(old[:, None, 0] - new[None, :, 0], old[:, None, 1] - new[None, :, 1])
        old = old[~((away <= gate) & (old[:, None, 2] == new[None, :, 2])).any(axis=1)]
    return np.concatenate([new, old])
