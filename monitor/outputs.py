"""Where a command writes its result: refused before the work, not after it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from configs import InputError

__all__ = ["check_folder", "check_out", "check_recording", "check_table", "nearest_there"]


def nearest_there(place: Path) -> Path:
    """Give a place, or of those above it the nearest that exists."""
    return next(each for each in (place, *place.absolute().parents) if each.exists())


def check_table(out: Path) -> None:
    """Refuse a table that cannot be written. Raises InputError as `check_out` does."""
    _check(out, (".csv", ".parquet"), "use .csv or .parquet")


def check_recording(out: Path) -> None:
    """Refuse a recording that the viewer would not open. Raises InputError as `check_out` does."""
    _check(out, (".rrd",), "a recording ends in .rrd", "--save")


def check_folder(out: Path) -> None:
    """Refuse a folder of results that is a file, or that cannot be made.

    Raises
    ------
    InputError
        It is a file, or lies in one.
    """
    above = nearest_there(out)
    if not above.is_dir():
        raise InputError(f"--out {out}: {above} is a file: name a folder")


def check_out(out: Path, pitch_mm: float | None) -> None:
    """Refuse a result that cannot be written, before the work.

    Raises
    ------
    InputError
        The suffix is none of a height map, the folder is not there, or the pitch is no positive number.
    """
    _check(out, (".npz", ".nc", ".tif", ".tiff", ".ply"), "use .npz, .nc, .tif or .ply")
    if pitch_mm is not None and not (np.isfinite(pitch_mm) and pitch_mm > 0):
        raise InputError(f"--pitch-mm {pitch_mm}: must be a positive number")


def _check(out: Path, suffixes: tuple[str, ...], choose: str, option: str = "--out") -> None:
    if out.suffix.lower() not in suffixes:
        raise InputError(f"{option} {out}: unknown suffix {out.suffix.lower()!r}: {choose}")
    if not out.parent.is_dir():
        raise InputError(f"{option} {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise InputError(f"{option} {out}: is a folder, name a file")
