"""Arrays of cells to pictures: shrunk, coloured, north up, as PNG."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines.change import block_means

from .palette import CHANGE_SCALE, HEIGHT_SCALE, LEVEL_SCALE, NOT_MEASURED, Rgb, colour_table

__all__ = [
    "Range",
    "above_detection",
    "block_mean",
    "change_limit",
    "change_png",
    "height_ends",
    "height_png",
    "level_png",
    "plates_png",
    "round_limit",
    "shrink_factor",
    "texture_jpeg",
    "texture_png",
    "tone",
]

_HOLE = 255


@dataclass(frozen=True, slots=True)
class Range:
    """What the two ends of a colour scale mean, mm."""

    low: float
    high: float


def shrink_factor(rows: int, columns: int, most: int) -> int:
    """Side of the square blocks that leave at most `most` cells."""
    factor = 1
    while -(-rows // factor) * -(-columns // factor) > most:
        factor += 1
    return factor


def block_mean(cells: npt.NDArray[np.float32], factor: int) -> npt.NDArray[np.float32]:
    """Average square blocks, NaN aside; a block with fewer than half of its cells measured is NaN.

    Parameters
    ----------
    cells : ndarray of float32, shape (rows, columns)
        NaN where not measured.
    factor : int
        Side of a block; rows and columns are padded with NaN to whole blocks.

    Returns
    -------
    ndarray of float32, shape (ceil(rows / factor), ceil(columns / factor))
    """
    return cells if factor == 1 else block_means(cells, factor, -(-factor * factor // 2))


def tone(cells: npt.NDArray[np.float32], span: Range) -> npt.NDArray[np.uint8]:
    """Place each cell on a scale of 255 steps; 255 itself marks a cell without a value."""
    width = max(span.high - span.low, 1e-12)
    steps = np.clip((cells - span.low) * np.float32(254 / width) + np.float32(0.5), 0, 254)
    return np.where(np.isfinite(steps), steps, _HOLE).astype(np.uint8)


def height_png(height: npt.NDArray[np.float32], span: Range, most: int = 1_000_000) -> bytes:
    """Draw a height map, largest y on top, cells that were not measured in black."""
    factor = shrink_factor(height.shape[0], height.shape[1], most)
    return _indexed_png(tone(block_mean(height, factor), span), HEIGHT_SCALE)


def change_png(
    dz: npt.NDArray[np.float32], lod: npt.NDArray[np.float32], limit_mm: float, most: int = 1_000_000
) -> bytes:
    """Draw a change map from -`limit_mm` to `limit_mm`; below the level of detection it takes the scale's middle.

    Red is lost, blue is gained, black was not measured in one of the two scans.
    """
    factor = shrink_factor(dz.shape[0], dz.shape[1], most)
    shown = block_mean(above_detection(dz, lod), factor)
    return _indexed_png(tone(shown, Range(-limit_mm, limit_mm)), CHANGE_SCALE)


def above_detection(dz: npt.NDArray[np.float32], lod: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Give the change with 0 where it is below its level of detection, NaN where it was not measured.

    For before shrinking: a mean of insignificant cells would look like a significant small change.
    """
    return np.where((np.abs(dz) > lod) | ~np.isfinite(dz), dz, np.float32(0)).astype(np.float32)


def level_png(level: npt.NDArray[np.uint8], most: int) -> bytes:
    """Draw which stripes each cell resolved, from the finest on, largest y on top; black was not measured."""
    factor = shrink_factor(level.shape[0], level.shape[1], most)
    shown = level[::factor, ::factor]
    steps = np.where(shown == _HOLE, len(LEVEL_SCALE), np.minimum(shown, len(LEVEL_SCALE) - 1)).astype(np.uint8)
    from PIL import Image

    picture = Image.fromarray(np.flipud(steps))
    picture.putpalette(bytes(channel for colour in (*LEVEL_SCALE, NOT_MEASURED) for channel in colour))
    return _png(picture)


def plates_png(
    cells: npt.NDArray[np.int32], values: npt.NDArray[np.float32], span: Range, shape: tuple[int, int]
) -> bytes:
    """Draw each plate in the colour of its value on the scale of change, largest y on top; black where there is none.

    `values` holds one for each label of `cells`, NaN where it was not measured; the map is brought to `shape`.
    """
    from PIL import Image

    values = values.copy()
    values[0] = np.nan
    steps = tone(values, span)[cells]
    picture = Image.fromarray(np.flipud(steps))
    if picture.size != shape[::-1]:
        picture = picture.resize(shape[::-1], Image.Resampling.NEAREST)
    picture.putpalette(colour_table(CHANGE_SCALE).tobytes() + bytes(NOT_MEASURED))
    return _png(picture)


def texture_jpeg(texture: npt.NDArray[np.uint8], most: int) -> bytes:
    """Draw the camera's picture in grey, largest y on top, a tenth of a PNG's size."""
    from PIL import Image

    factor = shrink_factor(texture.shape[0], texture.shape[1], most)
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(np.flipud(texture[::factor, ::factor]))).save(file, "JPEG", quality=88)
    return file.getvalue()


def texture_png(texture: npt.NDArray[np.uint8], most: int = 1_000_000) -> bytes:
    """Draw the camera's picture in grey, largest y on top."""
    from PIL import Image

    factor = shrink_factor(texture.shape[0], texture.shape[1], most)
    return _png(Image.fromarray(np.ascontiguousarray(np.flipud(texture[::factor, ::factor]))))


def height_ends(heights: npt.NDArray[np.floating[Any]]) -> Range:
    """Give the ends of a scale of heights, mm: between them lie all but the lowest and the highest 2 % of those known.

    A millimetre around nothing, and around a plane.
    """
    known = heights[np.isfinite(heights)]
    low, high = (float(end) for end in np.percentile(known, (2, 98))) if known.size else (0.0, 0.0)
    return Range(low, high) if high > low else Range(low - 0.5, high + 0.5)


def change_limit(changes: npt.NDArray[np.floating[Any]]) -> float:
    """Give the end of a scale of changes: a round number within which 95 % of those known are; more would hide them."""
    known = np.abs(changes[np.isfinite(changes)])
    return round_limit(float(np.percentile(known, 95)) if known.size else 0.0)


def round_limit(value: float) -> float:
    """Round up to the next 1, 1.5, 2, 3, 5 or 7 times a power of ten: the ends of a readable scale."""
    if not (np.isfinite(value) and value > 0):
        return 0.001
    power = 10.0 ** np.floor(np.log10(value))
    for step in (1, 1.5, 2, 3, 5, 7, 10):
        if value <= step * power * (1 + 1e-9):
            return float(step * power)
    return float(10 * power)


def _indexed_png(steps: npt.NDArray[np.uint8], scale: tuple[Rgb, ...]) -> bytes:
    from PIL import Image

    picture = Image.fromarray(np.flipud(steps))
    picture.putpalette(colour_table(scale).tobytes() + bytes(NOT_MEASURED))
    return _png(picture)


def _png(picture: object) -> bytes:
    file = io.BytesIO()
    picture.save(file, format="PNG", compress_level=4)  # type: ignore[attr-defined] # Pillow is imported lazily
    return file.getvalue()
