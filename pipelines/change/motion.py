"""Motion: how far the rig or the sample moved between two scans, and whether to trust that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

__all__ = ["Motion", "Verdict"]

Verdict = Literal["good", "doubtful", "failed"]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The rigid motion that takes a scan onto its baseline.

    Parameters
    ----------
    matrix : ndarray of float64, shape (4, 4)
        x_baseline = matrix @ x_scan, homogeneous, mm, site frame.
    residual_mm : float
        Robust standard deviation (1.4826 MAD) of dz on the stable areas after the motion.
    overlap : float
        Share of the baseline's measured stable cells that the scan measured too, 0 to 1.
    conditioning : float
        Smallest over largest singular value of the lateral normal equations, 0 (a smooth plane that
        says nothing about x or y) to 1.
    sigma_z_mm : float
        Standard uncertainty of the vertical offset: the systematic part that every cell of dz shares.
    sigma_xy_mm : float
        Standard uncertainty of the lateral offset; NaN where it was not estimated.
    verdict : {"good", "doubtful", "failed"}
    reason : str
        Why the verdict is not good, and that the sample was put back and found again; empty where neither is so.
    covariance : ndarray of float64, shape (6, 6), optional
        Of shifts along x, y, z (mm) and turns about them (rad) at the middle of the stable cells; None where the motion
        was not found by `register`, or was read back from a store.
    """

    matrix: npt.NDArray[np.float64]
    residual_mm: float
    overlap: float
    conditioning: float
    sigma_z_mm: float
    sigma_xy_mm: float
    verdict: Verdict
    reason: str = ""
    covariance: npt.NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if self.matrix.shape != (4, 4) or self.matrix.dtype != np.float64:
            raise ValueError(f"a motion is a 4x4 float64 matrix, not {self.matrix.dtype} {self.matrix.shape}")
        if self.covariance is not None and self.covariance.shape != (6, 6):
            raise ValueError(f"a motion's covariance is 6x6, not {self.covariance.shape}")

    @property
    def shift_mm(self) -> tuple[float, float, float]:
        """Translation (x, y, z) of the site frame's origin."""
        x, y, z = self.matrix[:3, 3]
        return float(x), float(y), float(z)

    @staticmethod
    def none() -> Motion:
        """No motion at all, known exactly: a baseline against itself."""
        return Motion(np.eye(4), 0.0, 1.0, 1.0, 0.0, 0.0, "good")

    @staticmethod
    def guess(matrix: npt.NDArray[np.float64]) -> Motion:
        """A motion that is tried, and that nothing is known of."""
        nan = float("nan")
        return Motion(matrix, nan, 0.0, 0.0, nan, nan, "doubtful", "a guess")

    @staticmethod
    def failed(overlap: float, reason: str) -> Motion:
        """No motion, because none was found."""
        nan = float("nan")
        return Motion(np.eye(4), nan, overlap, 0.0, nan, nan, "failed", reason)
