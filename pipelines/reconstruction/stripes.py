"""Soft decoding of equal-width stripes: the place whose blurred stripes look most like what the pixel saw.

In the paper's table every other boundary flips several bits at once, and half the ways to misread it are another valid
word. Bits are therefore not decided one by one. What a pixel saw is a vector of swings, one per pattern, between -1 and
1; what it should see at a place is the same vector for the stripes as drawn, blurred as the capture itself is. On the
curve that this vector runs through along the axis no two places far apart come near each other, boundaries included,
until the second finest stripes are lost too. The nearest point of the curve is the place, to a fraction of a pixel.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import cast

import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from ..slabs import in_slabs
from .frames import Frames
from .light import frame_of
from .patterns import AXES, Axis
from .pixel_maps import Decoded
from .settle import keep_surfaces, rise_px
from .stripe_kernels import StripePlaces, StripeView, locate_pixels, reject_washed
from .stripe_model import SwingModel, apart, swing_model
from .stripe_swings import tile_power

__all__ = ["decode_stripes"]

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]
Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

TILE = 16
"""Blur is measured in tiles of so many camera pixels, each with the tiles around it."""
FINE = 3
"""By so many of the finest patterns: the coarser ones hardly know blur."""
FLOOR = 0.02
"""Least error of the model, of the swing; up to three times more where the capture itself shows more."""
MARGIN = 20.0
"""The best place costs so much less than any far one: a likelihood of 1 to 20,000."""
PASSED_CELLS, MOST_AWAY = 1.5, 32
"""A surface has passed a boundary after so many cells; but no farther than so many camera pixels is looked."""
TRIAL_ROWS = 24
GROSS = 0.3
"""A swing that misses the model by more tells nothing of flicker."""


def decode_stripes(frames: Frames, noise: float, into: Decoded) -> None:
    """Place each camera pixel along the axes of a stripe set.

    A pixel is rejected if it is unlit, if no place looks like what it saw, if two places far apart do, or if it lies on
    no surface that its neighbours show.

    Parameters
    ----------
    frames : Frames
        Of a stripe set.
    noise : float
        Standard deviation of a pixel's value, counts.
    into : Decoded
        Filled: places, sigmas and `level`, which counts the finest patterns that the noise hides on either axis.
    """
    into.level[:] = 0
    for number, (axis, place, sigma) in enumerate(
        zip(AXES, (into.column, into.row), (into.sigma_column, into.sigma_row), strict=True)
    ):
        if not frames.patterns.bits[number]:
            place[:], sigma[:] = np.nan, np.nan
            continue
        coarser = _along(_Job(frames, axis, noise), place, sigma)
        np.maximum(into.level, coarser, out=into.level)
    for number, place in enumerate((into.column, into.row)):
        if frames.patterns.bits[number]:
            into.level[np.isnan(place)] = LEVEL_NONE


def _along(job: _Job, place: F32, sigma: F32) -> U8:
    """Fill place and sigma of one axis; how many of the finest patterns are lost in the noise."""
    rows = len(place)
    found = StripePlaces.room((rows, place.shape[1]))
    washed = np.empty(place.shape, np.bool_)
    job.learn()
    in_slabs(rows, lambda first, last: job.locate(np.arange(first, last), found.rows(first, last)))
    cell = job.model.cell_px
    away = min(MOST_AWAY, min(place.shape) // 8, ceil(PASSED_CELLS * cell / max(rise_px(found.place), 0.05)))
    in_slabs(rows, lambda first, last: reject_washed(found.place, found.blank, away, 0.5 * cell, first, last, washed))
    found.place[washed] = np.nan
    keep_surfaces(found.place, found.sigma, found.cost / np.float32(job.model.bits), place, sigma, cell_px=cell)
    return found.coarser


class _Job:
    """One axis of one capture: its model, its blur, and what its frames' light adds to the swings."""

    def __init__(self, frames: Frames, axis: Axis, noise: float) -> None:
        patterns = frames.patterns
        self.model: SwingModel = swing_model(patterns, axis)
        bits = self.model.bits
        self.stack = cast(Stack, np.ascontiguousarray(frames.stack))
        self.plus, self.minus = np.full((2, bits), -1, np.int64)
        self.white, self.black = (frame_of(frames.patterns, what) for what in ("white", "black"))
        for number, role in enumerate(patterns.roles):
            if role.axis == axis:
                (self.minus if role.inverted else self.plus)[role.index] = number
        self.noise = noise * sqrt(2 if patterns.complementary else 6)
        self.lit = 6 * sqrt(2) * noise
        self.floor = FLOOR
        self.shift, self.gain = np.zeros(bits, np.float32), np.ones(bits, np.float32)
        self.worst = bits + 5 * sqrt(2 * bits)
        self.blur = self._tile_blur()
        self.unlike = np.zeros(self.model.swing.shape[:2], np.float32)
        for blur in np.unique(self.blur):
            self.unlike[blur] = apart(patterns, axis, int(blur))
        self.loosest = self.model.loose.max(axis=(1, 2))

    def _tile_blur(self) -> U8:
        """Which blur of the model each tile has: the finest patterns keep a share of the power that falls with it."""
        from scipy.ndimage import uniform_filter

        model = self.model
        rows, columns = self.stack.shape[1:]
        tiles = -(-rows // TILE), -(-columns // TILE)
        power, weight = np.empty((*tiles, model.bits)), np.empty(tiles)
        given = self.stack, self.white, self.black, self.plus, self.minus, TILE, self.lit, self.noise**2
        in_slabs(tiles[0], lambda first, last: tile_power(*given, power, weight, first, last), least=4)
        kept = uniform_filter(power[..., -FINE:].sum(axis=-1), 3, mode="nearest")
        weight = uniform_filter(weight, 3, mode="nearest")
        whole = weight > 0
        share = np.divide(kept, weight, out=np.full(tiles, kept.sum() / max(weight.sum(), 1.0)), where=whole)
        expected = model.power[:, -FINE:].sum(axis=1)
        between = (expected[1:] + expected[:-1]) / 2
        blur: U8 = np.searchsorted(-between, -share).astype(np.uint8)
        return blur

    def locate(self, rows: I64, found: StripePlaces) -> None:
        """Fill the arrays for some rows, by `stripe_kernels.locate_pixels`."""
        model = self.model
        view = StripeView(
            stack=self.stack,
            white=self.white,
            black=self.black,
            plus=self.plus,
            minus=self.minus,
            shift=self.shift,
            gain=self.gain,
            blur=self.blur,
            tile=TILE,
            swing=model.swing,
            comb=model.comb,
            loose=model.loose,
            loosest=self.loosest,
            power=model.power,
            blank=model.blank,
            first=model.first,
            candidate=model.candidate,
            unlike=self.unlike,
            per_px=model.per_px,
            near=round(model.near_px * model.per_px),
            lit=self.lit,
            noise=self.noise,
            floor=self.floor,
            margin=MARGIN,
            worst=self.worst,
        )
        locate_pixels(view, rows, found)

    def learn(self) -> None:
        """Learn from some rows what flicker of the light does to each bit, and how well the model fits at all."""
        height, width = self.stack.shape[1:]
        rows = np.unique(np.linspace(0, height - 1, TRIAL_ROWS).astype(np.int64))
        found = StripePlaces.room((len(rows), width))
        self.floor = 3 * FLOOR  # before flicker is known
        self.locate(rows, found)
        self._learn_flicker(rows, found.place)
        self.floor = FLOOR
        for _ in range(4):
            self.locate(rows, found)
            known = found.cost[np.isfinite(found.cost)]
            if not known.size or np.median(known) < self.model.bits - 1:
                return
            self.floor *= 1.5

    def _learn_flicker(self, rows: I64, place: F32) -> None:
        """Fit what is seen of each bit as a straight line of what is expected.

        Light that is brighter by a in a pattern and by b in its inverse turns a swing s into (1 + (a + b) / 2) s +
        (a - b) / 2; without an inverse, into (1 + a) s + a.
        """
        line, column = np.nonzero(np.isfinite(place))
        if len(line) < 50:
            return
        at = rows[line]
        model = self.model
        white = self.stack[self.white, at, column].astype(np.float32)
        black = self.stack[self.black, at, column].astype(np.float32)
        sample = np.rint((place[line, column] + 0.5) * model.per_px - 0.5).astype(np.int64)
        expected = model.swing[self.blur[at // TILE, column // TILE], sample.clip(0, model.swing.shape[1] - 1)]
        for bit in range(model.bits):
            p = self.stack[self.plus[bit], at, column].astype(np.float32)
            n = self.stack[self.minus[bit], at, column] if self.minus[bit] >= 0 else white + black - p
            seen, e = (p - n) / (white - black), expected[:, bit]
            good = np.abs(seen - e) < GROSS
            if good.sum() < 50 or e[good].var() < 0.05:
                continue
            gain, shift = np.polyfit(e[good], seen[good], 1)
            self.shift[bit], self.gain[bit] = shift, 1 / min(max(gain, 0.8), 1.25)
