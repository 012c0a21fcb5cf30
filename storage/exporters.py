"""Height maps, changes, point clouds and series as files for other programs; the suffix says which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from configs import InputError
from pipelines import Change, Instant, PointMap, Scan, format_instant

from .durable import whole_file
from .export_clouds import las, mesh, points_ply
from .export_grids import change_netcdf, change_npz, geotiff, gsf, netcdf, npz, x3p
from .exported import Exported, of_change, of_scan

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "CHANGE_WRITERS",
    "HEIGHT_MAP_WRITERS",
    "POINT_WRITERS",
    "SERIES_WRITERS",
    "write_change",
    "write_height_map",
    "write_points",
    "write_series",
]


def write_height_map(scan: Scan, file: str | Path) -> None:
    """Write a height map; the suffix says as what.

    ``.npz``, ``.nc`` (CF-1.11), ``.tif`` (GeoTIFF, metres), ``.ply`` (mesh, mm), ``.las`` (1.2, metres), ``.gsf``
    (Gwyddion) or ``.x3p`` (ISO 25178-72). The file appears whole or not at all.

    Raises
    ------
    InputError
        If the suffix is none of these, or the folder does not exist.
    """
    _write(HEIGHT_MAP_WRITERS, Path(file), "a height map", scan)


def write_change(change: Change, time: Instant, file: str | Path) -> None:
    """Write a change in the formats of a height map; ``.npz`` and ``.nc`` name it `dz`, with its `lod`.

    Raises
    ------
    InputError
        If the suffix is none of these, or the folder does not exist.
    """
    _write(CHANGE_WRITERS, Path(file), "a change", change, time)


def write_points(points: PointMap, file: str | Path) -> None:
    """Write a point map as ``.npz`` (every camera pixel) or ``.ply`` (the measured points, mm, camera frame).

    Raises
    ------
    InputError
        If the suffix is neither, or the folder does not exist.
    """
    _write(POINT_WRITERS, Path(file), "points", points)


def write_series(series: pd.DataFrame, file: str | Path) -> None:
    """Write a store's series as ``.csv`` (units in the header) or ``.parquet`` (units in its metadata).

    Raises
    ------
    InputError
        If the suffix is neither, or the folder does not exist.
    """
    _write(SERIES_WRITERS, Path(file), "a series", series)


def _write(writers: dict[str, Callable[..., None]], file: Path, name: str, *what: Any) -> None:
    writer = writers.get(file.suffix.lower())
    if writer is None:
        raise InputError(f"{file}: {name} cannot be written as {file.suffix!r}: choose one of {', '.join(writers)}")
    with whole_file(file) as temporary:
        writer(*what, temporary)


def _scan_as(writer: Callable[[Exported, Path], None]) -> Callable[[Scan, Path], None]:
    return lambda scan, file: writer(of_scan(scan), file)


def _change_as(writer: Callable[[Exported, Path], None]) -> Callable[[Change, Instant, Path], None]:
    return lambda change, time, file: writer(of_change(change, time), file)


def _points_npz(points: PointMap, file: Path) -> None:
    np.savez_compressed(file, **asdict(points))


def _csv(series: pd.DataFrame, file: Path) -> None:
    units = series.attrs.get("units", {})
    named: dict[str, str] = {}
    for name, unit in units.items():
        named |= {name: f"{name} [{unit}]", f"{name}_sigma": f"{name}_sigma [{unit}]"}
    out = series.rename(columns=named)
    out.index = out.index.map(lambda moment: format_instant(moment.to_datetime64().astype("datetime64[ns]")))
    out.to_csv(file, index_label="time", lineterminator="\n")


def _parquet(series: pd.DataFrame, file: Path) -> None:
    series.to_parquet(file, engine="pyarrow")


PLAIN_WRITERS: dict[str, Callable[[Exported, Path], None]] = {
    ".tif": geotiff,
    ".tiff": geotiff,
    ".ply": mesh,
    ".las": las,
    ".gsf": gsf,
    ".x3p": x3p,
}
"""Formats that hold one map, whatever it is of."""

HEIGHT_MAP_WRITERS: dict[str, Callable[[Scan, Path], None]] = {
    ".npz": npz,
    ".nc": netcdf,
    **{suffix: _scan_as(writer) for suffix, writer in PLAIN_WRITERS.items()},
}
CHANGE_WRITERS: dict[str, Callable[[Change, Instant, Path], None]] = {
    ".npz": change_npz,
    ".nc": change_netcdf,
    **{suffix: _change_as(writer) for suffix, writer in PLAIN_WRITERS.items()},
}
POINT_WRITERS: dict[str, Callable[[Any, Path], None]] = {".npz": _points_npz, ".ply": points_ply}
SERIES_WRITERS: dict[str, Callable[[Any, Path], None]] = {".csv": _csv, ".parquet": _parquet}
