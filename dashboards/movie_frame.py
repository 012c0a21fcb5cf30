"""One frame of a film: panels of the lit surface and of its change, with title, time, scale bar, colour bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pipelines import Grid
from storage import Stored

from .maps import scale_bar_mm
from .palette import BELOW_DETECTION, CHANGE_SCALE, HEIGHT_SCALE, NOT_MEASURED, Rgb, colour_table
from .quantities import day_and_time, plain, span
from .raster import Range, block_mean, tone

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw

__all__ = ["Look", "all_colours", "draw_frame"]

PAPER, INK, SOFT = (20, 23, 27), (232, 230, 225), (163, 171, 180)
_LIGHT = np.array([-0.5, 0.5, 0.7071]) / np.linalg.norm([-0.5, 0.5, 0.7071])
_RELIEF = 0.55
"""Slope that the steeper tenth of the surface is drawn with: relief that is too flat to see is exaggerated."""


@dataclass(frozen=True, slots=True)
class Look:
    """What all frames of a film share.

    Parameters
    ----------
    grid : Grid
    title : str
    factor : int
        Side of the square of cells that one cell of a panel is the mean of.
    panel : (int, int)
        Width and height of a panel, px.
    heights : Range
        Ends of the colour scale of heights, mm.
    limit_mm : float
        End of the scale of changes.
    with_change : bool
        Whether there is a second panel, of changes.
    unit : int
        A line of text, px; all else follows it.
    """

    grid: Grid
    title: str
    factor: int
    panel: tuple[int, int]
    heights: Range
    limit_mm: float
    with_change: bool
    unit: int

    @classmethod
    def for_grid(cls, grid: Grid, title: str, width: int, heights: Range, limit_mm: float, with_change: bool) -> Look:
        """Lay out frames of a width for a grid."""
        unit = max(11, width // 58)
        count = 2 if with_change else 1
        across = (width - (count + 1) * unit) // count
        down = round(across * grid.rows / grid.columns)
        if not with_change and down > 1.2 * width:
            down = round(1.2 * width)
        factor = max(1, min(grid.columns // across, grid.rows // max(down, 1)))
        return cls(grid, title, factor, (across, down), heights, limit_mm, with_change, unit)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame, px, both even as films must be."""
        across, down = self.panel
        count = 2 if self.with_change else 1
        width, height = count * across + (count + 1) * self.unit, down + round(8.6 * self.unit)
        return width + width % 2, height + height % 2


