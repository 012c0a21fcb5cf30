"""Stage axes: the eight ways in which a stage's axes can lie against the site frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["ORIENTATIONS", "in_site"]

Floats = npt.NDArray[np.float64]

ORIENTATIONS: dict[tuple[str, str], Floats] = {
    (f"{a}{first}", f"{b}{'y' if first == 'x' else 'x'}"): np.array(
        [[sa, 0.0], [0.0, sb]] if first == "x" else [[0.0, sb], [sa, 0.0]]
    )
    for first in ("x", "y")
    for a, sa in (("", 1.0), ("-", -1.0))
    for b, sb in (("", 1.0), ("-", -1.0))
}
"""Stage axes to the site frame: ("-x", "y") means that the first axis moves the sample along -x."""


def in_site(stage_mm: Floats, axes: tuple[str, str]) -> Floats:
    """How far the sample was moved in the site frame, from the stage's own coordinates, (tiles, 2 or more), mm."""
    site = stage_mm.astype(np.float64).copy()
    site[:, :2] = stage_mm[:, :2] @ ORIENTATIONS[axes].T
    return site
