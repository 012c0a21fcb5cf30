"""Vital signs of a capture: how bright, how saturated, how dark the dark; and the exposure that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from configs import AutoExposure
from pipelines import Frames

__all__ = ["VitalSigns", "next_exposure", "over_captures", "vital_signs"]

COARSE = 4
"""Every so manieth row and column is looked at: a percentile of 200,000 pixels is as good as one of three million."""

BRIGHT_PERCENTILE = 99.0
MOST_SATURATED = 0.01
LEAST_BRIGHT, WANTED_BRIGHT = 0.45, 0.75
"""Parts of the full scale: below the first the exposure is lengthened until the second is reached."""

SHORTER = 0.7
LARGEST_STEP = 2.0


@dataclass(frozen=True, slots=True)
class VitalSigns:
    """What a capture says of lamp, lens and room, from its white and its black frame.

    Parameters
    ----------
    bright : float
        99th percentile of the white frame, as a part of the full scale.
    light : float
        Median of white less black, as a part of the full scale: what the lamp gives. NaN without such frames.
    dark : float
        Median of the black frame against that of the white one: the room's light, and what dust on a lens scatters.
    saturated : float
        Part of the white frame's pixels that are at the end of the scale.
    exposure_ms : float
        NaN where unknown.
    """

    bright: float
    light: float
    dark: float
    saturated: float
    exposure_ms: float

    @property
    def lamp(self) -> float:
        """Light per millisecond of exposure: falls as a lamp ages, whatever the exposure does."""
        return self.light / self.exposure_ms if self.exposure_ms > 0 else float("nan")


def vital_signs(frames: Frames) -> VitalSigns:
    """Look at a capture."""
    kinds = [role.what for role in frames.patterns.roles]
    full = float(np.iinfo(frames.stack.dtype).max)
    if frames.stack.dtype == np.uint16:  # cameras of 10 and 12 bits in words of 16
        full = float(2 ** int(np.ceil(np.log2(max(2, int(frames.stack[0].max()) + 1)))) - 1)
    if "white" not in kinds or "black" not in kinds:
        nan = float("nan")
        return VitalSigns(nan, nan, nan, nan, frames.exposure_ms)
    white = frames.stack[kinds.index("white"), ::COARSE, ::COARSE]
    black = frames.stack[kinds.index("black"), ::COARSE, ::COARSE]
    level = float(np.median(white))
    return VitalSigns(
        bright=float(np.percentile(white, BRIGHT_PERCENTILE)) / full,
        light=(level - float(np.median(black))) / full,
        dark=float(np.median(black)) / max(level, 1.0),
        saturated=float((white >= full).mean()),
        exposure_ms=frames.exposure_ms,
    )


def over_captures(signs: Sequence[VitalSigns]) -> VitalSigns:
    """Say of the captures of one visit what one would say: the brightest and most saturated, the median of the rest."""
    known = [each for each in signs if np.isfinite(each.bright)]
    if len(known) < 2:
        return (known or signs)[0]
    return VitalSigns(
        bright=max(each.bright for each in known),
        light=median(each.light for each in known),
        dark=median(each.dark for each in known),
        saturated=max(each.saturated for each in known),
        exposure_ms=median(each.exposure_ms for each in known),
    )


def next_exposure(signs: VitalSigns, bounds: AutoExposure) -> float:
    """Give the exposure of the next visit, ms: shorter where pixels saturate, longer where all is dark, else the same.

    Between the two lies a wide band where nothing is changed, so that it does not swing.
    """
    now = signs.exposure_ms
    if not (np.isfinite(now) and np.isfinite(signs.bright)):
        return now
    wanted = now
    if signs.saturated > MOST_SATURATED:
        wanted = now * SHORTER
    elif signs.bright < LEAST_BRIGHT:
        wanted = now * min(LARGEST_STEP, WANTED_BRIGHT / max(signs.bright, 1e-3))
    return float(np.clip(wanted, bounds.shortest_ms, bounds.longest_ms))
