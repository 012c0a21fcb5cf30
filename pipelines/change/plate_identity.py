"""Plates followed from scan to scan: a plate keeps its name while it shrinks, and one that breaks says into which."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ..instant import Instant
from .cracks import crack_mask
from .pairing import paired
from .plates import Plate, find_plates
from .values import Comparison

__all__ = ["NamedPlates", "PlateMemory", "PlateSightings", "follow_plates", "name_plates"]

Labels = npt.NDArray[np.int32]
LEAST_SHARE = 0.2
"""A plate that shares less of its area with one of before has nothing to do with it."""


@dataclass(frozen=True, slots=True, eq=False)
class PlateMemory:
    """Where plates were last seen: identity of each cell, 0 where none ever was; and how many names were given."""

    identity: Labels | None = None
    named: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class NamedPlates:
    """Names of the plates of one scan.

    Parameters
    ----------
    identity : mapping of int to int
        Of each label.
    broke_from : mapping of int to int
        Plate of which each that is new was a part.
    joined : mapping of int to int
        Plate into which each that is gone has grown: the crack between them was not found.
    memory : PlateMemory
        What the next scan needs.
    """

    identity: Mapping[int, int]
    broke_from: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))
    joined: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))
    memory: PlateMemory = field(default_factory=PlateMemory)


def name_plates(labels: Labels, memory: PlateMemory | None = None) -> NamedPlates:
    """Name the plates of one scan by those of the scans before.

    Plates are paired with those of before so that the pairs share most cells in all (`paired`). A plate without a
    partner that shares a fifth of its area with one of before has broken off from it; a plate of before without a
    partner that now lies in another has joined it, and takes its name again when it parts.

    Parameters
    ----------
    labels : ndarray of int32, shape (rows, columns)
        As `find_plates` gives them.
    memory : PlateMemory, optional
        Of the scans before.

    Returns
    -------
    NamedPlates
    """
    memory = PlateMemory() if memory is None else memory
    count = int(labels.max(initial=0))
    if memory.identity is None:
        names = {label: label for label in range(1, count + 1)}
        return NamedPlates(MappingProxyType(names), memory=PlateMemory(labels.copy(), count))
    before = memory.identity
    if before.shape != labels.shape:
        raise ValueError(f"plates of {labels.shape} cells, but those before have {before.shape}")
    width = memory.named + 1
    shared = np.bincount((labels.astype(np.intp) * width + before).ravel(), minlength=(count + 1) * width).reshape(
        count + 1, width
    )
    sizes, then = shared.sum(axis=1), shared.sum(axis=0)
    shared[0], shared[:, 0] = 0, 0
    akin = (shared > 0) & ((shared >= LEAST_SHARE * sizes[:, None]) | (shared >= LEAST_SHARE * then))
    names = paired(-shared.astype(np.float64), akin, alone=0.0)
    taken = set(names.values())
    named, broke = memory.named, {}
    for label in range(1, count + 1):
        if label not in names:
            named += 1
            names[label] = named
            if shared[label].max(initial=0) >= LEAST_SHARE * sizes[label]:
                broke[named] = int(shared[label].argmax())
    joined = {
        one: names[int(shared[:, one].argmax())]
        for one in range(1, width)
        if one not in taken and then[one] and shared[:, one].max() >= 0.5 * then[one]
    }
    table = np.array([0, *(names[label] for label in range(1, count + 1))], dtype=np.int32)
    now = table[labels]
    # a plate that was not told from its neighbour is remembered where it lay
    kept = np.isin(before, list(joined)) | (now == 0)
    return NamedPlates(
        MappingProxyType(names),
        MappingProxyType(broke),
        MappingProxyType(joined),
        PlateMemory(np.where(kept, before, now).astype(np.int32), named),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PlateSightings:
    """The plates of one scan by name, and what happened to them since the scan before.

    Parameters
    ----------
    time : Instant
    plates : mapping of int to Plate
        By identity.
    broke_from, joined : mapping of int to int
        As `NamedPlates` has them.
    """

    time: Instant
    plates: Mapping[int, Plate]
    broke_from: Mapping[int, int]
    joined: Mapping[int, int]


def follow_plates(comparisons: Iterable[Comparison]) -> Iterator[PlateSightings]:
    """Follow plates through scans of one surface, each beside its baseline.

    Parameters
    ----------
    comparisons : iterable of Comparison
        In the order of time, on one grid.

    Yields
    ------
    PlateSightings
        One for each. A plate too small to be measured keeps its name and has no entry.
    """
    memory: PlateMemory | None = None
    for each in comparisons:
        labels, plates = find_plates(each, crack_mask(each.scan), crack_mask(each.baseline))
        named = name_plates(labels, memory)
        memory = named.memory
        by_name = {named.identity[plate.label]: plate for plate in plates}
        yield PlateSightings(each.scan.time, MappingProxyType(by_name), named.broke_from, named.joined)
