"""Local integration: where stripes are too faint for one pixel, the sum over a small window is decoded (paper, 4.2)."""

from __future__ import annotations

from math import sqrt
from typing import cast

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs
from .cells import Cells
from .decode import LEAST_SWING, SURE_LIT, GrayPass, decode_steps
from .edge_kernels import along_columns, along_rows, levels_of
from .fallback import DIRECT
from .frames import Frames
from .integration_kernels import MARGIN, box_sums, judge, off_centre
from .kernels import NO_CELL
from .light import ROUNDING, Light, frame_indices, frame_of
from .line_pictures import Stack, every, line_pictures
from .pixel_maps import Decoded
from .threshold import tilt_of

__all__ = ["integrate"]

REACHES = (1, 2)
"""Windows of 3x3 and of 5x5 pixels."""
FAINT = 3.0
"""Pixels up to so many times as bright as one that is just lit may be summed: brighter ones would outweigh the rest."""
SPILL = ((4, FAINT), (12, 8.0))
"""Within so many camera px nothing may be so many times as bright as a pixel that is just lit: what is faint there may
be its light, spilt by the lens into a shadow, with its codes. A blur as wide as the finest stripes that can still be
told apart has ended at the first; at the second a lens that spills an eighth so far shows no stripes any more."""
BAND, HALO = 224, 32  # rows that are summed at once, in whole tiles; rows beside them that the edges of cells lie in
SAMPLE = 20000

Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


