"""Scans and changes as rasters of open formats: npz, NetCDF (CF-1.11), GeoTIFF, Gwyddion's GSF, ISO 25178-72 X3P."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import numpy.typing as npt

from pipelines import Change, Grid, Instant, Scan, format_instant

from .exported import MM_PER_M, Exported

__all__ = ["change_netcdf", "change_npz", "geotiff", "gsf", "netcdf", "npz", "x3p"]

LENGTH = {"units": "mm"}


def npz(scan: Scan, file: Path) -> None:
    """Write all that a scan holds."""
    layers: dict[str, Any] = {"height": scan.height, "sigma": scan.sigma, "texture": scan.texture, "level": scan.level}
    np.savez_compressed(file, **layers, **_facts(scan.grid, scan.time), calibration_id=scan.calibration_id)


def change_npz(change: Change, time: Instant, file: Path) -> None:
    """Write a change: `dz`, `lod`, and the motion that was taken out of it."""
    facts = _facts(change.grid, time)
    since, motion = format_instant(change.baseline_time), change.motion
    np.savez_compressed(
        file, dz=change.dz, lod=change.lod, **facts, baseline_time=since, motion=motion.matrix, verdict=motion.verdict
    )


def netcdf(scan: Scan, file: Path) -> None:
    """Write NetCDF-3 (64-bit offsets) by scipy: it has no unsigned bytes and no 64-bit integers."""
    about = {**LENGTH, "long_name": "height above the reference plane", "ancillary_variables": "sigma level"}
    variables: dict[str, tuple[npt.NDArray[Any], dict[str, str]]] = {
        "height": (scan.height, about),
        "sigma": (scan.sigma, {**LENGTH, "long_name": "standard uncertainty of height"}),
        "texture": (scan.texture.astype(np.int16), {"units": "1", "long_name": "brightness, 0 to 255"}),
        "level": (scan.level.astype(np.int16), {"units": "1", "long_name": "coarseness of stripes; 255 none"}),
    }
    _netcdf(file, scan.grid, scan.time, "height map", variables, {"calibration_id": scan.calibration_id})


def change_netcdf(change: Change, time: Instant, file: Path) -> None:
    """Write a change as NetCDF-3."""
    about = {**LENGTH, "long_name": "height now minus height then", "ancillary_variables": "lod"}
    variables: dict[str, tuple[npt.NDArray[Any], dict[str, str]]] = {
        "dz": (change.dz, about),
        "lod": (change.lod, {**LENGTH, "long_name": "level of detection at 95 %"}),
    }
    facts = {"baseline_time": format_instant(change.baseline_time), "registration": change.motion.verdict}
    _netcdf(file, change.grid, time, "change since the baseline", variables, facts)


def geotiff(exported: Exported, file: Path) -> None:
    """Write float32 metres, north (+y) up, in a local frame without a place on Earth."""
    import tifffile

    grid = exported.grid
    left, _, _, top = (edge / MM_PER_M for edge in grid.extent_mm)
    pitch = grid.pitch_mm / MM_PER_M
    # model type user-defined; pixel is area; linear unit metre (GeoTIFF 1.1, keys 1024, 1025, 3076)
    keys = (1, 1, 1, 3, 1024, 0, 1, 32767, 1025, 0, 1, 1, 3076, 0, 1, 9001)
    facts = "".join(
        f'<Item name="{name}"{extra}>{value}</Item>'
        for name, extra, value in (
            ("UNITTYPE", ' sample="0" role="unittype"', "m"),
            ("TIME", "", format_instant(exported.time)),
            ("CALIBRATION", "", exported.calibration_id),
        )
    )
    tifffile.imwrite(
        file,
        np.ascontiguousarray(exported.cells[::-1]) / np.float32(MM_PER_M),
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


def gsf(exported: Exported, file: Path) -> None:
    """Write Gwyddion Simple Field 1.0: metres, the top row first, NaN where nothing was measured."""
    grid = exported.grid
    left, _, _, top = grid.extent_mm
    header = {
        "XRes": grid.columns,
        "YRes": grid.rows,
        "XReal": grid.columns * grid.pitch_mm / MM_PER_M,
        "YReal": grid.rows * grid.pitch_mm / MM_PER_M,
        "XOffset": left / MM_PER_M,
        "YOffset": -top / MM_PER_M,
        "XYUnits": "m",
        "ZUnits": "m",
        "Title": exported.title,
        "Time": format_instant(exported.time),
        "Calibration": exported.calibration_id,
    }
    lines = "".join(f"{name} = {value}\n" for name, value in header.items() if value != "")
    head = b"Gwyddion Simple Field 1.0\n" + lines.encode("utf-8")
    head += b"\0" * (4 - len(head) % 4)
    metres = (exported.cells[::-1].astype(np.float64) / MM_PER_M).astype("<f4")
    file.write_bytes(head + metres.tobytes())


def x3p(exported: Exported, file: Path) -> None:
    """Write ISO 25178-72: metres as doubles, NaN where nothing was measured, the top row first as programs show it."""
    grid = exported.grid
    cells = (exported.cells[::-1].astype(np.float64) / MM_PER_M).astype("<f8").tobytes()
    sums = hashlib.md5(cells, usedforsecurity=False).hexdigest().upper()
    axes = "".join(
        f"<{name}><AxisType>{kind}</AxisType><DataType>D</DataType><Increment>{step!r}</Increment>"
        f"<Offset>{offset!r}</Offset></{name}>"
        for name, kind, step, offset in (
            ("CX", "I", grid.pitch_mm / MM_PER_M, grid.x0_mm / MM_PER_M),
            ("CY", "I", grid.pitch_mm / MM_PER_M, -float(grid.y_mm[-1]) / MM_PER_M),
            ("CZ", "A", 1.0, 0.0),
        )
    )
    when = format_instant(exported.time)
    main = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">'
        f"<Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>{axes}</Axes></Record1>"
        f"<Record2><Date>{when}</Date><Instrument><Manufacturer>microrelief</Manufacturer><Model>structured light"
        "</Model><Serial>not available</Serial><Version>not available</Version></Instrument>"
        f"<CalibrationDate>{when}</CalibrationDate><ProbingSystem><Type>NonContacting</Type>"
        f"<Identification>{exported.calibration_id or 'not available'}</Identification></ProbingSystem>"
        f"<Comment>{exported.title}</Comment></Record2>"
        f"<Record3><MatrixDimension><SizeX>{grid.columns}</SizeX><SizeY>{grid.rows}</SizeY><SizeZ>1</SizeZ>"
        "</MatrixDimension><DataLink><PointDataLink>bindata/data.bin</PointDataLink>"
        f"<MD5ChecksumPointData>{sums}</MD5ChecksumPointData></DataLink></Record3>"
        "<Record4><ChecksumFile>md5checksum.hex</ChecksumFile></Record4></p:ISO5436_2>\n"
    )
    check = hashlib.md5(main.encode(), usedforsecurity=False).hexdigest()
    with ZipFile(file, "w", ZIP_DEFLATED) as archive:
        archive.writestr("main.xml", main)
        archive.writestr("bindata/data.bin", cells)
        archive.writestr("md5checksum.hex", f"{check} *main.xml\n")


def _facts(grid: Grid, time: Instant) -> dict[str, Any]:
    return {
        "pitch_mm": grid.pitch_mm,
        "x0_mm": grid.x0_mm,
        "y0_mm": grid.y0_mm,
        "time": format_instant(time),
    }


def _netcdf(
    file: Path,
    grid: Grid,
    time: Instant,
    what: str,
    variables: dict[str, tuple[npt.NDArray[Any], dict[str, str]]],
    facts: dict[str, str],
) -> None:
    import xarray as xr

    when = format_instant(time)
    # no `axis` on x and y: of coordinates without a projection it would claim longitude and latitude
    x = {**LENGTH, "standard_name": "projection_x_coordinate", "long_name": "cell centre along x, site frame"}
    y = {**LENGTH, "standard_name": "projection_y_coordinate", "long_name": "cell centre along y, site frame"}
    dataset = xr.Dataset(
        {name: (("y", "x"), values, attributes) for name, (values, attributes) in variables.items()},
        coords={
            "x": ("x", grid.x_mm, x),
            "y": ("y", grid.y_mm, y),
            "time": ((), time, {"standard_name": "time", "axis": "T", "units_metadata": "leap_seconds: none"}),
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": f"microrelief {what}",
            "source": "structured light",
            "history": f"{when} measured; exported by microrelief",
            "pitch_mm": grid.pitch_mm,
            "time_exact": when,
            **facts,
        },
    )
    encoding: dict[str, Any] = {
        name: {"_FillValue": np.float32(np.nan) if values.dtype == np.float32 else None}
        for name, (values, _) in variables.items()
    }
    encoding |= {name: {"_FillValue": None} for name in ("x", "y")}
    encoding["time"] = {"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian", "dtype": "float64"}
    file.write_bytes(dataset.to_netcdf(engine="scipy", format="NETCDF3_64BIT", encoding=encoding))
