"""Height maps, point clouds and series as files for other programs; the suffix says which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import PointMap, Scan, format_instant

from .durable import whole_file

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["HEIGHT_MAP_WRITERS", "POINT_WRITERS", "write_height_map", "write_points", "write_series"]

MM_PER_M = 1000.0


def write_height_map(scan: Scan, file: str | Path) -> None:
    """Write a height map as ``.npz``, ``.nc`` (CF-1.11), ``.tif`` (GeoTIFF, metres) or ``.ply`` (mesh, mm).

    The file appears whole or not at all.

    Raises
    ------
    InputError
        If the suffix is none of these, or the folder does not exist.
    """
    _write(HEIGHT_MAP_WRITERS, scan, Path(file), "a height map")


def write_points(points: PointMap, file: str | Path) -> None:
    """Write a point map as ``.npz`` (every camera pixel) or ``.ply`` (the measured points, mm, camera frame).

    Raises
    ------
    InputError
        If the suffix is neither, or the folder does not exist.
    """
    _write(POINT_WRITERS, points, Path(file), "points")


def write_series(series: pd.DataFrame, file: str | Path) -> None:
    """Write a store's series as ``.csv`` (units in the header) or ``.parquet`` (units in its metadata).

    Raises
    ------
    InputError
        If the suffix is neither, or the folder does not exist.
    """
    _write(SERIES_WRITERS, series, Path(file), "a series")


def _write(writers: dict[str, Callable[[Any, Path], None]], what: Any, file: Path, name: str) -> None:
    writer = writers.get(file.suffix.lower())
    if writer is None:
        raise InputError(f"{file}: {name} cannot be written as {file.suffix!r}: choose one of {', '.join(writers)}")
    with whole_file(file) as temporary:
        writer(what, temporary)


def _npz(scan: Scan, file: Path) -> None:
    grid = scan.grid
    np.savez_compressed(
        file,
        height=scan.height,
        pitch_mm=grid.pitch_mm,
        sigma=scan.sigma,
        texture=scan.texture,
        level=scan.level,
        x0_mm=grid.x0_mm,
        y0_mm=grid.y0_mm,
        time=format_instant(scan.time),
        calibration_id=scan.calibration_id,
    )


def _netcdf(scan: Scan, file: Path) -> None:
    """NetCDF-3 (64-bit offsets) by scipy: it has no unsigned bytes and no 64-bit integers."""
    import xarray as xr

    grid = scan.grid
    cells = ("y", "x")
    unmeasured = {"_FillValue": np.float32(np.nan)}
    dataset = xr.Dataset(
        {
            "height": (
                cells,
                scan.height,
                {"units": "mm", "long_name": "height above the reference plane", "ancillary_variables": "sigma level"},
            ),
            "sigma": (cells, scan.sigma, {"units": "mm", "long_name": "standard uncertainty of height"}),
            "texture": (cells, scan.texture.astype(np.int16), {"units": "1", "long_name": "brightness, 0 to 255"}),
            "level": (
                cells,
                scan.level.astype(np.int16),
                {"units": "1", "long_name": "coarseness of stripes; 255 none"},
            ),
        },
        coords={
            "x": ("x", grid.x_mm, {"units": "mm", "axis": "X", "long_name": "cell centre along x, site frame"}),
            "y": ("y", grid.y_mm, {"units": "mm", "axis": "Y", "long_name": "cell centre along y, site frame"}),
            "time": ((), scan.time, {"standard_name": "time", "axis": "T"}),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": "microrelief height map",
            "source": "structured light",
            "pitch_mm": grid.pitch_mm,
            "time_exact": format_instant(scan.time),
            "calibration_id": scan.calibration_id,
        },
    )
    encoding: dict[str, Any] = dict.fromkeys(("height", "sigma"), unmeasured)
    encoding |= {name: {"_FillValue": None} for name in ("x", "y", "texture", "level")}
    encoding["time"] = {"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian", "dtype": "float64"}
    file.write_bytes(dataset.to_netcdf(engine="scipy", format="NETCDF3_64BIT", encoding=encoding))


def _geotiff(scan: Scan, file: Path) -> None:
    """GeoTIFF of float32 metres, north (+y) up, in a local frame without a place on Earth."""
    import tifffile

    grid = scan.grid
    left, _, _, top = (edge / MM_PER_M for edge in grid.extent_mm)
    pitch = grid.pitch_mm / MM_PER_M
    # model type user-defined; pixel is area; linear unit metre (GeoTIFF 1.1, keys 1024, 1025, 3076)
    keys = (1, 1, 1, 3, 1024, 0, 1, 32767, 1025, 0, 1, 1, 3076, 0, 1, 9001)
    facts = "".join(
        f'<Item name="{name}"{extra}>{value}</Item>'
        for name, extra, value in (
            ("UNITTYPE", ' sample="0" role="unittype"', "m"),
            ("TIME", "", format_instant(scan.time)),
            ("CALIBRATION", "", scan.calibration_id),
        )
    )
    tifffile.imwrite(
        file,
        np.ascontiguousarray(scan.height[::-1]) / np.float32(MM_PER_M),
        photometric="minisblack",
        metadata=None,
        software="microrelief",
        extratags=[
            (33550, "d", 3, (pitch, pitch, 0.0), True),
            (33922, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
            (34735, "H", len(keys), keys, True),
            (42112, "s", 0, f"<GDALMetadata>{facts}</GDALMetadata>", True),
            (42113, "s", 0, "nan", True),
        ],
    )


def _mesh(scan: Scan, file: Path) -> None:
    """Triangles between measured neighbours: a hole stays a hole."""
    measured = np.isfinite(scan.height)
    x, y = np.meshgrid(scan.grid.x_mm, scan.grid.y_mm)
    number = np.full(measured.shape, -1, dtype=np.int32)
    number[measured] = np.arange(np.count_nonzero(measured), dtype=np.int32)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    lower = (a >= 0) & (b >= 0) & (d >= 0)
    upper = (a >= 0) & (d >= 0) & (c >= 0)
    faces = np.concatenate(
        [np.stack([a[lower], b[lower], d[lower]], axis=1), np.stack([a[upper], d[upper], c[upper]], axis=1)]
    )
    xyz = np.stack([x[measured], y[measured], scan.height[measured]], axis=1)
    _ply(file, xyz, scan.texture[measured], scan.sigma[measured], faces)


def _points_npz(points: PointMap, file: Path) -> None:
    np.savez_compressed(file, **asdict(points))


def _points_ply(points: PointMap, file: Path) -> None:
    valid = points.valid
    _ply(file, points.xyz[valid], points.texture[valid], points.sigma_z[valid], None)


def _ply(
    file: Path,
    xyz: npt.NDArray[Any],
    texture: npt.NDArray[np.uint8],
    sigma: npt.NDArray[np.float32],
    faces: npt.NDArray[np.int32] | None,
) -> None:
    """Binary PLY: x y z mm, grey as colour, sigma as `quality` (the name that CloudCompare and MeshLab show)."""
    vertex = np.empty(len(xyz), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("quality", "<f4")])
    vertex["xyz"], vertex["rgb"], vertex["quality"] = xyz, texture[:, np.newaxis], sigma
    lines = ["ply", "format binary_little_endian 1.0", "comment microrelief, mm", f"element vertex {len(xyz)}"]
    lines += [f"property float {name}" for name in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    lines.append("property float quality")
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with file.open("wb") as handle:
        handle.write("\n".join([*lines, "end_header", ""]).encode())
        handle.write(vertex.tobytes())
        if faces is not None:
            face = np.empty(len(faces), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
            face["count"], face["vertices"] = 3, faces
            handle.write(face.tobytes())


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


HEIGHT_MAP_WRITERS: dict[str, Callable[[Any, Path], None]] = {
    ".npz": _npz,
    ".nc": _netcdf,
    ".tif": _geotiff,
    ".tiff": _geotiff,
    ".ply": _mesh,
}
POINT_WRITERS: dict[str, Callable[[Any, Path], None]] = {".npz": _points_npz, ".ply": _points_ply}
SERIES_WRITERS: dict[str, Callable[[Any, Path], None]] = {".csv": _csv, ".parquet": _parquet}
