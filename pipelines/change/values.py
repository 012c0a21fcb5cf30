"""Change and Measurement: the values that comparing two scans gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..instant import Instant, check_instant
from ..scan import Scan
from .motion import Motion
from .noise_model import NoiseModel

__all__ = ["Change", "Comparison", "Measurement", "Metric"]


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """What moved since the baseline, cell by cell.

    Parameters
    ----------
    grid : Grid
    baseline_time : Instant
        The scan it is measured against.
    dz : ndarray of float32, shape (rows, columns)
        Height now minus height then, mm, after `motion`; NaN where either was not measured.
    lod : ndarray of float32, shape (rows, columns)
        Level of detection at 95 %, mm, Lague's or a noise model's (see `difference`); NaN where `dz` is NaN.
    motion : Motion
        What was taken out before subtracting.
    """

    grid: Grid
    baseline_time: Instant
    dz: npt.NDArray[np.float32]
    lod: npt.NDArray[np.float32]
    motion: Motion

    def __post_init__(self) -> None:
        check_instant(self.baseline_time, "baseline time")
        for name in ("dz", "lod"):
            array = getattr(self, name)
            if array.shape != self.grid.shape or array.dtype != np.float32:
                raise ValueError(
                    f"change {name} must be float32 of shape {self.grid.shape}, not {array.dtype} of {array.shape}"
                )

    @property
    def significant(self) -> npt.NDArray[np.bool_]:
        """Cells whose change exceeds their level of detection; False where nothing was measured."""
        return np.abs(self.dz) > self.lod


@dataclass(frozen=True, slots=True)
class Measurement:
    """A value and its standard uncertainty, in the metric's unit; NaN means not measured."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All that a metric may look at: the baseline, the scan moved onto it, and their difference.

    Parameters
    ----------
    baseline : Scan
    scan : Scan
        The later scan, resampled onto the baseline after `change.motion`.
    change : Change
    stable : ndarray of bool, shape (rows, columns)
        Cells that the campaign or the registration holds to be unmoved.
    region : ndarray of bool, shape (rows, columns)
        Cells that count: the campaign's region of interest, less the stable areas.
    noise : NoiseModel, optional
        What the level of detection in `change` rests on; None: on the scans' own sigmas.
    """

    baseline: Scan
    scan: Scan
    change: Change
    stable: npt.NDArray[np.bool_]
    region: npt.NDArray[np.bool_]
    noise: NoiseModel | None = None


@dataclass(frozen=True, slots=True)
class Metric:
    """A number that is followed through time.

    `name` is a Python identifier and the array name in the store; `unit` is UDUNITS ("mm3", "1");
    `title`, `definition` and `uncertainty` (what its standard uncertainty is made of) are what people read.
    """

    name: str
    unit: str
    title: str
    definition: str
    measure: Callable[[Comparison], Measurement]
    uncertainty: str = ""
