"""What `compare` is given: files of any scanner, or scans of a store written STORE@12 or STORE@TIME."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from configs import ConfigError, InputError, MicroreliefError
from pipelines import Grid, Scan, format_instant
from storage import open_store, store_exists

from .check import load_checked
from .commands.export import nearest_scan
from .recipe import masks_of
from .reprocess import campaign_of
from .surfaces import read_surfaces

if TYPE_CHECKING:
    from pipelines.change import NoiseModel

__all__ = ["Compared", "read_compared", "read_stable"]


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A surface; from a store also its campaign's stable areas and noise model, where there are any."""

    name: str
    scan: Scan
    stable: npt.NDArray[np.bool_] | None = None
    noise: NoiseModel | None = None


def read_compared(text: str) -> Compared:
    """Read a height map, or a scan of a store: the one of a number (-1 is the newest), or the nearest to a time.

    Raises
    ------
    InputError
        If there is no such file, store or scan.
    """
    if Path(text).is_file():
        surface = read_surfaces([Path(text)], [None], None, None)[0]
        return Compared(surface.name, surface.scan)
    store, at, which = text.rpartition("@")
    if not at:
        if Path(text).is_dir() and _is_store(text):
            raise InputError(f"{text}: is a store: say which scan, {text}@12 or {text}@2026-11-22T21:00:00Z")
        surface = read_surfaces([Path(text)], [None], None, None)[0]
        return Compared(surface.name, surface.scan)
    with closing(open_store(store)) as opened:
        if not len(opened):
            raise InputError(f"{store}: holds no scan yet")
        stored = opened[nearest_scan(opened, which, text)]
        settings = campaign_of(opened)
        stable = masks_of(settings, stored.scan.grid)[0] if settings is not None else None
        print(f"{text}: scan {stored.number} of {format_instant(stored.scan.time)}")
        return Compared(text, stored.scan, stable, opened.about.noise)


def _is_store(text: str) -> bool:
    try:
        return store_exists(text)
    except MicroreliefError:
        return False


def read_stable(file: Path, grid: Grid) -> npt.NDArray[np.bool_]:
    """Read stable areas: a campaign's `register.stable_mm` (.yaml), or polygons [[[x, y], ...], ...] in mm (.json).

    Raises
    ------
    InputError
        If the file holds none, or they hold no cell.
    """
    from pipelines.change import polygon_mask

    if file.suffix.lower() in (".yaml", ".yml"):
        try:
            mask = masks_of(load_checked(file).campaign, grid)[0]
        except ConfigError as error:
            raise InputError(str(error)) from None
        if mask is None:
            raise InputError(f"{file}: names no stable areas (register: stable_mm)")
        return mask
    try:
        polygons = [[(float(x), float(y)) for x, y in each] for each in json.loads(file.read_text(encoding="utf-8"))]
        mask = polygon_mask(polygons, grid)
    except OSError as error:
        raise InputError(f"--stable {file}: cannot be read: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise InputError(f"--stable {file}: must be a list of polygons in mm, [[[x, y], ...], ...]: {error}") from None
    if not mask.any():
        raise InputError(f"--stable {file}: holds no cell of the grid, {grid.extent_mm} mm")
    return mask
