"""Local integration: where stripes are too faint for one pixel, the sum over a small window is decoded (paper, 4.2)."""

from __future__ import annotations

from math import ceil, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs
from .cells import AxisCells, Cells
from .decode import LEAST_SWING, SURE_LIT
from .fallback import MOST_LEVELS
from .frames import Frames
from .integration_kernels import NOT_READ, Code, judge, place_sums, read_sums
from .light import ROUNDING, Light, frame_indices, frame_of
from .pixel_maps import Decoded
from .threshold import tilt_of

__all__ = ["integrate"]

REACHES = (1, 2)
"""Windows of 3x3 and of 5x5 pixels."""
FAINT = 3.0
"""Pixels up to so many times as bright as one that is just lit may be summed: brighter ones would outweigh the rest."""
SPILL = ((4, FAINT), (12, 8.0))
"""Within so many camera px nothing may be so many times as bright as a pixel that is just lit: what is faint there may
be its light, spilt by the lens into a shadow, with its codes."""
SMEAR_PX = 3.0
"""A window may span so many projector px of the finest stripes' period of 4: over all of it nothing would be left."""
RASTER = 16
"""Camera px over which the growth of the map is measured."""
FEW = 50
SAMPLE = 20000

Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


def integrate(frames: Frames, cells: Decoded, found: Decoded, light: Light) -> Decoded:
    """Add the pixels that were not decoded because they are too faint.

    Such a pixel is not lit, or lit by less than `FAINT` times what it takes and in doubt where the noise, not a share
    of its light, was the limit. The frames are summed over 3x3 pixels around it, or 5x5 where that does not suffice,
    not beside what is bright (`SPILL`), and the sums are decoded by the rules of single pixels against the noise of
    the sum. So shadow stays shadow: nothing adds up there; and light thrown by walls, which has lost its fine stripes,
    fails the share of white minus black that each pattern must have. Of a window that would smear the finest stripes,
    coarser ones are read. A pixel stays if the map goes on straight to it from places of other windows, and not if its
    window spans a step (`integration_kernels.judge`). Pixels that were decoded before are not changed.

    Parameters
    ----------
    frames : Frames
    cells : Decoded
        Of `decode`; only Gray code is integrated, anything else is given back as it is.
    found : Decoded
        Of `refine`; filled in place.
    light : Light
        Of these frames.

    Returns
    -------
    Decoded
        `found`. Where a pixel was added `level` is at least 1 (3x3 pixels) or 2 (5x5), and sigma holds the noise of
        the sum and what the window smears: how far its light's centre is off its middle, times the slope of the map,
        and the bend of the map over it. Neighbours within a window share their noise.
    """
    if not isinstance(cells, Cells):
        return found
    wanted, usable = _faint(frames, cells)
    if not wanted.any():
        return found
    work = _Work(frames, cells, light, wanted, usable)
    growth = work.growth(found)
    if growth is None:
        return found
    numbers, window, levels = work.read(growth)
    if not window.any():
        return found
    work.add(found, numbers, window, levels, growth)
    return found


def _faint(frames: Frames, cells: Cells) -> tuple[Mask, Mask]:
    """Pixels that are missing for want of contrast only, and those that may be summed."""
    top = np.iinfo(frames.stack.dtype).max
    scale = 256.0 ** (frames.stack.itemsize - 1)
    least = SURE_LIT * sqrt(2) * max(cells.noise, ROUNDING / scale)
    white, black = (frames.stack[frame_of(frames.patterns, what)] for what in ("white", "black"))
    usable = (cells.contrast < FAINT * least) & (white < top) & (black < top)
    missing = np.zeros(usable.shape, np.bool_)
    for axis, step in zip(cells.axes, cells.steps, strict=True):
        if axis is not None:
            missing |= step == 0
    missing &= usable
    if missing.any():
        from scipy.ndimage import maximum_filter

        for reach, times in SPILL:
            missing &= maximum_filter(cells.contrast, 2 * reach + 1) < times * least
    return missing, usable


