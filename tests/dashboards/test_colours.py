"""Colours that must be told apart are far apart, for people who see no green (deuteranopia) or no red (protanopia) too.

Deficiencies are simulated after Machado et al. (2009) at full severity; distances are Euclidean in CAM02-UCS (Luo et
al. 2006), where 1 is about the least that is noticed side by side. ``python -m tests.dashboards.test_colours IN.png
OUT.png`` writes a picture as the two see it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from colorspacious import cspace_convert, deltaE
from PIL import Image

from dashboards.palette import (
    ACKNOWLEDGED,
    BELOW_DETECTION,
    CHANGE_SCALE,
    HEIGHT_SCALE,
    LEVEL_SCALE,
    LINES,
    NOT_MEASURED,
    STATE_COLOURS,
    VISIT_COLOURS,
    Rgb,
    colour_table,
)

EYES = ("all colours", "deuteranomaly", "protanomaly")
TOLD_APART = 10.0
"""Between names of a lane or lines of a plot, and between a scale and what was not measured."""

LANES_AND_PLOTS: Mapping[str, Sequence[Rgb]] = {
    "alarms": (*STATE_COLOURS.values(), ACKNOWLEDGED),
    "visits": tuple(VISIT_COLOURS.values()),
    "lines and limits": (*LINES, STATE_COLOURS["warning"], STATE_COLOURS["alarm"]),
    "levels": (*LEVEL_SCALE, NOT_MEASURED),
}


def seen(colours: npt.ArrayLike, eyes: str) -> npt.NDArray[np.float64]:
    """Colours of 0 to 255 as some eyes see them, shape (..., 3)."""
    given = np.asarray(colours, dtype=np.float64) / 255
    if eyes != "all colours":
        given = cspace_convert(given, {"name": "sRGB1+CVD", "cvd_type": eyes, "severity": 100}, "sRGB1")
    shown: npt.NDArray[np.float64] = 255 * np.clip(given, 0, 1)
    return shown


def apart(one: npt.ArrayLike, other: npt.ArrayLike) -> npt.NDArray[Any]:
    """How different two colours look, or arrays of colours that were seen."""
    return np.asarray(deltaE(one, other, input_space="sRGB255", uniform_space="CAM02-UCS"))


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("what", LANES_AND_PLOTS)
def test_what_stands_side_by_side_is_told_apart(what: str, eyes: str) -> None:
    least = min(float(apart(*seen(pair, eyes))) for pair in combinations(LANES_AND_PLOTS[what], 2))
    assert least >= TOLD_APART


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("scale", [CHANGE_SCALE, HEIGHT_SCALE], ids=["change", "height"])
def test_what_was_not_measured_looks_like_no_value(scale: tuple[Rgb, ...], eyes: str) -> None:
    values = seen(colour_table(scale), eyes)
    assert apart(values, np.broadcast_to(seen(NOT_MEASURED, eyes), values.shape)).min() >= TOLD_APART


@pytest.mark.parametrize("eyes", EYES)
def test_gain_is_told_from_loss_and_both_from_no_change(eyes: str) -> None:
    """From a fifth of the scale on, and the farther from the middle the more."""
    table = seen(colour_table(CHANGE_SCALE), eyes)
    middle = len(table) // 2
    np.testing.assert_allclose(table[middle], seen(BELOW_DETECTION, eyes), atol=0.5)
    lost, gained = table[:middle][::-1], table[middle + 1 :]
    from_fifth = slice(middle // 5, None)
    assert apart(lost[from_fifth], gained[from_fifth]).min() >= TOLD_APART
    for side in (lost, gained):
        away = apart(side, np.broadcast_to(table[middle], side.shape))
        assert np.all(np.diff(away) > 0)
        assert away[middle // 3] >= TOLD_APART


@pytest.mark.parametrize("eyes", EYES)
def test_heights_keep_their_order(eyes: str) -> None:
    """Lightness grows from low to high, so that no two heights a tenth of the scale apart look alike."""
    table = seen(colour_table(HEIGHT_SCALE), eyes)
    lightness = cspace_convert(table, "sRGB255", "CAM02-UCS")[:, 0]
    assert np.all(np.diff(lightness[::5]) > 0)
    assert apart(table[:-25], table[25:]).min() >= 4


def main(source: str, out: str) -> None:
    """Write a picture as it is, and below it as the other eyes see it."""
    picture = np.asarray(Image.open(source).convert("RGB"))
    Image.fromarray(np.concatenate([seen(picture, eyes) for eyes in EYES]).round().astype(np.uint8)).save(out)


if __name__ == "__main__":
    main(*sys.argv[1:])
