"""Cracks and plates followed through a review: found on coarse cells, named as before, kept from day to day."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pipelines import Grid, Scan
from storage import Stored

from .places import Places
from .raster import block_mean, shrink_factor

if TYPE_CHECKING:
    from pipelines.change import Change, CrackHistory, CrackLine, CrackSighting, Plate, PlateMemory

__all__ = ["Followed", "Sights", "follow", "keep", "looks_for", "remember"]

Mask = npt.NDArray[np.bool_]

MOST_CELLS = 160_000
"""Cracks are looked for on so many cells at most: an eighth of a second of a processor's time."""


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """What was seen before a scan: a value, from which the next one goes on.

    `baseline`, with its number and its cracks, spares the reading of it with every scan; it is not kept between days.
    """

    cracks: CrackHistory | None = None
    plates: PlateMemory | None = None
    baseline: tuple[int, Scan, Mask] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Cracks and plates of one scan.

    Parameters
    ----------
    scan : Scan
        The coarse one on which they were found, moved onto its baseline.
    cracks : tuple of CrackSighting
    lines : tuple of CrackLine
    plates : mapping of int to Plate
        By name; those whose lift could be measured.
    cells : ndarray of int32, shape (rows, columns)
        Label of the plate that each cell is of, as `Plate.label`.
    """

    scan: Scan
    cracks: tuple[CrackSighting, ...]
    lines: tuple[CrackLine, ...]
    plates: Mapping[int, Plate] = field(default_factory=lambda: MappingProxyType({}))
    cells: npt.NDArray[np.int32] | None = None


def looks_for(metrics: Mapping[str, str]) -> tuple[bool, bool]:
    """Whether a campaign looks for cracks, and for plates that curl: for what its metrics are about."""
    plates = any(name.startswith(("edge_lift", "plate_", "curl_")) for name in metrics)
    return plates or any(name.startswith("crack_") for name in metrics), plates


def follow(
    stored: Stored, baseline: Stored | None, before: Followed, places: Places, *, plates: bool
) -> tuple[Sights, Followed]:
    """Find the cracks and plates of one more scan.

    Parameters
    ----------
    stored : Stored
    baseline : Stored, optional
        What it was compared with; only looked at where `before` does not hold it.
    before : Followed
        Of the scans before, in their order.
    places : Places
        The campaign's: cracks are looked for in what counts, not in the seams of a frame.
    plates : bool
        Whether to look for plates.
    """
    from pipelines.change import Comparison, apply_motion, crack_mask, find_plates, name_plates, next_cracks

    grid = stored.scan.grid
    factor = shrink_factor(grid.rows, grid.columns, MOST_CELLS)
    scan = _coarse(stored.scan, factor)
    here = places.counted_cells(scan.grid) if places.named else None
    change = stored.change
    if change is not None:
        scan = apply_motion(scan, change.motion)
    found = next_cracks(scan, before.cracks, region=here)
    after = replace(before, cracks=found.history)
    if not plates or change is None:
        return Sights(scan, found.cracks, found.lines), after
    known = before.baseline
    if known is None or known[0] != stored.baseline:
        assert baseline is not None
        then = _coarse(baseline.scan, factor)
        known = (stored.baseline, then, crack_mask(then))
    inside = np.ones(scan.grid.shape, dtype=np.bool_) if here is None else here
    moved = _coarse_change(change, scan.grid, factor)
    comparison = Comparison(known[1], scan, moved, ~inside, inside)
    cells, measured = find_plates(comparison, found.identities > 0, known[2])
    memory = before.plates
    if memory is not None and memory.identity is not None and memory.identity.shape != cells.shape:
        memory = None  # another grid: another epoch, whose plates have other names
    named = name_plates(cells, memory)
    by_name = {named.identity[plate.label]: plate for plate in measured}
    sights = Sights(scan, found.cracks, found.lines, MappingProxyType(dict(sorted(by_name.items()))), cells)
    return sights, replace(after, plates=named.memory, baseline=known)


def keep(followed: Followed, file: Path) -> None:
    """Write what the next day needs."""
    arrays: dict[str, npt.NDArray[np.generic]] = {}
    about: dict[str, object] = {}
    if followed.cracks is not None:
        memory = followed.cracks.memory
        arrays |= {"places": memory.places, "identity": memory.identity, "junctions": memory.junctions}
        about |= {
            "length_mm": sorted(memory.length_mm.items()),
            "contacts": sorted(memory.contacts),
            "named": memory.named,
            "parent": sorted(followed.cracks.parent.items()),
        }
    if followed.plates is not None and followed.plates.identity is not None:
        arrays["plates"] = followed.plates.identity
        about["plates_named"] = followed.plates.named
    arrays["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    with file.open("wb") as out:
        np.savez_compressed(out, **arrays)  # type: ignore[arg-type] # its stub takes a keyword for an array


def remember(file: Path) -> Followed:
    """Read what `keep` wrote, all but the tips of cracks; OSError, ValueError or KeyError of another file."""
    from pipelines.change import CrackHistory, CrackMemory, PlateMemory

    with np.load(file, allow_pickle=False) as kept:
        about = json.loads(kept["about"].tobytes())
        cracks = plates = None
        if "places" in kept:
            memory = CrackMemory(
                kept["places"],
                kept["identity"].astype(np.intp),
                MappingProxyType({int(one): float(length) for one, length in about["length_mm"]}),
                frozenset((int(a), int(b)) for a, b in about["contacts"]),
                kept["junctions"],
                int(about["named"]),
            )
            parent = MappingProxyType({int(one): int(other) for one, other in about["parent"]})
            cracks = CrackHistory(memory, parent=parent)
        if "plates" in kept:
            plates = PlateMemory(kept["plates"].astype(np.int32), int(about["plates_named"]))
    return Followed(cracks, plates)


def _coarse(scan: Scan, factor: int) -> Scan:
    if factor == 1:
        return scan
    grid = scan.grid
    height = block_mean(scan.height, factor)
    coarse = Grid(
        height.shape[0],
        height.shape[1],
        grid.pitch_mm * factor,
        grid.x0_mm + (factor - 1) / 2 * grid.pitch_mm,
        grid.y0_mm + (factor - 1) / 2 * grid.pitch_mm,
    )
    level = np.where(np.isfinite(height), scan.level[::factor, ::factor], 255).astype(np.uint8)
    texture = np.ascontiguousarray(scan.texture[::factor, ::factor])
    # neighbouring cells share their errors: a mean of a few is hardly better than one of them
    sigma = np.where(np.isfinite(height), block_mean(scan.sigma, factor), np.nan).astype(np.float32)
    return Scan(coarse, scan.time, height, sigma, texture, level, scan.calibration_id)


def _coarse_change(change: Change, grid: Grid, factor: int) -> Change:
    if factor == 1:
        return change
    dz, lod = block_mean(change.dz, factor), block_mean(change.lod, factor)
    return replace(change, grid=grid, dz=dz, lod=np.where(np.isfinite(dz), lod, np.nan).astype(np.float32))
