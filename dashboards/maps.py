"""Height and change maps as SVG: the picture inside, a scale bar and a colour bar below."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Literal
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from pipelines import Change, Scan

from .palette import CHANGE_SCALE, HEIGHT_SCALE, NOT_MEASURED, Rgb, colour_table, hex_colour
from .places import Polygon, cut_to
from .quantities import plain
from .raster import Range, change_png, height_png, texture_png

__all__ = ["Outlines", "camera_picture", "change_map", "height_map", "rate_map", "scale_bar_mm"]

Outlines = Sequence[tuple[Literal["region", "stable"], Polygon]]
"""Polygons, mm, and what each is: drawn whole, or dashed."""

_WIDTH = 420.0
_FOOT = 62.0
_MOST_CELLS = 250_000


def height_map(scan: Scan, span: Range, alternative: str, outlines: Outlines = ()) -> str:
    """Draw a scan's heights between the two ends of `span`, mm, with outlines of places."""
    png, holes = height_png(scan.height, span, _MOST_CELLS), bool(np.isnan(scan.height).any())
    return _map(png, scan, HEIGHT_SCALE, span, alternative, holes, outlines=outlines)


def change_map(scan: Scan, change: Change, limit_mm: float, alternative: str, outlines: Outlines = ()) -> str:
    """Draw a scan's change since its baseline from -`limit_mm` to `limit_mm`."""
    png, holes = change_png(change.dz, change.lod, limit_mm, _MOST_CELLS), bool(np.isnan(change.dz).any())
    return _map(png, scan, CHANGE_SCALE, Range(-limit_mm, limit_mm), alternative, holes, outlines=outlines)


def camera_picture(scan: Scan, alternative: str) -> str:
    """Draw what the camera saw, on the scan's grid."""
    return _map(texture_png(scan.texture, _MOST_CELLS), scan, None, None, alternative, False)


def rate_map(
    scan: Scan,
    rate: npt.NDArray[np.float64],
    sigma: npt.NDArray[np.float64],
    limit: float,
    alternative: str,
    outlines: Outlines = (),
) -> str:
    """Draw rates of blocks of a scan's cells, mm per day; those that chance explains at 95 % are pale."""
    png = change_png(rate.astype(np.float32), (1.96 * sigma).astype(np.float32), limit, _MOST_CELLS)
    holes = bool(np.isnan(rate).any())
    return _map(png, scan, CHANGE_SCALE, Range(-limit, limit), alternative, holes, "mm/d", outlines)


def _map(
    png: bytes,
    scan: Scan,
    scale: tuple[Rgb, ...] | None,
    span: Range | None,
    alternative: str,
    holes: bool,
    unit: str = "mm",
    outlines: Outlines = (),
) -> str:
    grid = scan.grid
    height = _WIDTH * grid.rows / grid.columns
    per_mm = _WIDTH / (grid.columns * grid.pitch_mm)
    data = base64.b64encode(png).decode("ascii")
    attribute = escape(alternative, {'"': "&quot;"})
    parts = [
        f'<svg class="map" viewBox="0 0 {_WIDTH:g} {height + _FOOT:.1f}" role="img" aria-label="{attribute}">',
        f"<title>{escape(alternative)}</title>",
        f'<image href="data:image/png;base64,{data}" width="{_WIDTH:g}" height="{height:.1f}" '
        'preserveAspectRatio="none"/>',
        f'<rect class="frame" x="0.5" y="0.5" width="{_WIDTH - 1:g}" height="{height - 1:.1f}"/>',
    ]
    x_low, _, _, y_high = grid.extent_mm
    for kind, polygon in outlines:
        points = " ".join(f"{(x - x_low) * per_mm:.1f},{(y_high - y) * per_mm:.1f}" for x, y in cut_to(polygon, grid))
        # light beside dark, so that it is seen on every colour; a picture's colours follow no scheme
        drawn = f'fill="none" points="{points}"/>'
        parts += [f'<polygon class="{name}" {drawn}' for name in ("outline-edge", f"outline {kind}")]
    bar_mm = scale_bar_mm(grid.columns * grid.pitch_mm)
    at = height + 16
    bar_end = bar_mm * per_mm
    parts.append(f'<path class="bar" d="M1 {at - 4:.1f}v8m0 -4h{bar_end:.1f}m0 -4v8"/>')
    parts.append(f'<text class="tick" x="{bar_end + 9:.1f}" y="{at + 4:.1f}">{plain(bar_mm)} mm</text>')
    if holes:
        parts.append(
            f'<rect x="1" y="{at + 17:.1f}" width="12" height="12" fill="{hex_colour(NOT_MEASURED)}"/>'
            f'<text class="tick" x="18" y="{at + 27.5:.1f}">not measured</text>'
        )
    if scale is not None and span is not None:
        parts += _colour_bar(scale, span, unit, at)
    parts.append("</svg>")
    return "".join(parts)


def _colour_bar(scale: tuple[Rgb, ...], span: Range, unit: str, at: float) -> list[str]:
    """Draw the scale's colours with both ends and the middle named."""
    left, right = 0.42 * _WIDTH, _WIDTH - 24
    steps = 48
    each = (right - left) / steps
    parts = [
        # Each bar reaches under the next: hairlines of background would show between exact ones.
        f'<rect x="{left + index * each:.2f}" y="{at - 7:.1f}" height="14" '
        f'width="{min(each + 1, right - left - index * each):.2f}" '
        f'fill="{hex_colour((int(red), int(green), int(blue)))}"/>'
        for index, (red, green, blue) in enumerate(colour_table(scale, steps))
    ]
    for share, value in ((0.0, span.low), (0.5, (span.low + span.high) / 2), (1.0, span.high)):
        text = f"{'+' if value > 0 and span.low < 0 else ''}{plain(value, 2)}" + (f" {unit}" if share == 1 else "")
        anchor = "end" if share == 1 else "middle"
        x = _WIDTH if share == 1 else left + share * (right - left)
        parts.append(f'<text class="tick" x="{x:.1f}" y="{at + 24:.1f}" text-anchor="{anchor}">{text}</text>')
    return parts


def scale_bar_mm(width_mm: float) -> float:
    """The largest 1, 2 or 5 times a power of ten within a quarter of the width."""
    power = 10.0 ** np.floor(np.log10(width_mm / 4))
    return float(max(step * power for step in (1, 2, 5) if step * power <= width_mm / 4 * (1 + 1e-9)))
