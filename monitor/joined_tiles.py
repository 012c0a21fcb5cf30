"""Joined tiles: the largest part of an area that hangs together by its overlaps, and what is left out of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipelines import Scan
from pipelines.reconstruction import Placement, place_tiles

from .stage_axes import in_site
from .stitching import LonelyTileError, Stitched, stitch

__all__ = ["Joined", "join"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Tiles that hang together.

    Parameters
    ----------
    members : tuple of int
        Their numbers.
    placement : Placement
        Of the members, in their order.
    left_out : mapping of int to str
        The other tiles, each with its reason.
    doubts : str
        What there is to say of the members' overlaps; empty where all is well.
    """

    members: tuple[int, ...]
    placement: Placement
    left_out: Mapping[int, str] = field(default_factory=dict)
    doubts: str = ""


def join(
    scans: Sequence[Scan],
    names: Sequence[str],
    stage_mm: Floats,
    *,
    axes: tuple[str, str],
    stage_sigma_mm: float,
    bow_mm: float,
) -> Joined:
    """Register neighbours, and keep the largest part that this joins.

    The stage tells a tile's place to `stage_sigma_mm`, but its height hardly: a tile that nothing joins to the others
    would be a step in every change.

    Parameters
    ----------
    scans : sequence of Scan
        At least one.
    names : sequence of str
    stage_mm : ndarray of float64, shape (tiles, 3)
        Where the stage said that it stood, in its own axes.
    axes : (str, str)
        How these lie, a key of `ORIENTATIONS`.
    stage_sigma_mm, bow_mm : float
        As `stitch` takes them.
    """
    members, left_out = list(range(len(scans))), dict[int, str]()
    while len(members) > 1:
        these = [scans[number] for number in members]
        try:
            found = stitch(these, stage_mm[members], axes=axes, stage_sigma_mm=stage_sigma_mm, bow_mm=bow_mm)
        except LonelyTileError as error:
            left_out[members.pop(error.number)] = "it overlaps no other tile that was taken"
            continue
        group = found.placement.group
        most = group == np.bincount(group).argmax()
        if most.all():
            return Joined(tuple(members), found.placement, left_out, _doubts(found, [names[k] for k in members]))
        left_out |= {
            k: "no overlap joins it to the others" for k, stays in zip(members, most, strict=True) if not stays
        }
        members = [k for k, stays in zip(members, most, strict=True) if stays]
    alone = place_tiles(in_site(stage_mm[members], axes), [], (stage_sigma_mm,) * 3)
    return Joined(tuple(members), alone, left_out)


def _doubts(found: Stitched, names: Sequence[str]) -> str:
    """How many overlaps were used with care, or not at all, and one of them with its reason."""
    told = found.doubts(names)
    count = len(found.offsets) + len(found.failed)
    return f"{len(told)} of {count} overlaps are doubtful, such as {told[0]}" if told else ""
