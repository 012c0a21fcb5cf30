"""Where cracks end, and how fast their ends advance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..instant import Instant
from .crack_graph import CrackGraph
from .pairing import paired
from .values import Measurement

__all__ = ["CrackTip", "TipMemory", "crack_tips"]

Floats = npt.NDArray[np.float64]
HOUR = np.timedelta64(1, "h") / np.timedelta64(1, "ns")
LOST_MM = 1.0
"""A tip that comes farther between two scans than this and half its crack's length is another one."""


@dataclass(frozen=True, slots=True)
class CrackTip:
    """One free end of a crack.

    Parameters
    ----------
    number : int
        The same for one end of one crack in every scan, from 1.
    x_mm, y_mm : float
        Site frame.
    sigma_mm : float
        Standard uncertainty of its place along the crack, by the raster and the crack's width there. How much further
        the crack goes on too narrow to be seen is not in it.
    advance : Measurement
        How far it has come along the centre line since it was last seen, mm; below 0 where it went back, NaN at first.
    speed : Measurement
        That by the time between, mm per hour.
    """

    number: int
    x_mm: float
    y_mm: float
    sigma_mm: float
    advance: Measurement
    speed: Measurement


@dataclass(frozen=True, slots=True)
class TipMemory:
    """A tip as it was last seen, and when."""

    tip: CrackTip
    at: Instant


def crack_tips(
    graph: CrackGraph,
    identity: npt.NDArray[np.intp],
    before: Mapping[int, Sequence[TipMemory]],
    now: Instant,
    pitch_mm: float,
) -> dict[int, tuple[CrackTip, ...]]:
    """Find the tips of each crack: ends of lines at which nothing else is, inside the field and the region.

    The skeleton stops half a width before the crack does, so a tip lies so far beyond its last point. It is the tip of
    before that is nearest (least sum of distances over the crack's tips). Its advance is the length of centre line from
    the point nearest to where it was, and negative if it was beyond.

    Parameters
    ----------
    graph : CrackGraph
    identity : ndarray of intp, shape (n,)
        Crack of each point.
    before : mapping of int to sequence of TipMemory
        All tips that were ever seen, by crack.
    now : Instant
    pitch_mm : float

    Returns
    -------
    dict of int to tuple of CrackTip
        By crack, in the order of their numbers.
    """
    ends: dict[int, list[tuple[int, int]]] = {}
    for at, there in enumerate(graph.meeting):
        if len(there) == 1 and not graph.leaves[at]:
            name = int(identity[graph.end_point(*there[0])])
            if name > 0:
                ends.setdefault(name, []).append(there[0])
    found = {}
    for name, mine in sorted(ends.items()):
        old = before.get(name, ())
        places = np.array([_place(graph, *end) for end in mine])
        length = float(graph.step_mm[identity == name].sum())
        pairs = _pairs(places, old, LOST_MM + 0.5 * length)
        fresh = max((memory.tip.number for memory in old), default=0)
        tips = []
        for n, end in enumerate(mine):
            half = float(graph.half_mm[graph.end_point(*end)])
            sigma = float(np.hypot(pitch_mm, 0.5 * half))
            if n in pairs:
                memory = old[pairs[n]]
                advance, speed = _advance(graph, end, places[n], sigma, memory, now)
                number = memory.tip.number
            else:
                fresh += 1
                number, advance, speed = fresh, *(Measurement(float("nan"), float("nan")),) * 2
            tips.append(CrackTip(number, float(places[n, 0]), float(places[n, 1]), sigma, advance, speed))
        found[name] = tuple(sorted(tips, key=lambda tip: tip.number))
    return found


def _place(graph: CrackGraph, line: int, end: int) -> Floats:
    last = graph.end_point(line, end)
    place: Floats = graph.places[last] + graph.half_mm[last] * graph.outward(line, end)
    return place


def _pairs(places: Floats, old: Sequence[TipMemory], farthest_mm: float) -> dict[int, int]:
    if not old:
        return {}
    then = np.array([[memory.tip.x_mm, memory.tip.y_mm] for memory in old])
    away = np.hypot(*(places[:, None] - then[None]).transpose(2, 0, 1))
    return paired(away, away <= farthest_mm, alone=1e6)


def _advance(
    graph: CrackGraph, end: tuple[int, int], place: Floats, sigma: float, memory: TipMemory, now: Instant
) -> tuple[Measurement, Measurement]:
    line, side = end
    points = graph.lines[line].points if side == 0 else graph.lines[line].points[::-1]
    then = np.array([memory.tip.x_mm, memory.tip.y_mm])
    way = np.concatenate([place[None], graph.places[points]])
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    off = np.hypot(*(way - then).T)
    nearest = int(off.argmin())
    if nearest == 0:
        far = float((place - then) @ graph.outward(line, side))
    elif nearest == len(way) - 1:  # it came round a corner: the crack was followed by another line before
        far = max(float(gone[-1]), float(np.hypot(*(place - then))))
    else:
        far = float(gone[nearest])
    error = float(np.hypot(sigma, memory.tip.sigma_mm))
    hours = float((now - memory.at) / np.timedelta64(1, "ns")) / HOUR
    if hours <= 0:
        return Measurement(far, error), Measurement(float("nan"), float("nan"))
    return Measurement(far, error), Measurement(far / hours, error / hours)
