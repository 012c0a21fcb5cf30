"""Height maps from files of other programs and of our own; the suffix says which."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from configs import InputError, MicroreliefError
from pipelines import Grid, Scan, instant

from .import_clouds import Cloud, gridded, las, ply, xyz
from .import_grids import geotiff, gsf, netcdf, npz
from .import_instruments import INSTRUMENT_SUFFIXES, instrument
from .raster import Raster, mm_per, scan_of

__all__ = ["CLOUD_READERS", "HEIGHT_MAP_READERS", "read_height_map", "read_raster", "scan_of"]


def read_height_map(file: str | Path, tell: Callable[[str], None] = lambda line: None) -> Scan:
    """Read a height map; the suffix says from what: see `HEIGHT_MAP_READERS` and `CLOUD_READERS`.

    Parameters
    ----------
    file : str or Path
    tell : callable
        Told what people must know of how the file was read: that degrees became mm, say.

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
    raster = read_raster(path)
    if raster.note:
        tell(raster.note)
    return scan_of(raster, path, raster.time or instant(datetime.fromtimestamp(path.stat().st_mtime, UTC)))


def read_raster(
    file: str | Path, *, grid: Grid | None = None, pitch_mm: float | None = None, unit: str | None = None
) -> Raster:
    """Read a height map as its file holds it, or lay a cloud of points onto cells.

    Parameters
    ----------
    file : str or Path
    grid : Grid, optional
        Where the cells of a cloud are; without it they cover its points.
    pitch_mm : float, optional
        Side of such a covering cell.
    unit : str, optional
        Unit of a cloud's coordinates; mm, of LAS m, unless given.

    Raises
    ------
    InputError
        As `read_height_map`.
    """
    path = Path(file)
    suffix = path.suffix.lower()
    if suffix not in HEIGHT_MAP_READERS and suffix not in CLOUD_READERS:
        known = ", ".join([*(name for name in HEIGHT_MAP_READERS if name not in INSTRUMENT_SUFFIXES), *CLOUD_READERS])
        raise InputError(
            f"{path}: a height map cannot be read from {path.suffix!r}: give one of {known}, or an instrument's file"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        if suffix in HEIGHT_MAP_READERS:
            return HEIGHT_MAP_READERS[suffix](path)
        reader, usual = CLOUD_READERS[suffix]
        points, time = reader(path)
        found = gridded(points * mm_per(path, unit or usual), path, grid, pitch_mm)
        return Raster(found.height, found.pitch_mm, found.corner_mm, time, layers=found.layers)
    except MicroreliefError:
        raise
    except KeyError as error:
        raise InputError(f"{path}: holds no {error.args[0]!r}") from None
    # numpy, scipy, pandas and tifffile each raise their own of these for a file that is not what its name says
    except (OSError, ValueError, TypeError, IndexError, EOFError, AssertionError, RuntimeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: is no readable {path.suffix} height map: {reason}") from None


HEIGHT_MAP_READERS: dict[str, Callable[[Path], Raster]] = {
    ".npz": npz,
    ".nc": netcdf,
    ".tif": geotiff,
    ".tiff": geotiff,
    ".gsf": gsf,
    **dict.fromkeys(INSTRUMENT_SUFFIXES, instrument),
}
CLOUD_READERS: dict[str, tuple[Callable[[Path], Cloud], str]] = {
    ".ply": (ply, "mm"),
    ".las": (las, "m"),
    ".laz": (las, "m"),
    ".xyz": (xyz, "mm"),
    ".csv": (xyz, "mm"),
}
"""Readers of clouds, and the unit that their files are usually in."""
