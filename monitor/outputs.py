"""Where a command writes its height map: refused before the work, not after it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from configs import InputError

__all__ = ["check_out"]

SUFFIXES = (".npz", ".nc", ".tif", ".tiff", ".ply")


def check_out(out: Path, pitch_mm: float | None) -> None:
    """Refuse a result that cannot be written, before the work.

    Raises
    ------
    InputError
        The suffix is none of a height map, the folder is not there, or the pitch is no positive number.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise InputError(f"--out {out}: unknown suffix {out.suffix.lower()!r}: use .npz, .nc, .tif or .ply")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise InputError(f"--out {out}: is a folder, name a file")
    if pitch_mm is not None and not (np.isfinite(pitch_mm) and pitch_mm > 0):
        raise InputError(f"--pitch-mm {pitch_mm}: must be a positive number")
