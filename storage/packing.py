"""How cells are packed: heights as whole steps, of 0.5 um as a rule, uncertainties as floats of 8 significant bits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from configs import StoreError
from pipelines import Grid, Scan
from pipelines.change import block_means

__all__ = ["BIN", "STEP_MM", "HeightType", "Packing", "fitting_packing", "pack_sigmas", "usual_packing"]

STEP_MM = 0.0005
"""Usual quantum of stored heights; its 0.14 um (step / sqrt 12) is added to sigma in quadrature."""

BIN = 8
"""Cells along each side of a cell of ``/binned``."""

PART_OF_SIGMA, PART_OF_RELIEF = 0.5, 0.02
"""A step is at most this part of sigma, which then grows by 1 %, and of the heights' standard deviation."""

FLOAT32 = 2.0**-23
"""What a float32 tells apart, of its size."""

BLOCK = 2**16
"""Cells that are worked on at a time: they stay in the processor's cache."""

HeightType = Literal["int16", "int32"]
Heights = npt.NDArray[np.float32]
Packed = npt.NDArray[np.signedinteger[Any]]


@dataclass(frozen=True, slots=True)
class Packing:
    """Heights as whole steps; the smallest number means "not measured"."""

    kind: HeightType
    step_mm: float = STEP_MM

    @property
    def fill(self) -> int:
        """What means "not measured"."""
        return int(np.iinfo(self.kind).min)

    @property
    def reach_mm(self) -> float:
        """The largest height that fits."""
        return float(np.iinfo(self.kind).max) * self.step_mm

    @property
    def attributes(self) -> dict[str, Any]:
        """What tells readers of the array, by CF."""
        return {"scale_factor": self.step_mm, "add_offset": 0.0, "_FillValue": self.fill}

    @staticmethod
    def of(array: Any) -> Packing:
        """Read how a Zarr array is packed."""
        return Packing("int16" if array.dtype == np.int16 else "int32", float(array.attrs.get("scale_factor", STEP_MM)))

    def pack(self, values: Heights, what: str) -> Packed:
        """Pack mm into whole steps, NaN into the fill value. Never clips.

        Raises
        ------
        StoreError
            If a value does not fit, or is infinite; `what` names it.
        """
        flat = np.ascontiguousarray(values).reshape(-1)
        packed: Packed = np.empty(flat.shape, self.kind)
        # float32 holds every int16 step exactly to 1/256 of it; larger ranges need float64
        wide = np.float32 if self.kind == "int16" else np.float64
        low, high = np.inf, -np.inf
        for part in _blocks(flat.size):
            steps = flat[part] * wide(1 / self.step_mm)
            np.rint(steps, out=steps)
            low, high = min(low, float(np.fmin.reduce(steps))), max(high, float(np.fmax.reduce(steps)))
            if low < -np.iinfo(self.kind).max or high > np.iinfo(self.kind).max:
                raise self._refusal(low if -low > high else high, what)
            np.copyto(steps, self.fill, where=np.isnan(steps))
            packed[part] = steps
        return packed.reshape(values.shape)

    def unpack(self, packed: Packed) -> Heights:
        """Undo `pack`: float32 mm, NaN where nothing was measured."""
        exact = packed.dtype.itemsize > 2
        values = packed.astype(np.float64) * self.step_mm if exact else packed * np.float32(self.step_mm)
        values[packed == np.iinfo(packed.dtype).min] = np.nan
        return values.astype(np.float32, copy=False)

    def pack_bins(self, values: Heights, what: str) -> Packed:
        """Pack the means of `BIN` x `BIN` cells, over those measured; the last row and column may cover fewer cells."""
        return self.pack(block_means(values, BIN), what)

    def _refusal(self, steps: float, what: str) -> StoreError:
        advice = "check that cell's measurement"
        if self.kind == "int16":
            advice = f"make the store with packing=Packing('int32', {self.step_mm:g}), or {advice}"
        return StoreError(
            f"a {what} of {steps * self.step_mm:.6g} mm does not fit this store's +-{self.reach_mm:.6g} mm: {advice}"
        )


def usual_packing(grid: Grid) -> Packing:
    """Give the packing of surfaces that are rarely higher than they are wide: int16 where half their width fits."""
    widest = max(grid.shape) * grid.pitch_mm
    return Packing("int16" if widest <= 2 * Packing("int16").reach_mm else "int32")


def fitting_packing(scans: Sequence[Scan]) -> Packing:
    """Choose how to pack heights like those of some scans: in the usual step, or a tenth of it, a hundredth and so on.

    The step is small beside each scan's sigma, or its noise where no sigma is known, and beside its relief, unless
    float32 does not tell its heights apart. int16 where twice the largest height fits too.
    """
    tall, aim = 0.0, STEP_MM
    for scan in scans:
        highest, known = float(np.nanmax(np.abs(scan.height))), scan.sigma[np.isfinite(scan.sigma)]
        error = float(np.median(known)) if known.size else _noise(scan.height)
        relief = float(np.nanstd(scan.height, dtype=np.float64))
        bounds = [bound for bound in (PART_OF_SIGMA * error, PART_OF_RELIEF * relief) if bound > 0]
        tall, aim = max(tall, highest), min(aim, max(min(bounds, default=STEP_MM), FLOAT32 * highest))
    step = STEP_MM / 10 ** int(np.ceil(np.log10(STEP_MM / aim) - 1e-9))
    fits = 2 * tall <= Packing("int16", step).reach_mm
    return Packing(usual_packing(scans[0].grid).kind if fits else "int32", step)


def _noise(heights: Heights) -> float:
    """Give the robust standard deviation of what neighbours do not share, by second differences along rows."""
    bends = np.diff(heights.astype(np.float64), 2, axis=-1)
    bends = np.abs(bends[np.isfinite(bends)])
    return float(np.median(bends) / 0.6745 / np.sqrt(6)) if bends.size else 0.0


def pack_sigmas(values: Heights, quantum_mm: float = 0.0) -> Heights:
    """Round to 8 significant bits (0.4 % at most; the rest are zeros that compress to nothing), NaN kept.

    A float needs no range: a sigma of 0.1 um and one of 10 mm are stored alike. `quantum_mm` adds the standard
    uncertainty of rounding to that quantum, quantum / sqrt 12, in quadrature.
    """
    flat = np.ascontiguousarray(values).reshape(-1)
    result: Heights = np.empty(flat.shape, np.float32)
    for part in _blocks(flat.size):
        sigmas = flat[part]
        if quantum_mm:
            sigmas = np.sqrt(np.square(sigmas) + np.float32(quantum_mm**2 / 12))
        bits, rounded = sigmas.view(np.uint32), result[part].view(np.uint32)
        np.right_shift(bits, np.uint32(16), out=rounded)
        rounded &= np.uint32(1)
        rounded += np.uint32(0x7FFF)
        rounded += bits
        rounded &= np.uint32(0xFFFF0000)
        np.copyto(result[part], np.nan, where=np.isnan(sigmas))
    return result.reshape(values.shape)


def _blocks(size: int) -> Iterator[slice]:
    return (slice(first, min(first + BLOCK, size)) for first in range(0, size, BLOCK))
