"""Point maps read back: the ``.npz`` that ``microrelief reconstruct`` writes, one point per camera pixel."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from configs import InputError
from pipelines import PointMap, Shared

__all__ = ["holds_points", "read_points"]

FIELDS = (("xyz", np.float32, 3), ("sigma_z", np.float32, 2), ("projector", np.float32, 3))
BYTES = (("level", np.uint8, 2), ("texture", np.uint8, 2))


def holds_points(file: Path) -> bool:
    """Whether a file is an ``.npz`` of points; False for height maps, and where it cannot be read."""
    if file.suffix.lower() != ".npz" or not file.is_file():
        return False
    try:
        with np.load(file, allow_pickle=False) as data:
            return "xyz" in data.files
    except (OSError, ValueError, BadZipFile, EOFError):
        return False


def read_points(file: Path) -> PointMap:
    """Read a point map.

    Raises
    ------
    InputError
        If an array is missing, or not of the type and shape of the others.
    """
    try:
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name, _, _ in FIELDS + BYTES}
            shared = data["shared"] if "shared" in data.files else ()  # older files know nothing of it
    except KeyError as error:
        raise InputError(f"{file}: holds no {str(error.args[0]).split()[0]!r}: reconstruct it anew") from None
    except (OSError, ValueError, BadZipFile, EOFError) as error:
        raise InputError(f"{file}: is no readable .npz: {error}") from None
    for name, dtype, dimensions in FIELDS + BYTES:
        array = arrays[name]
        if array.dtype != dtype or array.ndim != dimensions or array.shape[:2] != arrays["xyz"].shape[:2]:
            raise InputError(f"{file}: {name} is {array.dtype} of shape {array.shape}: reconstruct it anew")
    return PointMap(**arrays, shared=Shared(*map(float, shared)))
