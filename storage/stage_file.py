"""Stage files: where a stage stood at each tile of a large area, or at each view of an object."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from configs import ConfigError, Document, InputError, read_yaml

__all__ = ["StageFile", "StagePosition", "read_stage"]

AXES = ("x", "y", "-x", "-y")
KEYS = ("tiles", "axes", "sigma_mm")


@dataclass(frozen=True, slots=True)
class StagePosition:
    """How far the stage had moved the sample, mm, and by how much it had turned it about the vertical, degrees."""

    x_mm: float
    y_mm: float
    z_mm: float = 0.0
    turn_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class StageFile:
    """Positions by the tile's name, in the order of the file.

    `axes` says which way of the site frame each of the stage's axes moves the sample, such as ("-x", "y"); None where
    the file does not say. `sigma_mm` is how far off the stage may be.
    """

    tiles: dict[str, StagePosition]
    axes: tuple[str, str] | None = None
    sigma_mm: float | None = None

    def position(self, path: Path) -> StagePosition | None:
        """The position of a capture folder or file: by its path as written, its name, or its name less the suffix."""
        for name in (str(path), path.name, path.stem):
            if name in self.tiles:
                return self.tiles[name]
        return None


def read_stage(file: str | Path) -> StageFile:
    """Read a stage file.

    YAML: ``tiles: {NAME: [x, y], ...}`` in mm, with z as a third and a turn in degrees as a fourth number where there
    are such; ``axes: [-x, y]`` and ``sigma_mm: 0.05`` may be left out. CSV: a header ``tile,x_mm,y_mm`` with ``z_mm``
    and ``turn_deg`` where there are such.

    Raises
    ------
    InputError
        If there is no such file, or it is none; the message names the line.
    """
    path = Path(file)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, name the stage file in it")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such stage file; `microrelief mosaic --help` shows how one looks") from None
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{path}: cannot be read as a stage file: it is YAML or CSV in UTF-8") from None
    stage = _csv(path, text) if path.suffix.lower() == ".csv" else _yaml(path, text)
    if not stage.tiles:
        raise InputError(f"{path}: names no tile")
    return stage


def _yaml(path: Path, text: str) -> StageFile:
    document = read_yaml(text, str(path))
    data = document.data
    if not isinstance(data, dict) or not isinstance(data.get("tiles"), dict):
        raise ConfigError(document.line((), "needs `tiles: {NAME: [x, y], ...}` in mm"))
    for key in data:
        if key not in KEYS:
            raise ConfigError(document.line((key,), f"unknown key; there are {', '.join(KEYS)}", at_key=True))
    tiles = {}
    for name, numbers in data["tiles"].items():
        if not isinstance(numbers, list) or not 2 <= len(numbers) <= 4 or not all(_number(each) for each in numbers):
            raise ConfigError(document.line(("tiles", name), "must be [x, y], [x, y, z] or [x, y, z, turn_deg]"))
        tiles[str(name)] = StagePosition(*(float(each) for each in numbers))
    sigma = data.get("sigma_mm")
    if sigma is not None and not (_number(sigma) and sigma > 0):
        raise ConfigError(document.line(("sigma_mm",), "must be a number of mm above 0"))
    return StageFile(tiles, _axes(document, data.get("axes")), None if sigma is None else float(sigma))


def _axes(document: Document, given: Any) -> tuple[str, str] | None:
    if given is None:
        return None
    across = isinstance(given, list) and len(given) == 2 and all(each in AXES for each in given)
    if not across or given[0][-1] == given[1][-1]:
        raise ConfigError(document.line(("axes",), "must be two of x, y, -x, -y, one along x and one along y"))
    return str(given[0]), str(given[1])


def _csv(path: Path, text: str) -> StageFile:
    rows = list(csv.reader(text.splitlines()))
    header = [name.strip().lower() for name in rows[0]] if rows else []
    if header[:3] != ["tile", "x_mm", "y_mm"] or header[3:] not in ([], ["z_mm"], ["z_mm", "turn_deg"]):
        raise InputError(f"{path}:1: the header must be tile,x_mm,y_mm or tile,x_mm,y_mm,z_mm,turn_deg")
    tiles: dict[str, StagePosition] = {}
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            raise InputError(f"{path}:{number}: has {len(row)} values, the header {len(header)}")
        name = row[0].strip()
        if name in tiles:
            raise InputError(f"{path}:{number}: tile {name!r} is given twice")
        tiles[name] = StagePosition(*_numbers(path, number, row[1:]))
    return StageFile(tiles)


def _numbers(path: Path, number: int, cells: Sequence[str]) -> list[float]:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        raise InputError(f"{path}:{number}: {', '.join(cells)}: must be numbers of mm, with a decimal point") from None
    if not all(math.isfinite(value) for value in values):
        raise InputError(f"{path}:{number}: {', '.join(cells)}: must be finite")
    return values


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
