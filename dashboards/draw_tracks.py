"""Draws what moves on a surface, organisms say: each one's number and the path that it came, from `track`'s table."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from configs import InputError
from storage import ScanTable, Store, scan_table

from . import paths
from .draw_scan import set_times, to_pixels
from .palette import LABELS, LINES
from .scales import Scales

if TYPE_CHECKING:
    import pandas as pd
    import rerun as rr

__all__ = ["log_tracks", "read_tracks"]

TRAIL = 30
"""Places of a path that are drawn behind where an object is."""

_COLUMNS = ("identity", "x", "y", "z")


def read_tracks(file: Path, store: Store) -> pd.DataFrame:
    """Read what ``microrelief track`` wrote of a store.

    Returns
    -------
    DataFrame
        A row for each sighting, in the order of time: identity, x, y, z (mm) and the scan's number.

    Raises
    ------
    InputError
        If it is no such table, or of another store.
    """
    import pandas as pd

    try:
        table = pd.read_parquet(file).reset_index() if file.suffix.lower() == ".parquet" else pd.read_csv(file)
        table.columns = [re.sub(r" \[.*\]$", "", str(name)) for name in table.columns]
        times = pd.DatetimeIndex(pd.to_datetime(table["time"], utc=True)).tz_localize(None)
        found = table[list(_COLUMNS)]
    except (OSError, ValueError, KeyError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else "no table of paths"
        raise InputError(f"{file}: {why}: `microrelief track STORE --out {file.name}` writes one") from None
    scans = pd.DatetimeIndex(scan_table(store).times).get_indexer(times.as_unit("ns"))
    if not (scans >= 0).any():
        raise InputError(f"{file}: is of another store: none of its times is that of a scan in {store.about.location}")
    return found.assign(scan=scans)[scans >= 0].sort_values("scan")


def log_tracks(
    stream: rr.RecordingStream, tracks: pd.DataFrame, table: ScanTable, scales: Scales, numbers: Collection[int]
) -> None:
    """Log at some scans where the objects are and how they came there, in earlier scans too."""
    import rerun as rr

    scans = tracks["scan"].to_numpy()
    names = tracks["identity"].to_numpy(dtype=np.int64)
    places = tracks[["x", "y", "z"]].to_numpy(dtype=np.float64)
    behind: dict[int, list[int]] = {}
    for number in range(len(table)):
        here = np.flatnonzero(scans == number)
        for row in here:
            behind.setdefault(int(names[row]), []).append(int(row))
        if number not in numbers:
            continue
        trails = [behind[int(names[row])][-TRAIL:] for row in here]
        colours = [LINES[(int(names[row]) - 1) % len(LINES)] for row in here]
        labels = [str(names[row]) for row in here]
        set_times(stream, table.times[number], number)
        flat = [to_pixels(places[trail, 0], places[trail, 1], scales) for trail in trails]
        solid = [places[trail] for trail in trails]
        width, dot = rr.Radius.ui_points(1.5), rr.Radius.ui_points(3.0)
        stream.log(f"{paths.MAP_PATHS}/trails", rr.LineStrips2D(flat, colors=colours, radii=width))
        stream.log(
            f"{paths.MAP_PATHS}/here",
            # their names under the pointer: all of them would hide the map
            rr.Points2D([each[-1] for each in flat], colors=colours, labels=labels, radii=dot, show_labels=False),
        )
        stream.log(f"{paths.SURFACE_PATHS}/trails", rr.LineStrips3D(solid, colors=colours, radii=width))
        stream.log(
            f"{paths.SURFACE_PATHS}/here",
            rr.Points3D([each[-1] for each in solid], colors=colours, radii=dot),
        )
        stream.log(
            f"{paths.SURFACE_PATHS}/names",
            rr.Points3D([each[-1] for each in solid], colors=[LABELS], labels=labels, radii=0.0, show_labels=True),
        )
