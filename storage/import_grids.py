"""Height maps of open raster formats: npz, NetCDF (3 and 4), GeoTIFF, Gwyddion's GSF."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import InputError, MicroreliefError
from pipelines import Instant, parse_instant

from .raster import MM, Raster, mm_per

__all__ = ["geotiff", "gsf", "netcdf", "npz"]

HEIGHT_NAMES = ("height", "dz", "z", "dem", "elevation")
GSF_MAGIC = b"Gwyddion Simple Field 1.0\n"
MODEL_TYPE, RASTER_TYPE, ANGULAR_UNIT, LINEAR_UNIT = 1024, 1025, 2054, 3076
"""Keys of the GeoTIFF standard (OGC 19-008), and below values of theirs."""
GEOGRAPHIC, DEGREE, METRE = 2, 9102, 9001
LINEAR_UNITS = {0: 1000.0, 32767: 1000.0, METRE: 1000.0, 9002: 304.8, 9003: 1200.0 / 3937.0 * 1000.0}
"""mm of a unit: what says none or its own counts as metres, as nearly all such files do; foot and US survey foot."""
WGS84_A_MM, WGS84_E2 = 6378137.0e3, 6.69437999014e-3


def npz(path: Path) -> Raster:
    """Read `height` mm and `pitch_mm`; all else is optional."""
    from zipfile import BadZipFile

    try:
        with np.load(path, allow_pickle=False) as data:
            fields = {name: data[name] for name in data.files}
    except BadZipFile as error:
        raise InputError(f"{path}: is no readable .npz: {error}") from None
    height = fields["height"] if "height" in fields or "dz" not in fields else fields["dz"]
    pitch = float(fields["pitch_mm"])
    return Raster(
        height.astype(np.float64),
        (pitch, pitch),
        (float(fields.get("x0_mm", 0.0)), float(fields.get("y0_mm", 0.0))),
        parse_instant(str(fields["time"])) if "time" in fields else None,
        calibration_id=str(fields.get("calibration_id", "")),
        layers={name: fields[name] for name in ("sigma", "texture", "level") if name in fields},
    )


def netcdf(path: Path) -> Raster:
    """Read the variable that is named as a height, or the first of two dimensions; units from its attributes."""
    with _opened_netcdf(path) as dataset:
        dataset.load()
    names = [name for name in HEIGHT_NAMES if name in dataset.data_vars]
    names += [str(name) for name in dataset.data_vars if dataset[name].ndim == 2 and name not in names]
    if not names:
        raise InputError(f"{path}: holds no two-dimensional variable: a height map is one of y and x")
    height = dataset[names[0]]
    y, x = (dataset[dimension] for dimension in height.dims[-2:])
    down = -1 if y.values[-1] < y.values[0] else 1
    layers = {name: dataset[name].values[::down] for name in ("sigma", "texture", "level") if name in dataset.data_vars}
    if "sigma" in layers:
        layers["sigma"] = layers["sigma"] * _unit(path, dataset["sigma"])
    x_mm, y_mm = x.values * _unit(path, x), y.values[::down] * _unit(path, y)
    time: Instant | None = None
    if "time_exact" in dataset.attrs:  # a double counts seconds of today to a quarter of a microsecond only
        time = parse_instant(str(dataset.attrs["time_exact"]))
    elif "time" in dataset and np.issubdtype(dataset["time"].dtype, np.datetime64):
        time = dataset["time"].values.ravel()[0].astype("datetime64[ns]")
    sides = _step(path, x_mm), _step(path, y_mm)
    if "pitch_mm" in dataset.attrs:  # ours say it exactly
        sides = (float(dataset.attrs["pitch_mm"]),) * 2
    return Raster(
        np.squeeze(height.values).astype(np.float64)[::down] * _unit(path, height),
        sides,
        (float(x_mm[0]), float(y_mm[0])),
        time,
        calibration_id=str(dataset.attrs.get("calibration_id", "")),
        layers=layers,
    )


def geotiff(path: Path) -> Raster:
    """Read the first page; heights in the unit that GDAL's metadata names, or metres."""
    import tifffile

    with tifffile.TiffFile(path) as tiff:
        page = tiff.pages.first
        tags = {tag.code: tag.value for tag in page.tags}
        values = page.asarray().astype(np.float64)
    if 33550 not in tags or 33922 not in tags:
        raise InputError(f"{path}: has no pixel scale and tie point (GeoTIFF): its cells have no size")
    if values.ndim == 3:
        values = values[..., 0]
    nodata = str(tags.get(42113, "nan")).strip("\0 ")
    values[values == float(nodata)] = np.nan
    facts = str(tags.get(42112, ""))
    scale = MM.get(_fact(facts, "UNITTYPE").lower() or "m", 1000.0)
    keys = tags.get(34735, ())
    column, row, _, left, top, _ = tags[33922]
    wide, high, _ = tags[33550]
    area = 0.0 if _geo_key(keys, RASTER_TYPE, 1) == 2 else 0.5  # the tie point: a cell's centre, or its corner
    x, y = left + (area - column) * wide, top - (values.shape[0] - 1 + area - row) * high
    east, north, note = _mm_of(path, keys, y + high * (values.shape[0] - 1) / 2)
    wide, high, corner = wide * east, high * north, (x * east, y * north)
    when = _fact(facts, "TIME")
    time = parse_instant(when) if when else None
    calibration_id = _fact(facts, "CALIBRATION")
    return Raster(values[::-1] * scale, (wide, high), corner, time, calibration_id=calibration_id, note=note)


