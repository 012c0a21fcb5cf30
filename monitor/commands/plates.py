"""``microrelief plates``: every plate between cracks by name through a store: how it curls, and from which it broke."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from configs import InputError
from pipelines import format_instant

from ..following import compared_scans, following, give
from ..progress import progress

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.change import PlateSightings

__all__ = ["plates"]

UNITS = {"x": "mm", "y": "mm", "area": "mm2", "lift": "mm", "angle": "degree", "curvature": "mm-1", "edge_seen": "1"}


def plates(
    store: Path,
    *,
    out: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Follow every plate by name through a store: lift, angle and curvature of its rim, and what breaks.

    Plates are the parts of the campaign's region that cracks divide. Each scan is laid on its baseline as the store
    says. A plate keeps its number while it shares most of its cells with itself before. Writes one row for each plate
    in each scan, with standard uncertainties; prints the plates of the last scan, and which broke or joined.

    Parameters
    ----------
    store
        The store's folder.
    out
        File for the table: .csv or .parquet.
    as_json
        Print JSON: scans, plates of the last scan, events.

    Examples
    --------
    microrelief plates soil.icechunk --out plates.csv
    microrelief plates soil.icechunk --json
    """
    from pipelines.change import follow_plates

    with (
        following(store, 2, "and a plate has curled only against a scan before", out) as opened,
        progress("following plates") as step,
    ):
        found = list(follow_plates(compared_scans(opened, step)))
    if not found:
        raise InputError(f"{store}: no scan was laid on a baseline, so there is no plate to follow")
    give(found, out, as_json=as_json, table=_table, mapping=_mapping, lines=_lines)
    return 0


def _rows(scan: PlateSightings) -> list[dict[str, Any]]:
    rows = []
    for identity, plate in sorted(scan.plates.items()):
        row: dict[str, Any] = {"identity": identity, "x": plate.x_mm, "y": plate.y_mm}
        for name in ("area", "lift", "angle", "curvature"):
            measured = getattr(plate, name)
            row |= {name: measured.value, f"{name}_sigma": measured.sigma}
        rows.append(row | {"edge_cells": plate.edge_cells, "edge_seen": plate.edge_seen})
    return rows


def _table(found: list[PlateSightings]) -> pd.DataFrame:
    import pandas as pd

    origin: dict[int, int] = {}
    rows = []
    for scan in found:
        origin |= scan.broke_from
        for row in _rows(scan):
            broke = origin.get(row["identity"])
            rows.append({"time": scan.time} | row | {"from": "" if broke is None else str(broke)})
    columns = ["time", "identity"] if not rows else list(rows[0])
    table = pd.DataFrame(rows, columns=columns).set_index("time")
    table.attrs["units"] = UNITS
    return table


def _events(found: list[PlateSightings]) -> list[dict[str, Any]]:
    return [
        {"time": format_instant(scan.time), "event": kind, "plate": one, "other": other}
        for scan in found
        for kind, pairs in (("broke", scan.broke_from), ("joined", scan.joined))
        for one, other in sorted(pairs.items())
    ]


def _mapping(found: list[PlateSightings]) -> dict[str, Any]:
    def known(value: Any) -> Any:
        return None if isinstance(value, float) and math.isnan(value) else value

    last = [{name: known(value) for name, value in row.items()} for row in _rows(found[-1])]
    return {
        "scans": len(found),
        "last": format_instant(found[-1].time),
        "plates": last,
        "events": _events(found),
        "units": UNITS,
    }


def _lines(found: list[PlateSightings]) -> list[str]:
    last = found[-1]
    span = f"{format_instant(found[0].time)} to {format_instant(last.time)}"
    lines = [f"{len(last.plates)} plates in the last of {len(found)} compared scans, {span}"]
    if last.plates:
        lines.append("  plate  area mm2        lift um     angle deg  curvature 1/mm  rim seen")
    for identity, plate in sorted(last.plates.items()):
        lift = f"{1000 * plate.lift.value:.1f} ± {1000 * plate.lift.sigma:.1f}"
        angle = f"{plate.angle.value:.2f} ± {plate.angle.sigma:.2f}"
        lines.append(
            f"  {identity:5d}  {plate.area.value:8.2f}  {lift:>13}  {angle:>12}  {plate.curvature.value:14.4f}  "
            f"{100 * plate.edge_seen:6.0f} %"
        )
    said = {"broke": "plate {plate} broke from {other}", "joined": "plate {plate} is not told from {other}"}
    return [*lines, *(f"{event['time']}  {said[event['event']].format(**event)}" for event in _events(found))]
