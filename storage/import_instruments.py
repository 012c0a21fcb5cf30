"""Files of instruments, some forty formats, through SurfaceTopography (extra `instrument-files`)."""

from __future__ import annotations

import warnings
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from configs import InputError, MicroreliefError

from .raster import Raster, mm_per

__all__ = ["INSTRUMENT_SUFFIXES", "instrument"]

INSTRUMENT_SUFFIXES = (
    *(".al3d", ".apx", ".bcr", ".bcrf", ".cur", ".dat", ".datx", ".di", ".ezd", ".frt", ".gwy", ".h5", ".hgt", ".ibw"),
    *(".jpk", ".lext", ".mat", ".mdt", ".mi", ".mnt", ".nid", ".nms", ".oir", ".opd", ".opdx", ".os3d", ".plu"),
    *(".plux", ".poir", ".qep", ".sdf", ".spm", ".stp", ".sur", ".tmd", ".tom", ".top", ".vk3", ".vk4", ".vk6", ".vk7"),
    *(".wsxm", ".x3p", ".xlsx", ".zmg", ".zon", ".asc", ".txt"),
)
"""What SurfaceTopography's readers are asked for; they look into the file, not at its name."""

EPOCH_YEAR = 1980
"""Programs that know no date write the beginning of their clock: a time before this year is none."""


def instrument(path: Path) -> Raster:
    """Read the first height channel of an instrument's file.

    Raises
    ------
    InputError
        If it is none that SurfaceTopography knows, or says no size or unit.
    MicroreliefError
        If the extra is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportWarning)  # it would like mpi4py, which a reader does not need
            from SurfaceTopography.IO import open_topography
    except ImportError:
        raise MicroreliefError(f"{path}: instrument files need  pip install 'microrelief[instrument-files]'") from None
    try:
        with open_topography(str(path)) as reader:
            topography = reader.topography()
    except Exception as error:  # noqa: BLE001 - forty readers raise what they like on a file that is not theirs
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: is no instrument file that can be read: {reason}") from None
    if topography.dim != 2:
        raise InputError(f"{path}: is a profile, not a height map")
    if topography.unit is None or topography.physical_sizes is None:
        raise InputError(f"{path}: says no {'unit' if topography.unit is None else 'size'}: its cells have no size")
    scale = mm_per(path, topography.unit)
    heights = np.ma.filled(np.ma.asarray(topography.heights(), np.float64), np.nan)
    # SurfaceTopography counts (x, y) with y downwards, as an image
    cells = np.ascontiguousarray(heights.T[::-1]) * scale
    wide, high = (
        float(size) * scale / count for size, count in zip(topography.physical_sizes, heights.shape, strict=True)
    )
    return Raster(cells, (wide, high), local=_taken(topography.info))


def _taken(info: Any) -> datetime | None:
    moment = info.get("acquisition_time")
    return moment if isinstance(moment, datetime) and moment.year >= EPOCH_YEAR else None
