"""``microrelief movie``: a store as a film for a talk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import InputError
from dashboards import MOVIE_SUFFIXES, gather_numbers, write_movie
from storage import open_store

from ..progress import progress
from .report import period_of

__all__ = ["movie"]


def movie(
    store: Path,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("change.mp4"),
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    to: str | None = None,
    title: str | None = None,
    fps: float = 12.0,
    frames: int = 300,
    width: int | None = None,
) -> None:
    """Make a film of a store: the lit surface and its change, with title, time, scale bar and colours, for a talk.

    Needs no screen. One scale holds for all frames; what changed by less than the scans can tell stays pale.

    Parameters
    ----------
    store
        The store: a folder or s3://bucket/prefix.
    out
        The film: .mp4 (pip install 'microrelief[movie]') or .gif.
    from_
        Begin with this scan: its number, or a time or day such as 2026-11-22.
    to
        End with this scan, likewise.
    title
        The site's name unless given.
    fps
        Scans per second.
    frames
        At most so many scans, evenly spread.
    width
        Of the picture in pixels: 1280, or 720 for a GIF, unless given.

    Examples
    --------
    microrelief movie site.icechunk --out change.mp4
    microrelief movie site.icechunk --out may.gif --from 2026-05-01 --to 2026-05-31 --fps 8
    """
    suffix = out.suffix.lower()
    if suffix not in MOVIE_SUFFIXES:
        raise InputError(f"--out {out}: a film is {' or '.join(MOVIE_SUFFIXES)}")
    if not 0.1 <= fps <= 120:
        raise InputError(f"--fps must be from 0.1 to 120, not {fps:g}")
    if frames < 2:
        raise InputError(f"--frames must be at least 2, not {frames}")
    width = width if width is not None else 720 if suffix == ".gif" else 1280
    if not 240 <= width <= 7680:
        raise InputError(f"--width must be from 240 to 7680, not {width}")
    opened = open_store(store)
    try:
        numbers = gather_numbers(opened, period_of(opened, from_, to), frames)
        if not numbers:
            raise InputError(f"{store}: holds no scan yet, so there is nothing to film")
        site = title if title is not None else opened.about.site or "microrelief"
        with progress("drawing frames") as step:
            write_movie(opened, numbers, out, title=site, fps=fps, width=width, progress=step)
    finally:
        opened.close()
    print(f"wrote {out}: {len(numbers)} frames, {len(numbers) / fps:.1f} s")
