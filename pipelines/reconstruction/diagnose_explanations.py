"""Explanations of a wrong order: which frame each role would have, and which other set may have been projected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np
import numpy.typing as npt

from .patterns import PAPER_STRIPES, PatternSet

__all__ = ["difference", "exchange", "other_sets", "shifted", "swap", "with_extra", "without"]

Ints = npt.NDArray[np.int64]
"""Frame of each role, -1 where it has none."""


def without(roles: int, lost: int) -> Ints:
    """Frames of a stack from which one is missing and the others closed up."""
    mapping = np.arange(roles)
    mapping[lost:] -= 1
    mapping[lost] = -1
    return mapping


def with_extra(roles: int, extra: int) -> Ints:
    """Frames of a stack into which a strange one has come."""
    mapping = np.arange(roles)
    mapping[extra:] += 1
    return mapping


def shifted(roles: int, shift: int) -> Ints:
    """Frames of a stack that began too early or too late."""
    mapping = np.arange(roles) + shift
    mapping[(mapping < 0) | (mapping >= roles)] = -1
    return mapping


def swap(roles: int, a: int, b: int) -> Ints:
    """Two frames have changed places."""
    mapping = np.arange(roles)
    mapping[[a, b]] = b, a
    return mapping


def exchange(roles: int, one: tuple[str, int, int, int], other: tuple[str, int, int, int]) -> Ints:
    """Two pairs of a pattern and its inverse have changed places."""
    mapping = swap(roles, one[2], other[2])
    mapping[[one[3], other[3]]] = other[3], one[3]
    return mapping


def other_sets(patterns: PatternSet) -> Iterator[PatternSet]:
    """Sets that people mix up with this one."""
    kinds = [patterns]
    if patterns.kind == "gray":
        kinds.append(replace(patterns, offset="none" if patterns.offset == "centred" else "centred"))
        needed = tuple((length - 1).bit_length() for length in patterns.size)
        if set(patterns.bits) <= {0, len(PAPER_STRIPES)} and min(patterns.size) >= max(PAPER_STRIPES):
            kinds.append(replace(patterns, kind="stripes", offset="none"))
    elif patterns.kind == "stripes":
        needed = tuple((length - 1).bit_length() for length in patterns.size)
        if all(bits in (0, need) for bits, need in zip(patterns.bits, needed, strict=True)):
            gray = replace(patterns, kind="gray", counts=())
            kinds += [gray, replace(gray, offset="centred")]
    for kind in kinds:
        for order in permutations(patterns.order):
            for msb_first in (True, False):
                other = replace(kind, order=order, msb_first=msb_first)
                if other != patterns:
                    yield other


def difference(patterns: PatternSet, own: PatternSet) -> str:
    """Say in which fields of the pattern file a set differs."""
    theirs, ours = patterns.as_mapping(), own.as_mapping()
    return ", ".join(
        f"{key}: {value}".lower() if isinstance(value, bool) else f"{key}: {value}"
        for key, value in theirs.items()
        if ours.get(key) != value and key != "counts"
    ).replace("'", "")
