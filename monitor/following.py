"""A store opened to follow something through its scans: what is asked of it, and the scans one after another."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import Scan
from pipelines.change import Comparison
from storage import Store, open_store, write_series

from .outputs import check_table
from .progress import Progress

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["compared_scans", "counted_cells", "following", "give", "laid_scans", "scans_as_taken"]

Found = TypeVar("Found")


@contextmanager
def following(path: Path, least: int, why: str, out: Path | None = None) -> Iterator[Store]:
    """Open a store of so many scans or more, and close it; `out` is the table that is to come of it.

    Raises
    ------
    InputError
        If there is no such store, or it holds fewer (`why` says what cannot be done then), or the table's name or
        folder is none: told before the work, not after it.
    """
    if out is not None:
        check_table(out)
    opened = open_store(path)
    try:
        if len(opened) < least:
            held = {0: "no scan yet", 1: "1 scan"}.get(len(opened), f"{len(opened)} scans")
            raise InputError(f"{path}: holds {held}, {why}")
        yield opened
    finally:
        opened.close()


def counted_cells(store: Store) -> npt.NDArray[np.bool_] | None:
    """Cells of the campaign's region, less its stable areas: a frame's seams are no cracks; None for all."""
    from .reprocess import campaign_of, rules_of

    rules = rules_of(campaign_of(store), store)
    if rules.stable is None:
        return rules.region
    return ~rules.stable if rules.region is None else rules.region & ~rules.stable


def scans_as_taken(store: Store, step: Progress) -> Iterator[Scan]:
    """Give the scans of a store as they were taken: what creeps over all of a surface would pull its motion along."""
    for number in range(len(store)):
        yield store[number].scan
        step(number + 1, len(store))


def laid_scans(store: Store, step: Progress) -> Iterator[Scan]:
    """Give the scans of a store, each moved onto its baseline."""
    from pipelines.change import apply_motion

    for number in range(len(store)):
        stored = store[number]
        yield stored.scan if stored.change is None else apply_motion(stored.scan, stored.change.motion)
        step(number + 1, len(store))


def compared_scans(store: Store, step: Progress) -> Iterator[Comparison]:
    """Give each scan beside its baseline, as the store's motion lays it; not baselines, nor failed registrations."""
    from pipelines.change import apply_motion, difference

    region = counted_cells(store)
    at, baseline = -1, None
    for number in range(len(store)):
        stored = store[number]
        if stored.change is not None and stored.change.motion.verdict != "failed":
            if baseline is None or stored.baseline != at:
                at, baseline = stored.baseline, store[stored.baseline].scan
            counts = np.ones(baseline.grid.shape, dtype=np.bool_) if region is None else region
            moved, motion = apply_motion(stored.scan, stored.change.motion), stored.change.motion
            change = difference(moved, baseline, motion, store.about.noise)
            yield Comparison(baseline, moved, change, ~counts, counts, store.about.noise)
        step(number + 1, len(store))


def give(
    found: Found,
    out: Path | None,
    *,
    as_json: bool,
    table: Callable[[Found], pd.DataFrame],
    mapping: Callable[[Found], object],
    lines: Callable[[Found], list[str]],
) -> None:
    """Write what was followed as a table where that is wanted, and print it: as JSON, or in words."""
    rows = None
    if out is not None:
        rows = table(found)
        write_series(rows, out)
    if as_json:
        print(json.dumps(mapping(found), indent=1))
        return
    print("\n".join(lines(found)))
    if rows is not None:
        print(f"wrote {out}: {len(rows)} rows")
