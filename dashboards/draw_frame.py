"""Draws the frame of a review: what stays for a whole recording, such as triangles, colour bars and outlines."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from . import paths
from .draw_scan import to_pixels
from .palette import CHANGE_SCALE, HEIGHT_SCALE, LABELS, LEVEL_SCALE, LINES, NOT_MEASURED, OUTLINES, Rgb, colour_table
from .places import Places, cut_to
from .quantities import plain
from .raster import Range
from .scales import Scales
from .surface import triangles

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["log_frame"]

_QUALITY = {"coverage": "measured [%]", "residual": "registration residual [µm]", "sigma": "median sigma [µm]"}


def log_frame(stream: rr.RecordingStream, scales: Scales, places: Places) -> None:
    """Log what does not change: triangles, the drawing scale, colour bars, the looks of maps and lines, outlines."""
    import rerun as rr

    for place in (paths.SURFACE, paths.BASELINE):
        stream.log(place, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log(place, rr.Transform3D(scale=[1.0, 1.0, scales.exaggeration]), static=True)
        joined = triangles(scales.grid, scales.detail.vertices)
        stream.log(f"{place}/mesh", rr.Mesh3D.from_fields(triangle_indices=joined), static=True)
    for path, ends in ((paths.HEIGHT, scales.height), (paths.SIGMA, Range(0.0, scales.sigma_limit_mm))):
        looks = rr.DepthImage.from_fields(
            meter=1000.0, colormap=rr.components.Colormap.Viridis, depth_range=[ends.low, ends.high]
        )
        stream.log(path, looks, static=True)
        named = rr.AnnotationContext([(0, "measured", (0, 0, 0, 0)), (1, "not measured", NOT_MEASURED)])
        stream.log(f"{path}/holes", named, static=True)
        _log_colour_bar(stream, f"{path}/scale", HEIGHT_SCALE, ends, scales)
    if scales.change_limit_mm > 0:
        ends = Range(-scales.change_limit_mm, scales.change_limit_mm)
        _log_colour_bar(stream, f"{paths.CHANGE}/scale", CHANGE_SCALE, ends, scales)
    _log_level_key(stream, scales)
    _log_outlines(stream, scales, places)
    for number, (name, title) in enumerate(_QUALITY.items()):
        stream.log(f"{paths.QUALITY}/{name}", rr.SeriesLines(names=title, colors=LINES[number], widths=2), static=True)


def _log_colour_bar(stream: rr.RecordingStream, path: str, scale: tuple[Rgb, ...], ends: Range, scales: Scales) -> None:
    """Draw a colour bar below a map, with its two ends and its middle in mm."""
    import rerun as rr

    rows, columns = scales.map_shape
    steps = 64
    x = np.linspace(0.1 * columns, 0.9 * columns, steps + 1)
    top, bottom = 1.04 * rows, 1.08 * rows
    bars = [[[(a + b) / 2, top], [(a + b) / 2, bottom]] for a, b in pairwise(x)]
    radius = 0.75 * (x[1] - x[0])
    stream.log(path, rr.LineStrips2D(bars, colors=colour_table(scale, steps), radii=float(radius)), static=True)
    write = _signed if ends.low < 0 else lambda value: plain(value, 2)
    words = [write(ends.low), write((ends.low + ends.high) / 2), f"{write(ends.high)} mm"]
    places = [[at, 1.1 * rows] for at in (x[0], (x[0] + x[-1]) / 2, x[-1])]
    _log_words(stream, f"{path}/labels", places, words)


def _log_level_key(stream: rr.RecordingStream, scales: Scales) -> None:
    import rerun as rr

    rows, columns = scales.map_shape
    words = ["0", *(f"+{step}" for step in range(1, len(LEVEL_SCALE) - 1)), f"+{len(LEVEL_SCALE) - 1}…", "none"]
    x = np.linspace(0.05 * columns, 0.95 * columns, len(words))
    bars = [[[at - 0.04 * columns, 1.05 * rows], [at + 0.04 * columns, 1.05 * rows]] for at in x]
    colours = [*LEVEL_SCALE, NOT_MEASURED]
    path = f"{paths.LEVEL}/scale"
    stream.log(path, rr.LineStrips2D(bars, colors=colours, radii=0.015 * rows), static=True)
    _log_words(stream, f"{path}/labels", [[at, 1.1 * rows] for at in x], words)


def _log_words(stream: rr.RecordingStream, path: str, places: Any, words: list[str]) -> None:
    import rerun as rr

    shown = rr.Points2D(places, labels=words, radii=0.0, colors=[LABELS], show_labels=True)
    stream.log(path, shown, static=True)


def _log_outlines(stream: rr.RecordingStream, scales: Scales, places: Places) -> None:
    """Draw a campaign's polygons with their names, light on dark, so that they are seen on every colour."""
    import rerun as rr

    lines, labels, names = [], [], []
    for name, polygon in places.named:
        corners = cut_to(polygon, scales.grid)
        if len(corners):
            line = to_pixels(corners[:, 0], corners[:, 1], scales)
            lines.append(np.vstack([line, line[:1]]))
            names.append(name)
            labels.append([line[:, 0].mean(), line[:, 1].min()])
    if lines:
        for number, (name, colour, width) in enumerate((("edge", NOT_MEASURED, 1.6), ("line", OUTLINES, 0.7))):
            strips = rr.LineStrips2D(lines, colors=colour, radii=rr.Radius.ui_points(width), draw_order=10 + number)
            stream.log(f"{paths.PLACES}/{name}", strips, static=True)
        _log_words(stream, f"{paths.PLACES}/names", labels, names)


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{plain(value, 2)}"
