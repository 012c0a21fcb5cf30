"""Plates followed from scan to scan: a plate keeps its name while it shrinks, and one that breaks says into which."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

__all__ = ["NamedPlates", "PlateMemory", "name_plates"]

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

    Of all pairs of a plate and one of before, the one that shares most cells is matched first, and so on. A plate
    without a partner that shares a fifth of its area with one of before has broken off from it; a plate of before
    without a partner that now lies in another has joined it, and takes its name again when it parts.

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
    names, taken = {}, set()
    pairs = np.argwhere((shared > 0) & ((shared >= LEAST_SHARE * sizes[:, None]) | (shared >= LEAST_SHARE * then)))
    for label, one in sorted(pairs.tolist(), key=lambda pair: (-int(shared[pair[0], pair[1]]), pair)):
        if label not in names and one not in taken:
            names[label] = one
            taken.add(one)
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
