"""A film of a store for a talk: the lit surface and its change, one scale for all frames, drawn without a screen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from configs import InputError, StoreError
from storage import Store, Stored

from .movie_frame import Look, all_colours, draw_frame
from .raster import change_limit, height_ends

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["MOVIE_SUFFIXES", "write_movie"]

MOVIE_SUFFIXES = (".mp4", ".gif")
_SAMPLED = 12
"""Scans that tell the scales: both ends of the film among them."""


def write_movie(
    store: Store,
    numbers: Sequence[int],
    out: Path,
    *,
    title: str,
    fps: float = 12.0,
    width: int = 1280,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Film some scans of a store.

    Parameters
    ----------
    store : Store
    numbers : sequence of int
        One frame each, in this order; all on one grid.
    out : Path
        ``.mp4`` (H.264) or ``.gif``.
    title : str
    fps : float
        Frames per second.
    width : int
        Of the picture, px; its height follows from the surface's shape.
    progress : callable
        Called with (frames drawn, frames in all).

    Raises
    ------
    InputError
        If the suffix is no film's, or what makes MP4 is not installed.
    StoreError
        If the file cannot be written.
    """
    look = _look(store, numbers, title, width)
    baseline: Stored | None = None

    def frames() -> Iterator[Image]:
        nonlocal baseline
        for done, number in enumerate(numbers, start=1):
            stored = store[number]
            if baseline is None or baseline.number != stored.baseline:
                baseline = store[stored.baseline]
            yield draw_frame(stored, baseline, look, (done - 1) / max(len(numbers) - 1, 1))
            progress(done, len(numbers))

    part = out.with_name(f".{out.stem}.part{out.suffix}")  # a film that was cut short is none
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        {".mp4": _mp4, ".gif": _gif}[out.suffix.lower()](frames(), part, fps)
        part.replace(out)
    except KeyError:
        raise InputError(f"--out {out}: a film is .mp4 or .gif") from None
    except OSError as error:
        if isinstance(error, StoreError | InputError):
            raise
        raise StoreError(f"{out}: cannot be written: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)


def _look(store: Store, numbers: Sequence[int], title: str, width: int) -> Look:
    """Fix what must not change from frame to frame: scales, light, layout."""
    chosen = sorted({numbers[round(at)] for at in np.linspace(0, len(numbers) - 1, min(len(numbers), _SAMPLED))})
    heights, changes = [], []
    for number in chosen:
        stored = store[number]
        heights.append(stored.scan.height[::4, ::4])
        if stored.change is not None:
            changes.append(stored.change.dz[::4, ::4])
    ends = height_ends(np.stack(heights))
    limit = change_limit(np.stack(changes) if changes else np.zeros(0))
    return Look.for_grid(store[numbers[0]].scan.grid, title, width, ends, limit, bool(changes))


def _mp4(frames: Iterable[Image], out: Path, fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InputError("MP4 needs ffmpeg: pip install 'microrelief[movie]'; or write a .gif") from None
    writer = None
    try:
        for frame in frames:
            if writer is None:
                writer = imageio_ffmpeg.write_frames(
                    str(out),
                    frame.size,
                    fps=fps,
                    codec="libx264",
                    quality=7,
                    macro_block_size=2,
                    ffmpeg_log_level="error",
                )
                writer.send(None)
            writer.send(frame.tobytes())
    finally:
        if writer is not None:
            writer.close()


def _gif(frames: Iterable[Image], out: Path, fps: float) -> None:
    from PIL.Image import Dither

    palette = all_colours().quantize(255, dither=Dither.NONE)  # one for all frames: colours must not swim
    every = (frame.quantize(palette=palette, dither=Dither.NONE) for frame in frames)
    first = next(every)
    first.save(out, format="GIF", save_all=True, append_images=every, duration=round(1000 / fps), loop=0)
