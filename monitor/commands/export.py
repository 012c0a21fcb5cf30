"""``microrelief export``: a stored scan, its change, or the series as a file for other programs."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from configs import InputError
from pipelines import format_instant, parse_instant
from storage import Store, open_store, write_change, write_height_map, write_series

__all__ = ["export", "nearest_scan"]


def export(
    store: str,
    *,
    scan: str | None = None,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    change: Annotated[bool, Parameter(negative="")] = False,
    series: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Write a stored scan, its change since the baseline, or all metrics as a file.

    A scan or a change becomes .npz, .nc (CF-1.11, mm), .tif (GeoTIFF, metres), .ply (mesh, mm), .las (cloud, metres),
    .gsf (Gwyddion) or .x3p (ISO 25178-72); the series .csv or .parquet.

    Parameters
    ----------
    store
        The store's folder or address.
    scan
        Number of the scan (-1 is the newest), or a time: the scan nearest to it.
    out
        The file; its suffix says as what.
    change
        Write what changed since the baseline instead of the heights.
    series
        Write the metrics of all scans.

    Examples
    --------
    microrelief export site.icechunk --scan -1 --out newest.tif
    microrelief export site.icechunk --series --out series.csv
    """
    if series and (change or scan is not None):
        raise InputError("--series is of all scans: leave --scan and --change out")
    if not series and scan is None:
        raise InputError("--scan is missing: a number or a time, or give --series")
    with closing(open_store(store)) as opened:
        if not len(opened):
            raise InputError(f"{store}: holds no scan yet")
        if series:
            table = opened.series()
            write_series(table, out)
            print(f"wrote {out}: {len(table)} scans, {', '.join(opened.about.metrics) or 'no metric'}")
            return
        assert scan is not None
        stored = opened[nearest_scan(opened, scan, f"--scan {scan}")]
        when = format_instant(stored.scan.time)
        if not change:
            write_height_map(stored.scan, out)
        elif stored.change is None:
            raise InputError(f"--scan {scan}: scan {stored.number} is a baseline, it has no change")
        else:
            write_change(stored.change, stored.scan.time, out)
        print(f"wrote {out}: {'change at ' if change else ''}scan {stored.number} of {when}")


def nearest_scan(store: Store, text: str, said: str) -> int:
    """Give the number that a text says, or that of the scan nearest to its time; `said` is how the user wrote it."""
    count = len(store)
    if text.removeprefix("-").isdecimal():
        number = int(text)
        if not -count <= number < count:
            raise InputError(f"{said}: there is no such scan, the newest is {count - 1}")
        return number % count
    try:
        moment = parse_instant(text)
    except ValueError as error:
        raise InputError(f"{said}: {error}, or give a number") from None
    return int(np.argmin(np.abs(store.window()["time"].values - moment)))
