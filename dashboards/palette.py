"""Colours that mean something: one diverging scale for change, one sequential for height, one per alarm state.

The diverging scale is ColorBrewer's RdBu and the sequential one follows viridis: both keep their order for
colour-blind readers and in grey print. States take the Okabe-Ito colours. ``tests/dashboards/test_colours.py`` holds
them apart for people who see no green or no red.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from pipelines import AlarmState

__all__ = [
    "ACKNOWLEDGED",
    "BELOW_DETECTION",
    "CHANGE_SCALE",
    "HEIGHT_SCALE",
    "LABELS",
    "LEVEL_SCALE",
    "LINES",
    "NOT_MEASURED",
    "OUTLINES",
    "STATE_COLOURS",
    "VISIT_COLOURS",
    "colour_table",
    "hex_colour",
]

Rgb = tuple[int, int, int]

NOT_MEASURED: Rgb = (0, 0, 0)
"""A cell without a value: the one colour far from all of every scale; grey is viridis' middle to who sees no red."""

BELOW_DETECTION: Rgb = (240, 239, 235)
"""Cells whose change is smaller than their level of detection: the scale's own middle."""

CHANGE_SCALE: tuple[Rgb, ...] = (
    (103, 0, 31),
    (178, 24, 43),
    (214, 96, 77),
    (244, 165, 130),
    (250, 213, 194),
    BELOW_DETECTION,
    (205, 226, 239),
    (146, 197, 222),
    (67, 147, 195),
    (33, 102, 172),
    (5, 48, 97),
)
"""Red is lost, blue is gained."""

HEIGHT_SCALE: tuple[Rgb, ...] = (
    (68, 1, 84),
    (71, 44, 122),
    (59, 81, 139),
    (44, 113, 142),
    (33, 144, 141),
    (39, 173, 129),
    (92, 200, 99),
    (170, 220, 50),
    (253, 231, 37),
)
"""Dark is low, yellow is high."""

LEVEL_SCALE: tuple[Rgb, ...] = (
    (28, 100, 170),
    (86, 180, 233),
    (190, 225, 245),
    (240, 228, 66),
    (230, 159, 0),
    (213, 94, 0),
)
"""From the finest stripes, which all cells of a good scan resolve, to six steps coarser and more."""

STATE_COLOURS: dict[AlarmState, Rgb] = {
    "ok": (0, 158, 115),
    "warning": (230, 159, 0),
    "alarm": (213, 94, 0),
    "no data": (225, 225, 225),
}

ACKNOWLEDGED: Rgb = (204, 121, 167)
"""An alarm that somebody has seen, until it changes again."""

VISIT_COLOURS: dict[str, Rgb] = {
    "taken": (0, 114, 178),
    "missed": (230, 159, 0),
    "rejected": (204, 121, 167),
    "failed": (213, 94, 0),
}

LINES: tuple[Rgb, ...] = (
    (86, 180, 233),
    (240, 228, 66),
    (204, 121, 167),
    (0, 158, 115),
    (225, 225, 225),
    (0, 114, 178),
)
"""Lines on dark that share one plot, in this order; none has the colour of a warning's or an alarm's limit."""

OUTLINES: Rgb = (255, 255, 255)
"""Of a campaign's polygons, with black beside it: no map has such a pair."""

LABELS: Rgb = (240, 240, 240)
"""Words on pictures are light, whatever their line's colour: some of those are too dark to be read."""


@lru_cache(maxsize=8)
def colour_table(scale: tuple[Rgb, ...], steps: int = 255) -> npt.NDArray[np.uint8]:
    """Interpolate a scale to `steps` colours, shape (steps, 3)."""
    anchors = np.array(scale, dtype=np.float64)
    at = np.linspace(0, len(scale) - 1, steps)
    channels = [np.interp(at, np.arange(len(scale)), anchors[:, channel]) for channel in range(3)]
    table = np.rint(np.stack(channels, axis=1)).astype(np.uint8)
    table.flags.writeable = False
    return table


def hex_colour(colour: Rgb) -> str:
    """Write a colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
