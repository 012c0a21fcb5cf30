"""``microrelief track``: objects that move on a surface, followed through a store."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from configs import InputError
from pipelines import Scan, format_instant
from storage import Store, open_store, write_series

from ..progress import Progress, progress

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.change import Sightings

__all__ = ["track"]

UNITS = {
    "x": "mm",
    "y": "mm",
    "z": "mm",
    "speed": "mm/s",
    "area": "mm2",
    "volume": "mm3",
    "height": "mm",
    "length": "mm",
    "width": "mm",
}


def track(
    store: Path,
    *,
    out: Path,
    least_height_mm: float = 0.05,
    least_area_mm2: float = 0.03,
) -> int:
    """Follow what moves on a surface, organisms on a substrate say: who is where, how fast, how large.

    Writes one row for each object in each scan: its identity, middle, speed, footprint, volume above the substrate with
    standard uncertainty, axes, and the identities of those it touches. The substrate is learned first, from the scans
    themselves: everything must have moved by its own length in them.

    Parameters
    ----------
    store
        The store's folder.
    out
        File for the table: .csv or .parquet.
    least_height_mm
        What rises less above the substrate is no object.
    least_area_mm2
        Nor is what covers less.

    Examples
    --------
    microrelief track organisms.icechunk --out tracks.csv
    """
    from pipelines.change import ObjectRule, bare_substrate, follow_objects

    if not (least_height_mm > 0 and least_area_mm2 > 0):
        raise InputError("--least-height-mm and --least-area-mm2 must be above 0")
    opened = open_store(store)
    try:
        if len(opened) < 2:
            raise InputError(f"{store}: holds {len(opened)} scans, and nothing is seen to move in fewer than two")
        with progress("learning the substrate") as step:
            bare = bare_substrate(_scans(opened, step))
        with progress("following objects") as step:
            found = list(follow_objects(_scans(opened, step), bare, ObjectRule(least_height_mm, least_area_mm2)))
    finally:
        opened.close()
    table = _table(found)
    write_series(table, out)
    names = table["identity"].nunique()
    first, last = format_instant(found[0].time), format_instant(found[-1].time)
    print(f"{names} objects in {len(found)} scans, {first} to {last}")
    print(f"wrote {out}: {len(table)} rows")
    return 0


def _scans(store: Store, step: Progress) -> Iterator[Scan]:
    for number in range(len(store)):
        yield store[number].scan
        step(number + 1, len(store))


def _table(found: list[Sightings]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {
            "time": sightings.time,
            "identity": seen.identity,
            "x": seen.object.x_mm,
            "y": seen.object.y_mm,
            "z": seen.object.z_mm,
            "speed": seen.speed_mm_s,
            "area": seen.object.area_mm2.value,
            "area_sigma": seen.object.area_mm2.sigma,
            "volume": seen.object.volume_mm3.value,
            "volume_sigma": seen.object.volume_mm3.sigma,
            "height": seen.object.height_mm,
            "length": seen.object.length_mm,
            "width": seen.object.width_mm,
            "touches": " ".join(map(str, seen.touches)),
        }
        for sightings in found
        for seen in sightings.seen
    ]
    columns = ["time", "identity", "x", "y", "z", "speed", "area", "area_sigma", "volume", "volume_sigma"]
    table = pd.DataFrame(rows, columns=[*columns, "height", "length", "width", "touches"]).set_index("time")
    table.attrs["units"] = UNITS
    return table