def draw_frame(stored: Stored, baseline: Stored, look: Look, done: float) -> Image:
    """Draw one scan.

    Parameters
    ----------
    stored, baseline : Stored
        A scan, and what its change was measured against.
    look : Look
    done : float
        Share of the film that is over, for the line at its foot.
    """
    from PIL import Image as Pictures
    from PIL import ImageDraw

    picture = Pictures.new("RGB", look.size, PAPER)
    pen = ImageDraw.Draw(picture)
    unit, (across, down) = look.unit, look.panel
    top = round(3.6 * unit)
    _text(pen, (unit, round(0.6 * unit)), look.title, 1.35 * unit, INK)
    since = stored.scan.time - baseline.scan.time
    _text(pen, (look.size[0] - unit, round(0.6 * unit)), day_and_time(stored.scan.time), 1.35 * unit, INK, right=True)
    change = stored.change
    # what moved as a whole is taken out, as in the change itself
    height = (
        stored.scan.height
        if change is None
        else np.where(np.isfinite(change.dz), baseline.scan.height + change.dz, stored.scan.height)
    )
    cells = block_mean(height.astype(np.float32), look.factor)
    shade = _shade(cells, look)
    _panel(picture, _coloured(cells, look.heights, HEIGHT_SCALE) * shade[..., np.newaxis], (unit, top), look)
    _text(pen, (unit, top - round(1.25 * unit)), "Height", unit, SOFT)
    foot = top + down + round(0.6 * unit)
    _scale_bar(pen, look, (unit, foot))
    _colour_bar(picture, pen, look, unit + across // 2, foot, look.heights, HEIGHT_SCALE)
    if look.with_change:
        left = across + 2 * unit
        if change is None:
            dz = np.zeros(cells.shape, dtype=np.float32)
        else:
            seen = (np.abs(change.dz) > change.lod) | ~np.isfinite(change.dz)
            dz = block_mean(np.where(seen, change.dz, np.float32(0)).astype(np.float32), look.factor)
        ends = Range(-look.limit_mm, look.limit_mm)
        light = 0.35 + 0.65 * shade  # the colour must be read, the relief only felt
        _panel(picture, _coloured(dz, ends, CHANGE_SCALE) * light[..., np.newaxis], (left, top), look)
        what = "Change: this is the first scan" if change is None else f"Change after {span(since)}"
        _text(pen, (left, top - round(1.25 * unit)), what, unit, SOFT)
        _text(pen, (left, foot), "red sank, blue rose,", unit, SOFT)
        _text(pen, (left, foot + round(1.2 * unit)), "black not measured", unit, SOFT)
        _colour_bar(picture, pen, look, left + across // 2, foot, ends, CHANGE_SCALE)
    line = look.size[1] - round(0.8 * unit)
    pen.line((unit, line, look.size[0] - unit, line), fill=(60, 66, 74), width=max(2, unit // 7))
    end = unit + done * (look.size[0] - 2 * unit)
    pen.line((unit, line, end, line), fill=INK, width=max(2, unit // 7))
    return picture


def all_colours() -> Image:
    """Give a picture of every colour that a frame may hold, for a film with one palette."""
    from PIL import Image as Pictures

    light = np.linspace(0.25, 1.35, 12)[:, np.newaxis, np.newaxis]
    scales = np.vstack([colour_table(HEIGHT_SCALE, 40), colour_table(CHANGE_SCALE, 60)])
    plain_ones = np.tile(np.array([PAPER, INK, SOFT, NOT_MEASURED]), (len(light), 5, 1))
    colours = np.concatenate([scales[np.newaxis] * light, plain_ones], axis=1)
    return Pictures.fromarray(np.clip(colours, 0, 255).astype(np.uint8))


def _coloured(cells: npt.NDArray[np.float32], ends: Range, scale: tuple[Rgb, ...]) -> npt.NDArray[np.float32]:
    """Colour cells, shape (rows, columns, 3); black where not measured."""
    table = np.vstack([colour_table(scale), np.array([NOT_MEASURED], dtype=np.uint8)])
    coloured: npt.NDArray[np.float32] = table[tone(cells, ends)].astype(np.float32)
    return coloured


def _shade(cells: npt.NDArray[np.float32], look: Look) -> npt.NDArray[np.float32]:
    """Light the surface from the upper left; 1 on flat ground and in holes, shape of `cells`."""
    step = look.grid.pitch_mm * look.factor
    known = np.where(np.isfinite(cells), cells, np.nanmedian(cells) if np.isfinite(cells).any() else 0.0)
    down, across = np.gradient(known, step) if min(known.shape) > 1 else (np.zeros_like(known),) * 2
    gain = min(5.0, max(1.0, _RELIEF / max((look.heights.high - look.heights.low) / (20 * step), 1e-6)))
    x, y = -gain * across, -gain * down
    lit = (x * _LIGHT[0] + y * _LIGHT[1] + _LIGHT[2]) / np.sqrt(x**2 + y**2 + 1) / _LIGHT[2]
    shade: npt.NDArray[np.float32] = np.where(np.isfinite(cells), np.clip(lit, 0.25, 1.35), 1.0).astype(np.float32)
    return shade


def _panel(picture: Image, colours: npt.NDArray[np.float32], at: tuple[int, int], look: Look) -> None:
    from PIL import Image as Pictures

    drawn = Pictures.fromarray(np.flipud(np.clip(colours, 0, 255).astype(np.uint8)))
    smooth = Pictures.Resampling.LANCZOS if drawn.size[0] > look.panel[0] else Pictures.Resampling.BILINEAR
    picture.paste(drawn.resize(look.panel, smooth), at)


def _scale_bar(pen: ImageDraw, look: Look, at: tuple[int, int]) -> None:
    width_mm = look.grid.columns * look.grid.pitch_mm
    bar_mm = scale_bar_mm(width_mm)
    length = round(bar_mm / width_mm * look.panel[0])
    x, y = at[0], at[1] + look.unit // 2
    pen.line((x, y, x + length, y), fill=INK, width=max(2, look.unit // 6))
    for end in (x, x + length):
        pen.line((end, y - look.unit // 3, end, y + look.unit // 3), fill=INK, width=max(2, look.unit // 8))
    _text(pen, (x, y + round(0.5 * look.unit)), f"{plain(bar_mm)} mm", look.unit, SOFT)


def _colour_bar(
    picture: Image, pen: ImageDraw, look: Look, left: int, top: int, ends: Range, scale: tuple[Rgb, ...]
) -> None:
    from PIL import Image as Pictures

    width, height = look.panel[0] // 2 - 2 * look.unit, round(0.8 * look.unit)
    bar = Pictures.fromarray(colour_table(scale)[np.newaxis]).resize((width, height))
    picture.paste(bar, (left, top))
    under = top + height + look.unit // 4
    sign = "+" if ends.low < 0 < ends.high else ""
    _text(pen, (left, under), plain(ends.low, 2), 0.9 * look.unit, SOFT, middle=True)
    _text(pen, (left + width, under), f"{sign}{plain(ends.high, 2)} mm", 0.9 * look.unit, SOFT, middle=True)
    if scale is CHANGE_SCALE:
        _text(pen, (left + width // 2, under), "0", 0.9 * look.unit, BELOW_DETECTION, middle=True)


def _text(
    pen: ImageDraw,
    at: tuple[int, int],
    text: str,
    size: float,
    colour: Rgb,
    *,
    right: bool = False,
    middle: bool = False,
) -> None:
    from PIL import ImageFont

    anchor = "ra" if right else "ma" if middle else "la"
    # the font that Pillow brings has no minus sign
    pen.text(
        at, text.replace("\N{MINUS SIGN}", "-"), fill=colour, font=ImageFont.load_default(round(size)), anchor=anchor
    )
