"""NoiseModel: how much two scans of an unchanged surface differ, by sigma and slope, and how far that reaches."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .smoothing import local_mean

__all__ = ["NoiseCell", "NoiseModel", "local_slope"]

Cells = npt.NDArray[np.float32]
SLOPE_CELLS = 3
"""Heights are averaged over so many cells a side before their slope is taken: noise is no slope."""


@dataclass(frozen=True, slots=True)
class NoiseCell:
    """One bin of what the repeat scans showed: of `count` differences, their 95 % point over 1.96, and what the model
    says there; `beyond` is the share above the model's level of detection, 0 to 1.
    """

    sigma_mm: float
    slope: float
    count: int
    observed_mm: float
    model_mm: float
    beyond: float


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModel:
    """What a difference of two scans is worth, calibrated from scans between which nothing changed.

    ``sd^2 = floor^2 + (gain s)^2 + (sideways slope)^2``, s = sqrt(sigma_1^2 + sigma_2^2) of the two scans' own
    sigmas: what they do not know, what they over- or understate, and what a sideways error makes of a slope.

    Parameters
    ----------
    floor_mm, gain, sideways_mm : float
        None below 0.
    correlation : ndarray of float64, shape (lags,)
        Of the error over its sd, at lags of 0, 1, 2, ... cells; 1 at lag 0, 0 beyond the last.
    pitch_mm : float
        Of those cells.
    sigma_z_mm : float
        Vertical uncertainty of the repeat scans' registrations (median): it is in sd already.
    false_positives : float
        Share of cells beyond the 95 % level of detection, on pairs of scans that the model was not fitted to; NaN where
        there was one pair alone.
    scans, pairs : int
        Scans used, and pairs of them.
    first, last, snapshot, calibration_id, software : str
        Times of the first and the last scan; the store's snapshot; what placed the cells; what worked it out.
    ground : str
        "everything", or "stable areas" where only these were used.
    cells : tuple of NoiseCell
        The bins behind the fit.
    """

    floor_mm: float
    gain: float
    sideways_mm: float
    correlation: npt.NDArray[np.float64]
    pitch_mm: float
    sigma_z_mm: float
    false_positives: float
    scans: int
    pairs: int
    first: str = ""
    last: str = ""
    snapshot: str = ""
    calibration_id: str = ""
    software: str = ""
    ground: str = "everything"
    cells: tuple[NoiseCell, ...] = field(default=())

    def __post_init__(self) -> None:
        for name in ("floor_mm", "gain", "sideways_mm", "sigma_z_mm"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"a noise model's {name} must not be below 0, not {value}")
        if self.correlation.ndim != 1 or self.correlation.size == 0 or abs(self.correlation[0] - 1) > 1e-9:
            raise ValueError("a noise model's correlation is a list that begins with 1, the value at lag 0")
        if not self.pitch_mm > 0:
            raise ValueError(f"a noise model's pitch must be above 0, not {self.pitch_mm}")

    def sd(self, sigma_mm: Cells, slope: Cells) -> Cells:
        """Standard deviation of dz, mm, in float32.

        Parameters
        ----------
        sigma_mm : ndarray of float32
            ``sqrt(sigma_1^2 + sigma_2^2)``; NaN (the maps say none) counts as 0.
        slope : ndarray of float32
            Of the surface, rise over run, as `local_slope` gives it.
        """
        said = np.nan_to_num(sigma_mm)
        variance = self.floor_mm**2 + np.float32(self.gain**2) * said**2 + np.float32(self.sideways_mm**2) * slope**2
        return np.sqrt(variance, dtype=np.float32)

    @property
    def id(self) -> str:
        """Content hash."""
        return hashlib.sha256(self._text().encode()).hexdigest()[:16]

    def to_json(self) -> str:
        """Give the model as JSON, its id among the rest."""
        return json.dumps({"id": self.id, **json.loads(self._text())}, indent=1)

    @classmethod
    def from_json(cls, text: str) -> NoiseModel:
        """Read a model.

        Raises
        ------
        ValueError
            If it is none.
        """
        try:
            given: dict[str, Any] = json.loads(text)
            given.pop("id", None)
            cells = tuple(NoiseCell(**each) for each in given.pop("cells", ()))
            correlation = np.array(given.pop("correlation"), dtype=np.float64)
            if given.get("false_positives") is None:
                given["false_positives"] = float("nan")
            return cls(correlation=correlation, cells=cells, **given)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"is no noise model: {error}") from None

    def _text(self) -> str:
        known = asdict(self)
        known["correlation"] = [round(float(each), 6) for each in self.correlation]
        if not np.isfinite(self.false_positives):
            known["false_positives"] = None
        return json.dumps(known, sort_keys=True)


def local_slope(height: Cells, pitch_mm: float) -> Cells:
    """Steepest slope of a height map, rise over run, after a mean over 3 x 3 cells.

    Parameters
    ----------
    height : ndarray of float32, shape (rows, columns)
        mm, NaN where not measured.
    pitch_mm : float

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        Finite everywhere: beside what is missing the mean of the slopes around, or, where there are none, the slope
        below which 95 % of the map lies; 0 of a map without any.
    """
    if min(height.shape) < 2:
        return np.zeros(height.shape, dtype=np.float32)
    along_y, along_x = np.gradient(local_mean(height, SLOPE_CELLS), np.float32(pitch_mm))
    slope = np.hypot(along_x, along_y).astype(np.float32)
    unknown = ~np.isfinite(slope)
    if unknown.any():
        steep = np.float32(np.quantile(slope[~unknown], 0.95)) if not unknown.all() else np.float32(0)
        around = local_mean(slope, 2 * SLOPE_CELLS - 1)
        slope = np.where(unknown, np.where(np.isfinite(around), around, steep), slope)
    found: Cells = slope
    return found