class _Work:
    """What all steps need of one capture."""

    def __init__(self, frames: Frames, cells: Cells, light: Light, wanted: Mask, usable: Mask) -> None:
        patterns = frames.patterns
        self.stack = np.ascontiguousarray(frames.stack)
        self.white, self.black = frame_of(patterns, "white"), frame_of(patterns, "black")
        self.wanted, self.usable = wanted, usable
        self.axes = [number for number, axis in enumerate(cells.axes) if axis is not None]
        bits, plus, minus = frame_indices(patterns)
        self.codes = tuple(
            _code(frames, axis, cells, light, int(bits[axis]), plus[axis], minus[axis]) for axis in self.axes
        )
        scale = 256.0 ** (frames.stack.itemsize - 1)
        pairs = [(code.plus[bit], code.minus[bit]) for code in self.codes for bit in range(code.bits)]
        self.sd = max(_noise(self.stack, usable, pairs, cells.noise * scale), ROUNDING)
        self.swing_sd = self.sd * sqrt(2 if patterns.complementary else 6)

    def growth(self, found: Decoded) -> npt.NDArray[np.float64] | None:
        """Projector px per camera px, (axis, down or along), of the map that is there, or else of the sums."""
        places = [(found.column, found.row)[axis] for axis in self.axes]
        growth = np.array([[_rise(place, way) for way in (0, 1)] for place in places])
        if np.isfinite(growth).all():
            return growth
        numbers, window = self._room()
        zeros = np.zeros(len(self.axes), np.int64)
        for reach in REACHES:
            self._read(reach, zeros, numbers, window, every=RASTER)
        places = [
            np.where(window > 0, code.edge[np.clip(number, 0, len(code.edge) - 1)], np.float32(np.nan))
            for code, number in zip(self.codes, numbers, strict=True)
        ]
        growth = np.array([[_rise(place, way) for way in (0, 1)] for place in places])
        return growth if np.isfinite(growth).all() else None

    def read(
        self, growth: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
        """Read each wanted pixel from the smallest window that suffices: numbers, reaches, and levels left out."""
        numbers, window = self._room()
        levels = np.zeros((len(self.axes), max(REACHES) + 1), np.int64)
        for reach in REACHES:
            smear = (2 * reach + 1) * growth.sum(axis=1)
            levels[:, reach] = [max(0, ceil(np.log2(max(px, 1e-3) / SMEAR_PX))) for px in smear]
            if (levels[:, reach] <= MOST_LEVELS).all():
                self._read(reach, levels[:, reach], numbers, window)
        return numbers, window, levels

    def add(
        self,
        found: Decoded,
        numbers: npt.NDArray[np.int32],
        window: npt.NDArray[np.uint8],
        levels: npt.NDArray[np.int64],
        growth: npt.NDArray[np.float64],
    ) -> None:
        """Place what was read, judge it, and put what stays into `found`."""
        at = [(found.column, found.row)[axis] for axis in self.axes]
        said = [(found.sigma_column, found.sigma_row)[axis] for axis in self.axes]
        places, sigmas = np.stack(at), np.stack(said)
        variances = np.square(sigmas)
        for n, code in enumerate(self.codes):
            down = int(growth[n, 0] > growth[n, 1])
            rise = float(growth[n].max())

            def slab(first: int, last: int, n: int = n, code: Code = code, way: tuple[Any, ...] = (rise, down)) -> None:
                place_sums(
                    self.stack, self.white, self.black, code, numbers[n], self.usable, window, levels[n], *way,
                    self.swing_sd, first, last, places[n], variances[n],
                )  # fmt: skip

            in_slabs(len(window), slab)
        kept = np.zeros(window.shape, np.bool_)
        in_slabs(
            len(window),
            lambda first, last: judge(
                self.stack, self.white, self.black, places, variances, self.usable, window, self.sd, first, last,
                sigmas, kept,
            ),
        )  # fmt: skip
        for n in range(len(self.axes)):
            new = kept & np.isnan(at[n])  # an axis that was decoded stays as it is
            at[n][new], said[n][new] = places[n][new], sigmas[n][new]
        left_out = levels.max(axis=0)[window[kept]]
        found.level[kept] = np.maximum(window[kept], left_out).astype(np.uint8)

    def _room(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.uint8]]:
        shape = self.wanted.shape
        return np.full((len(self.axes), *shape), NOT_READ, np.int32), np.zeros(shape, np.uint8)

    def _read(
        self,
        reach: int,
        levels: npt.NDArray[np.int64],
        numbers: npt.NDArray[np.int32],
        window: npt.NDArray[np.uint8],
        every: int = 1,
    ) -> None:
        in_slabs(
            len(window),
            lambda first, last: read_sums(
                self.stack, self.white, self.black, self.codes, self.wanted, self.usable, reach, levels, LEAST_SWING,
                self.sd, self.swing_sd, every, first, last, numbers, window,
            ),
        )  # fmt: skip


def _code(
    frames: Frames,
    axis: int,
    cells: Cells,
    light: Light,
    bits: int,
    plus: npt.NDArray[np.int64],
    minus: npt.NDArray[np.int64],
) -> Code:
    own: AxisCells | None = cells.axes[axis]
    assert own is not None
    flips = own.flips[:, 0].astype(np.int64)
    return Code(
        plus[:bits],
        minus[:bits],
        bits,
        own.lowest,
        own.highest,
        own.edge,
        flips,
        tilt_of(axis, cells.levels, light)[:bits],
    )


def _noise(stack: npt.NDArray[np.generic], usable: Mask, pairs: list[tuple[int, int]], usual: float) -> float:
    """Noise of the faint pixels, counts: pattern and inverse add up to the same in every pair. `usual` without."""
    if any(minus < 0 for _, minus in pairs) or len(pairs) < 3:
        return usual
    at = np.flatnonzero(usable)
    at = at[:: max(1, len(at) // SAMPLE)]
    flat = stack.reshape(len(stack), -1)
    sums = np.array([flat[plus][at].astype(np.float32) + flat[minus][at] for plus, minus in pairs])
    sums -= np.median(sums, axis=1, keepdims=True)  # the lamp's own changes
    return float(np.sqrt(np.median(sums.var(axis=0, ddof=1)) / 2))


def _rise(place: Floats, way: int) -> float:
    """Median growth of a place per camera px along one way of the image; NaN where too little of it is known."""
    rows = place[::RASTER]
    change = np.abs(np.diff(rows, axis=0) if way == 0 else rows[:, RASTER:] - rows[:, :-RASTER]) / RASTER
    known = change[np.isfinite(change)]
    return float(np.median(known)) if known.size >= FEW else float("nan")