def _mm_of(path: Path, keys: Any, latitude: float) -> tuple[float, float, str]:
    """Millimetres per unit eastwards and northwards of a GeoTIFF's coordinates, and what to tell of it.

    Degrees are taken on the WGS 84 ellipsoid at the map's middle latitude: good to 1e-4 over a degree of it.
    """
    if _geo_key(keys, MODEL_TYPE, 1) != GEOGRAPHIC:
        unit = _geo_key(keys, LINEAR_UNIT, METRE)
        if unit not in LINEAR_UNITS:
            raise InputError(f"{path}: its length unit, EPSG:{unit}, is not known: project it to metres first")
        return LINEAR_UNITS[unit], LINEAR_UNITS[unit], ""
    if _geo_key(keys, ANGULAR_UNIT, DEGREE) != DEGREE or not abs(latitude) < 89:
        raise InputError(f"{path}: is not in degrees below the poles: project it to metres first (gdalwarp -t_srs)")
    phi = np.deg2rad(latitude)
    bend = 1 - WGS84_E2 * np.sin(phi) ** 2
    north = float(np.deg2rad(WGS84_A_MM * (1 - WGS84_E2) / bend**1.5))
    east = float(np.deg2rad(WGS84_A_MM * np.cos(phi) / np.sqrt(bend)))
    return (
        east,
        north,
        (
            f"{path.name}: lies in degrees; taken as metres on the ellipsoid at latitude {latitude:.4f}, "
            f"{east / 1e6:.4f} km per degree eastwards and {north / 1e6:.4f} km northwards"
        ),
    )


def gsf(path: Path) -> Raster:
    """Read Gwyddion Simple Field 1.0: a text header, then float32 from the top row down."""
    content = path.read_bytes()
    if not content.startswith(GSF_MAGIC):
        raise InputError(f"{path}: is no Gwyddion Simple Field 1.0")
    end = content.index(b"\0")
    lines = content[len(GSF_MAGIC) : end].decode("utf-8").splitlines()
    header = {name.strip(): value.strip() for name, _, value in (line.partition("=") for line in lines)}
    rows, columns = int(header["YRes"]), int(header["XRes"])
    start = (end // 4 + 1) * 4  # the header ends in one to four zero bytes, so that the data begin at a multiple of 4
    values = np.frombuffer(content, "<f4", rows * columns, start).reshape(rows, columns)[::-1].astype(np.float64)
    lateral, scale = (mm_per(path, header.get(name, "m")) for name in ("XYUnits", "ZUnits"))
    wide, high = (float(header.get(name, 1.0)) * lateral for name in ("XReal", "YReal"))
    offset_x, offset_y = (float(header.get(name, 0.0)) * lateral for name in ("XOffset", "YOffset"))
    wide, high = wide / columns, high / rows
    # y runs downwards in the file: the top edge is at the offset, and -y is up for the site
    corner = offset_x + wide / 2, -offset_y - (rows - 0.5) * high
    time = parse_instant(header["Time"]) if "Time" in header else None
    return Raster(values * scale, (wide, high), corner, time, calibration_id=header.get("Calibration", ""))


def _opened_netcdf(path: Path) -> Any:
    import io

    import xarray as xr

    content = path.read_bytes()
    if content[:4] != b"\x89HDF":
        return xr.open_dataset(io.BytesIO(content), engine="scipy", decode_timedelta=False)
    if find_spec("h5netcdf") is None:
        raise MicroreliefError(
            f"{path}: is NetCDF-4 (HDF5), which needs  pip install 'microrelief[instrument-files]', or convert it with "
            "`nccopy -k classic IN OUT`"
        )
    return xr.open_dataset(path, engine="h5netcdf", decode_timedelta=False)


def _step(path: Path, positions: npt.NDArray[np.float64]) -> float:
    steps = np.diff(positions)
    if len(steps) == 0:
        raise InputError(f"{path}: a single cell has no pitch")
    step = float(np.median(steps))
    if step <= 0 or np.abs(steps - step).max() > 1e-3 * step:
        raise InputError(f"{path}: its cells are not of one size: resample it first")
    return step


def _unit(path: Path, variable: Any) -> float:
    return mm_per(path, str(variable.attrs.get("units", "mm")))


def _fact(text: str, name: str) -> str:
    found = re.search(rf'<Item name="{name}"[^>]*>([^<]*)<', text)
    return found.group(1) if found else ""


def _geo_key(keys: Any, key: int, default: int) -> int:
    for at in range(4, len(keys) - 3, 4):
        if keys[at] == key:
            return int(keys[at + 3])
    return default
