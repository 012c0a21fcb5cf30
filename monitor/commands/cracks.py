"""``microrelief cracks``: every crack by name through a store: how long, wide and deep, and how fast its tips go."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from pipelines import format_instant

from ..following import counted_cells, following, give, laid_scans
from ..progress import progress

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.change import CrackSighting, CrackSightings

__all__ = ["cracks"]

TIPS = 2
"""Tips that the table has columns for; JSON has all."""
UNITS = {
    "length": "mm",
    "width": "mm",
    "width_p95": "mm",
    "width_max": "mm",
    "widest_x": "mm",
    "widest_y": "mm",
    "depth": "mm",
    "area": "mm2",
    "area_fraction": "1",
    "volume": "mm3",
    "seen": "1",
} | {
    f"tip{n}_{name}": unit
    for n in range(1, TIPS + 1)
    for name, unit in {"x": "mm", "y": "mm", "advance": "mm", "speed": "mm/h"}.items()
}


def cracks(
    store: Path,
    *,
    out: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Follow every crack by name through a store: growth, branching, merging.

    Each scan is laid on its baseline as the store says, and cracks are looked for in the campaign's region. A crack
    keeps its number in all scans. Writes one row for each crack in each scan: length, width (mean, 95 %, greatest and
    where), depth and volume (at least: where the floor was seen, the share of which is told), area, and its tips with
    their speeds. Prints each crack as it is in the last scan, and what happened: branched, met, merged.

    Parameters
    ----------
    store
        The store's folder.
    out
        File for the table: .csv or .parquet.
    as_json
        Print JSON: scans, cracks of the last scan, events.

    Examples
    --------
    microrelief cracks soil.icechunk --out cracks.csv
    microrelief cracks soil.icechunk --json
    """
    from pipelines.change import follow_cracks

    with following(store, 1, "so there is no crack to follow", out) as opened, progress("following cracks") as step:
        region = counted_cells(opened)
        found = [_told(sightings) for sightings in follow_cracks(laid_scans(opened, step), region=region)]
    give(found, out, as_json=as_json, table=_table, mapping=_mapping, lines=_lines)
    return 0


def _told(sightings: CrackSightings) -> dict[str, Any]:
    """What is kept of one scan: no arrays of cells, which thousands of scans would fill the memory with."""
    return {
        "time": sightings.time,
        "cracks": sightings.cracks,
        "events": [
            {"time": format_instant(sightings.time), "event": event.kind, "crack": event.identity, "other": event.other}
            for event in sightings.events
        ],
    }


def _row(crack: CrackSighting) -> dict[str, Any]:
    size = crack.size
    row: dict[str, Any] = {"identity": crack.identity}
    for name in ("length", "width", "depth", "area", "volume"):
        measured = getattr(size, name)
        row |= {name: measured.value, f"{name}_sigma": measured.sigma}
    return row | {
        "width_p95": size.width_p95_mm,
        "width_max": size.width_max_mm,
        "widest_x": size.widest_mm[0],
        "widest_y": size.widest_mm[1],
        "area_fraction": size.area_fraction,
        "seen": size.seen,
    }


def _table(found: list[dict[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for scan in found:
        into = {event["crack"]: event["other"] for event in scan["events"] if event["event"] == "merged"}
        for crack in scan["cracks"]:
            row = {"time": scan["time"]} | _row(crack)
            tips = {tip.number: tip for tip in crack.tips}
            for n in range(1, TIPS + 1):
                tip = tips.get(n)
                row |= {
                    f"tip{n}_x": tip.x_mm if tip else math.nan,
                    f"tip{n}_y": tip.y_mm if tip else math.nan,
                    f"tip{n}_advance": tip.advance.value if tip else math.nan,
                    f"tip{n}_advance_sigma": tip.advance.sigma if tip else math.nan,
                    f"tip{n}_speed": tip.speed.value if tip else math.nan,
                    f"tip{n}_speed_sigma": tip.speed.sigma if tip else math.nan,
                }
            row["from"] = "" if crack.branched_from is None else str(crack.branched_from)
            row["took_in"] = " ".join(str(one) for one, other in sorted(into.items()) if other == crack.identity)
            row["meets"] = " ".join(map(str, crack.meets))
            rows.append(row)
    columns = ["time", "identity"] if not rows else list(rows[0])
    table = pd.DataFrame(rows, columns=columns).set_index("time")
    table.attrs["units"] = UNITS
    return table


def _mapping(found: list[dict[str, Any]]) -> dict[str, Any]:
    def known(value: Any) -> Any:
        return None if isinstance(value, float) and math.isnan(value) else value

    last = [
        {name: known(value) for name, value in _row(crack).items()}
        | {
            "tips": [
                {
                    "tip": tip.number,
                    "x": tip.x_mm,
                    "y": tip.y_mm,
                    "sigma": tip.sigma_mm,
                    "speed": known(tip.speed.value),
                }
                for tip in crack.tips
            ],
            "from": crack.branched_from,
            "meets": list(crack.meets),
        }
        for crack in found[-1]["cracks"]
    ]
    return {
        "scans": len(found),
        "last": format_instant(found[-1]["time"]),
        "cracks": last,
        "events": [event for scan in found for event in scan["events"]],
        "units": UNITS,
    }


def _lines(found: list[dict[str, Any]]) -> list[str]:
    last = found[-1]
    span = f"{format_instant(found[0]['time'])} to {format_instant(last['time'])}"
    lines = [f"{len(last['cracks'])} cracks in the last of {len(found)} scans, {span}"]
    if last["cracks"]:
        lines.append("  crack  length mm  width mm  widest mm  depth mm  volume mm3  floor seen  tips")
    for crack in last["cracks"]:
        size = crack.size
        tips = ", ".join(
            f"({tip.x_mm:.2f}, {tip.y_mm:.2f})"
            + ("" if math.isnan(tip.speed.value) else f" {1000 * tip.speed.value:+.0f} um/h")
            for tip in crack.tips
        )
        lines.append(
            f"  {crack.identity:5d}  {size.length.value:9.2f}  {size.width.value:8.3f}  {size.width_max_mm:9.3f}  "
            f"{size.depth.value:8.3f}  {size.volume.value:10.4f}  {100 * size.seen:8.0f} %  {tips}".rstrip()
        )
    said = {
        "began": "crack {crack} began",
        "branched": "crack {crack} branched from {other}",
        "met": "crack {crack} met {other}",
        "merged": "crack {crack} merged into {other}",
    }
    events = (event for scan in found for event in scan["events"])
    return [*lines, *(f"{event['time']}  {said[event['event']].format(**event)}" for event in events)]
