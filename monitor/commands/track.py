"""``microrelief track``: objects that move on a surface, followed through a store."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from configs import InputError
from pipelines import format_instant
from storage import Store, write_series

from ..following import following, scans_as_taken
from ..progress import progress

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
    capture_seconds: float | None = None,
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
    capture_seconds
        How long a capture takes: objects that moved by more than a cell meanwhile are flagged (`moved`). Left out:
        frames times exposure, where the store keeps frames.

    Examples
    --------
    microrelief track organisms.icechunk --out tracks.csv
    """
    from pipelines.change import ObjectRule, bare_substrate, follow_objects

    if not (least_height_mm > 0 and least_area_mm2 > 0):
        raise InputError("--least-height-mm and --least-area-mm2 must be above 0")
    if capture_seconds is not None and not capture_seconds > 0:
        raise InputError("--capture-seconds must be above 0")
    with following(store, 2, "and nothing is seen to move in fewer than two", out) as opened:
        with progress("learning the substrate") as step:
            bare = bare_substrate(scans_as_taken(opened, step))
        with progress("following objects") as step:
            takes = capture_seconds if capture_seconds is not None else _capture_seconds(opened)
            rule = ObjectRule(least_height_mm, least_area_mm2)
            found = list(follow_objects(scans_as_taken(opened, step), bare, rule, capture_s=takes))
    table = _table(found)
    write_series(table, out)
    names = table["identity"].nunique()
    first, last = format_instant(found[0].time), format_instant(found[-1].time)
    print(f"{names} objects in {len(found)} scans, {first} to {last}")
    if takes is None:
        print("how long a capture takes is not known (--capture-seconds): nothing says what moved during one")
    elif table["moved"].eq("yes").any():
        moved = table.loc[table["moved"] == "yes", "identity"].nunique()
        print(f"{moved} objects moved by more than a cell during a capture: do not trust their shapes then")
    print(f"wrote {out}: {len(table)} rows")
    return 0


def _capture_seconds(store: Store) -> float | None:
    """Frames times exposure of the newest capture that is kept: the least that it can have taken."""
    frames = store.frames(len(store) - 1)
    if frames is None or not frames.exposure_ms > 0:  # NaN where nobody told
        return None
    return len(frames.stack) * frames.exposure_ms / 1000


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
            "moved": "" if seen.moved is None else ("yes" if seen.moved else "no"),
        }
        for sightings in found
        for seen in sightings.seen
    ]
    columns = ["time", "identity", "x", "y", "z", "speed", "area", "area_sigma", "volume", "volume_sigma"]
    table = pd.DataFrame(rows, columns=[*columns, "height", "length", "width", "touches", "moved"]).set_index("time")
    table.attrs["units"] = UNITS
    return table
