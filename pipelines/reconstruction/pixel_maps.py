"""Decoded and PointMap: what is known of each camera pixel, before and after triangulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Decoded", "PointMap", "Shared"]


class Shared(NamedTuple):
    """Variance that neighbouring lines of an image have in common, so that a mean over lines does not make it less."""

    within: float = 0.0
    """A part of what sigma says."""
    beside: float = 0.0
    """What it does not say: errors of edges that all lie alike in their pixels."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """The projector position seen by each camera pixel.

    Parameters
    ----------
    column, row : ndarray of float32, shape (row, column)
        Projector pixels, pixel centres integer; NaN where not decoded or the axis was not projected.
    sigma_column, sigma_row : ndarray of float32, shape (row, column)
        Standard uncertainty of those, projector px; NaN likewise.
    level : ndarray of uint8, shape (row, column)
        As `Scan.level`.
    texture : ndarray of uint8, shape (row, column)
        The white frame, scaled to 8 bits.
    contrast : ndarray of uint8, shape (row, column)
        White minus black, scaled to 8 bits.
    shared : (Shared, Shared)
        Of column and of row, px squared.
    """

    column: npt.NDArray[np.float32]
    row: npt.NDArray[np.float32]
    sigma_column: npt.NDArray[np.float32]
    sigma_row: npt.NDArray[np.float32]
    level: npt.NDArray[np.uint8]
    texture: npt.NDArray[np.uint8]
    contrast: npt.NDArray[np.uint8]
    shared: tuple[Shared, Shared] = (Shared(), Shared())


@dataclass(frozen=True, slots=True, eq=False)
class PointMap:
    """A 3D point per camera pixel, in the camera frame; what ``reconstruct --out F.npz`` writes.

    Parameters
    ----------
    xyz : ndarray of float32, shape (row, column, 3)
        mm, camera frame; NaN where not measured.
    sigma_z : ndarray of float32, shape (row, column)
        Standard uncertainty along the camera's axis, mm; NaN likewise.
    projector : ndarray of float32, shape (row, column, 2)
        (column, row) on the projector, px.
    level, texture : ndarray of uint8, shape (row, column)
        As in `Decoded`.
    shared : Shared
        Of the distance along the camera's axis, mm squared.
    """

    xyz: npt.NDArray[np.float32]
    sigma_z: npt.NDArray[np.float32]
    projector: npt.NDArray[np.float32]
    level: npt.NDArray[np.uint8]
    texture: npt.NDArray[np.uint8]
    shared: Shared = Shared()  # noqa: RUF009  # a frozen value

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """Pixels that were measured."""
        return np.isfinite(self.sigma_z)