def integrate(frames: Frames, cells: Decoded, found: Decoded, light: Light) -> Decoded:
    """Add the pixels that were not decoded because they are too faint.

    Such a pixel is not lit, or lit by less than `FAINT` times what it takes and in doubt where the noise, not a share
    of its light, was the limit. The frames are summed over 3x3 pixels around it, or 5x5 where that does not suffice,
    not beside what is bright (`SPILL`), and the sums are decoded as a capture of 16 bits, as strictly as where coarser
    stripes stand in (`fallback.fall_back`), against the noise of the sum. So shadow stays shadow: nothing adds up
    there; and light thrown by walls, which has lost its fine stripes, fails the share of white minus black that each
    pattern must have. Where windows smear the finest stripes, coarser ones are read. A pixel stays if the map goes on
    straight to it from places of other windows, and not if its window spans a step (`integration_kernels.judge`).
    Pixels that were decoded before are not changed.

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
    wanted = _faint(frames, cells)
    if wanted.any():
        work = _Work(frames, cells, found, light, wanted)
        rows = len(wanted)
        new = in_slabs(-(-rows // BAND), lambda first, last: [work.band(n * BAND) for n in range(first, last)], least=1)
        for band in (each for part in new for each in part):
            band.fill(found)
    return found


def _faint(frames: Frames, cells: Cells) -> Mask:
    """Pixels that are missing for want of contrast only, and whose windows hold none that is saturated or bright."""
    from scipy.ndimage import maximum_filter

    top = np.iinfo(frames.stack.dtype).max
    missing = np.zeros(cells.contrast.shape, np.bool_)
    for axis, step in zip(cells.axes, cells.steps, strict=True):
        if axis is not None:
            missing |= step == NO_CELL
    white, black = (frames.stack[frame_of(frames.patterns, what)] for what in ("white", "black"))
    full = (white == top) | (black == top)
    least = _least(frames, cells)
    missing &= (cells.contrast < FAINT * least) & ~full
    if not missing.any():
        return missing
    for reach, times in SPILL:
        missing &= maximum_filter(cells.contrast, 2 * reach + 1) < times * least
    if full.any():
        missing &= ~maximum_filter(full, 2 * max(REACHES) + 1)
    return missing


def _least(frames: Frames, cells: Cells) -> float:
    """White minus black of a pixel that is just lit, in units of contrast."""
    return SURE_LIT * sqrt(2) * max(cells.noise, ROUNDING / 256.0 ** (frames.stack.itemsize - 1))


class _Band:
    """What was added in some rows of the image."""

    def __init__(self, rows: slice, window: npt.NDArray[np.uint8]) -> None:
        self.rows = rows
        self.level = window  # 0 where nothing was added
        self.places: dict[int, tuple[Floats, Floats]] = {}

    def fill(self, found: Decoded) -> None:
        """Put what is new into `found`; an axis that was decoded stays as it is."""
        kept = self.level > 0
        for axis, new in self.places.items():
            at, said = (found.column, found.sigma_column) if axis == 0 else (found.row, found.sigma_row)
            missing = kept & np.isnan(at[self.rows])
            at[self.rows][missing], said[self.rows][missing] = new[0][missing], new[1][missing]
        found.level[self.rows][kept] = self.level[kept]


class _Work:
    """What all bands need of one capture."""

    def __init__(self, frames: Frames, cells: Cells, found: Decoded, light: Light, wanted: Mask) -> None:
        self.frames, self.cells, self.light, self.wanted = frames, cells, light, wanted
        self.stack = cast(Stack, np.ascontiguousarray(frames.stack))
        self.axes = [number for number, axis in enumerate(cells.axes) if axis is not None]
        self.at = [(found.column, found.row)[axis] for axis in self.axes]
        self.said = [(found.sigma_column, found.sigma_row)[axis] for axis in self.axes]
        scale = 256.0 ** (frames.stack.itemsize - 1)
        self.sd = max(_noise(frames, wanted, cells.noise * scale), ROUNDING)
        self.brightest = FAINT * _least(frames, cells) * scale

    def band(self, first: int) -> _Band:
        """Read, place and judge the faint pixels of a band of rows."""
        last = min(first + BAND, len(self.wanted))
        top, bottom = max(first - HALO, 0), min(last + HALO, len(self.wanted))
        own, inner = slice(top, bottom), slice(first - top, last - top)
        left = self.wanted[own].copy()
        window, level = np.zeros(left.shape, np.uint8), np.zeros(left.shape, np.uint8)
        places = np.stack([at[own] for at in self.at])
        variances = np.stack([said[own] ** 2 for said in self.said])
        for reach in REACHES:
            if left[inner].any():
                self._read(reach, own, left, window, level, places, variances)
        band = _Band(slice(first, last), self._judged(own, inner, window, level, places, variances))
        for n, axis in enumerate(self.axes):
            band.places[axis] = places[n, inner], variances[n, inner]
        return band

    def _read(
        self,
        reach: int,
        own: slice,
        left: Mask,
        window: npt.NDArray[np.uint8],
        level: npt.NDArray[np.uint8],
        places: Floats,
        variances: Floats,
    ) -> None:
        """Decode and place what a window of this reach suffices for; takes it from what is left."""
        count, size = (2 * reach + 1) ** 2, left.shape
        spread = self.sd * sqrt(count)
        gain = 65535 / (count * self.brightest + 12 * spread)
        sums = np.empty((len(self.stack), *size), np.uint16)
        box_sums(self.stack, frame_of(self.frames.patterns, "black"), reach, gain, 6 * spread * gain, own.start, sums)
        summed = Frames(sums, self.frames.time, self.frames.patterns)
        # below a count a pixel rounding hides what there is
        given = GrayPass(summed, LEAST_SWING, spread * gain, least=count * gain, direct=1 / DIRECT)
        steps, contrast = (np.empty(size, np.uint16), np.empty(size, np.uint16)), np.empty(size, np.uint8)
        decode_steps(given, self.cells.levels, steps, contrast)
        read = left.copy()
        for axis in self.axes:
            read &= steps[axis] != NO_CELL
        for n, axis in enumerate(self.axes):
            place, variance = self._place(summed, axis, steps[axis], contrast, given.sd)
            # neighbouring windows share all but a side's length of their pixels, and as much of their noise
            variance *= 1 + reach / (2 * reach + 1)
            places[n][read], variances[n][read] = place[read], np.abs(variance[read])
            levels_of(np.where(read, steps[axis], np.uint16(1)).reshape(-1), level.reshape(-1))
        window[read] = reach
        left &= ~read

    def _place(
        self, summed: Frames, axis: int, step: npt.NDArray[np.uint16], contrast: npt.NDArray[np.uint8], noise: float
    ) -> tuple[Floats, Floats]:
        """Place within their cells the pixels that were read of one axis; variances are negative without two edges."""
        cells = self.cells.axes[axis]
        assert cells is not None
        tilt = tilt_of(axis, self.cells.levels, self.light)
        down, pictures, _ = line_pictures(summed, summed.stack, axis, cells, every(step), noise, tilt)
        place, variance = np.empty(step.shape, np.float32), np.empty(step.shape, np.float32)
        (along_columns if down else along_rows)(
            pictures, step, contrast, 0, step.shape[1 if down else 0], place, variance
        )
        return place, variance

    def _judged(
        self,
        own: slice,
        inner: slice,
        window: npt.NDArray[np.uint8],
        level: npt.NDArray[np.uint8],
        places: Floats,
        variances: Floats,
    ) -> npt.NDArray[np.uint8]:
        """Level of the pixels of the band that stay, 0 elsewhere; variances become sigmas."""
        kept, sigmas = np.zeros(window[inner].shape, np.uint8), np.sqrt(variances)
        # contiguous in memory, as vectors need it
        rows = slice(inner.start, inner.stop + 2 * MARGIN)
        wide = [(0, 0), (MARGIN, MARGIN), (MARGIN, MARGIN)]
        around, unsure = (
            np.ascontiguousarray(np.pad(each, wide, constant_values=np.nan)[:, rows]) for each in (places, variances)
        )
        white, black = (self.stack[frame_of(self.frames.patterns, what)][own] for what in ("white", "black"))
        for reach in REACHES:
            if not (window[inner] == reach).any():
                continue
            good, sigma = np.empty(kept.shape, np.bool_), np.empty((len(places), *kept.shape), np.float32)
            off = np.empty((2, *window.shape), np.float32)
            off_centre(white, black, reach, self.sd, off)
            judge(around, unsure, np.ascontiguousarray(off[:, inner]), reach, good, sigma)
            good &= window[inner] == reach
            kept[good] = np.maximum(level[inner][good], reach)
            sigmas[:, inner][:, good] = sigma[:, good]
        variances[:] = sigmas
        return kept


def _noise(frames: Frames, faint: Mask, usual: float) -> float:
    """Noise of the faint pixels, counts: pattern and inverse add up to the same in every pair. `usual` without."""
    bits, plus, minus = frame_indices(frames.patterns)
    of = np.arange(plus.shape[1]) < bits[:, np.newaxis]
    pairs = list(zip(plus[of], minus[of], strict=True))
    if any(inverse < 0 for _, inverse in pairs) or len(pairs) < 3:
        return usual
    at = np.flatnonzero(faint)
    at = at[:: max(1, len(at) // SAMPLE)]
    flat = frames.stack.reshape(len(frames.stack), -1)
    sums = np.array([flat[pattern][at].astype(np.float32) + flat[inverse][at] for pattern, inverse in pairs])
    sums -= np.median(sums, axis=1, keepdims=True)  # the lamp's own changes
    return float(np.sqrt(np.median(sums.var(axis=0, ddof=1)) / 2))
