"""Height maps from files of other programs and of our own; the suffix says which."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import LEVEL_NONE, Grid, Instant, Scan, instant, parse_instant

__all__ = ["HEIGHT_MAP_READERS", "read_height_map"]

MM = {"mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "m": 1000.0, "meter": 1000.0, "metre": 1000.0, "metres": 1000.0}
MM |= {"um": 1e-3, "micrometer": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6, "cm": 10.0}
HEIGHT_NAMES = ("height", "z", "dem", "elevation")


def read_height_map(file: str | Path) -> Scan:
    """Read a height map: ``.npz`` (`height` mm, `pitch_mm`), ``.nc`` (CF, NetCDF-3) or ``.tif`` (GeoTIFF).

    Returns
    -------
    Scan
        Its time is the file's own, or when the file was last written where it says none; sigma is NaN, texture 0 and
        level 0 where the file has none.

    Raises
    ------
    InputError
        If there is no such file, its suffix is none of these, or it holds no height map.
    """
    path = Path(file)
    reader = HEIGHT_MAP_READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(HEIGHT_MAP_READERS)
        raise InputError(f"{path}: a height map cannot be read from {path.suffix!r}: give one of {known}")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        return reader(path)
    except InputError:
        raise
    except KeyError as error:
        raise InputError(f"{path}: holds no {error.args[0]!r}") from None
    # numpy, scipy and tifffile each raise their own of these for a file that is not what its name says
    except (OSError, ValueError, TypeError, IndexError, EOFError, AssertionError, RuntimeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: is no readable {path.suffix} height map: {reason}") from None


def _npz(path: Path) -> Scan:
    from zipfile import BadZipFile

    try:
        with np.load(path, allow_pickle=False) as data:
            fields = {name: data[name] for name in data.files}
    except BadZipFile as error:
        raise InputError(f"{path}: is no readable .npz: {error}") from None
    height, pitch = fields["height"], float(fields["pitch_mm"])
    corner = float(fields.get("x0_mm", 0.0)), float(fields.get("y0_mm", 0.0))
    time = _exact(str(fields["time"])) if "time" in fields else _written(path)
    calibration_id = str(fields.get("calibration_id", ""))
    return _scan(path, height, pitch, corner, time, calibration_id, fields)


def _netcdf(path: Path) -> Scan:
    import io

    import xarray as xr

    content = path.read_bytes()
    if content[:4] == b"\x89HDF":
        raise InputError(
            f"{path}: is NetCDF-4 (HDF5), which is not read yet: convert it with `nccopy -k classic IN OUT`"
        )
    with xr.open_dataset(io.BytesIO(content), engine="scipy", decode_timedelta=False) as dataset:
        dataset.load()
    names = [name for name in HEIGHT_NAMES if name in dataset.data_vars]
    names += [str(name) for name in dataset.data_vars if dataset[name].ndim == 2 and name not in names]
    if not names:
        raise InputError(f"{path}: holds no two-dimensional variable: a height map is one of y and x")
    height = dataset[names[0]]
    y, x = (dataset[dimension] for dimension in height.dims[-2:])
    scale = _mm(path, height.attrs)
    pitch = _pitch(path, x.values * _mm(path, x.attrs), y.values * _mm(path, y.attrs))
    upward = y.values[-1] >= y.values[0]
    fields = {
        name: dataset[name].values[:: 1 if upward else -1]
        for name in ("sigma", "texture", "level")
        if name in dataset.data_vars
    }
    if "sigma" in fields:
        fields["sigma"] = fields["sigma"] * _mm(path, dataset["sigma"].attrs)
    corner = float(x.values[0] * _mm(path, x.attrs)), float(min(y.values[0], y.values[-1]) * _mm(path, y.attrs))
    time = _written(path)
    if "time_exact" in dataset.attrs:  # a double counts seconds of today to a quarter of a microsecond only
        time = _exact(str(dataset.attrs["time_exact"]))
    elif "time" in dataset and np.issubdtype(dataset["time"].dtype, np.datetime64):
        time = dataset["time"].values.ravel()[0].astype("datetime64[ns]")
    values = np.squeeze(height.values)[:: 1 if upward else -1] * scale
    return _scan(path, values, pitch, corner, time, str(dataset.attrs.get("calibration_id", "")), fields)


def _geotiff(path: Path) -> Scan:
    import tifffile

    with tifffile.TiffFile(path) as tiff:
        page = tiff.pages.first
        tags = {tag.code: tag.value for tag in page.tags}
        values = page.asarray().astype(np.float64)
    if 33550 not in tags or 33922 not in tags:
        raise InputError(f"{path}: has no pixel scale and tie point (GeoTIFF): its cells have no size")
    nodata = str(tags.get(42113, "nan")).strip("\0 ")
    values[values == float(nodata)] = np.nan
    facts = str(tags.get(42112, ""))
    scale = MM.get(_fact(facts, "UNITTYPE").lower() or "m", 1000.0)
    pitch, pitch_y, _ = (1000.0 * value for value in tags[33550])
    if not np.isclose(pitch, pitch_y):
        raise InputError(f"{path}: cells of {pitch:g} x {pitch_y:g} mm are not square")
    column, row, _, left, top, _ = tags[33922]
    area = 0.0 if _raster_type(tags.get(34735, ())) == 2 else 0.5  # the tie point: a cell's centre, or its corner
    x0 = left * 1000.0 + (area - column) * pitch
    y0 = top * 1000.0 - (values.shape[0] - 1 + area - row) * pitch
    when = _fact(facts, "TIME")
    time = _exact(when) if when else _written(path)
    return _scan(path, values[::-1] * scale, pitch, (x0, y0), time, _fact(facts, "CALIBRATION"), {})


def _scan(
    path: Path,
    height: npt.NDArray[Any],
    pitch: float,
    corner: tuple[float, float],
    time: Instant,
    calibration_id: str,
    fields: dict[str, npt.NDArray[Any]],
) -> Scan:
    if height.ndim != 2:
        raise InputError(f"{path}: height must be (row, column), not of shape {height.shape}")
    cells = np.ascontiguousarray(height, dtype=np.float32)
    grid = Grid(cells.shape[0], cells.shape[1], pitch, *corner)
    measured = np.isfinite(cells)
    cells[~measured] = np.nan
    sigma = fields.get("sigma", np.full(grid.shape, np.nan))
    texture = fields.get("texture", np.zeros(grid.shape))
    level = fields.get("level", np.where(measured, 0, LEVEL_NONE))
    return Scan(
        grid,
        time,
        cells,
        np.ascontiguousarray(sigma, dtype=np.float32),
        np.ascontiguousarray(texture, dtype=np.uint8),
        np.ascontiguousarray(level, dtype=np.uint8),
        calibration_id,
    )


def _pitch(path: Path, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> float:
    steps = np.concatenate([np.diff(x), np.abs(np.diff(y))])
    if len(steps) == 0:
        raise InputError(f"{path}: a single cell has no pitch")
    pitch = float(np.median(steps))
    if pitch <= 0 or np.abs(steps - pitch).max() > 1e-3 * pitch:
        raise InputError(f"{path}: its cells are not squares of one size: resample it first")
    return pitch


def _mm(path: Path, attributes: dict[Any, Any]) -> float:
    unit = str(attributes.get("units", "mm"))
    if unit.lower() not in MM:
        raise InputError(f"{path}: length unit {unit!r} is not known: use one of mm, m, cm, um, nm")
    return MM[unit.lower()]


def _fact(text: str, name: str) -> str:
    found = re.search(rf'<Item name="{name}"[^>]*>([^<]*)<', text)
    return found.group(1) if found else ""


def _raster_type(keys: Any) -> int:
    for at in range(4, len(keys) - 3, 4):
        if keys[at] == 1025:
            return int(keys[at + 3])
    return 1


def _exact(text: str) -> Instant:
    """Read a time to the nanosecond, which `parse_instant` cuts to microseconds."""
    if re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?Z", text):
        return np.datetime64(text[:-1], "ns")
    return parse_instant(text)


def _written(path: Path) -> Instant:
    return instant(datetime.fromtimestamp(path.stat().st_mtime, UTC))


HEIGHT_MAP_READERS: dict[str, Callable[[Path], Scan]] = {
    ".npz": _npz,
    ".nc": _netcdf,
    ".tif": _geotiff,
    ".tiff": _geotiff,
}
