"""ReplayRig: captures from a folder, one after the other, as if they were taken now."""

from __future__ import annotations

import re
from pathlib import Path

from configs import CaptureError, InputError
from pipelines import Frames, Instant, PatternSet
from storage import read_capture, read_patterns

__all__ = ["ReplayRig"]


class ReplayRig:
    """Gives the captures of a folder in natural name order (2 before 10).

    Parameters
    ----------
    folder : str or Path
        One capture folder, or a folder of capture folders.
    patterns : str or Path, optional
        Pattern file for captures that do not say what they show; without it those show what the campaign projects.
    loop : bool
        Begin again after the last one; else a visit after it is a CaptureError.
    keep_time : bool
        Leave each capture its own time. Usually it gets the time of the visit.
    preload : bool
        Read all captures at the first visit, and give them from memory from then on (video).

    Raises
    ------
    InputError
        The folder does not exist.
    """

    def __init__(
        self,
        *,
        folder: str | Path,
        patterns: str | Path | None = None,
        loop: bool = False,
        keep_time: bool = False,
        preload: bool = False,
    ) -> None:
        self._folder = Path(folder)
        if not self._folder.is_dir():
            raise InputError(f"rig option folder: {self._folder} is no folder; name a capture or a folder of captures")
        self._patterns = None if patterns is None else read_patterns(Path(patterns))
        self._loop = loop
        self._keep_time = keep_time
        self._preload = preload
        self._captures: list[Path] = []
        self._frames: dict[Path, Frames] = {}
        self._next = 0
        self._open = False

    def open(self) -> None:
        """List the captures; the first is next.

        Raises
        ------
        InputError
            The folder holds none.
        """
        if self._open:
            return
        self._captures = _captures(self._folder)
        self._next = 0
        self._open = True

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Give the next capture.

        Raises
        ------
        CaptureError
            None is left, it shows other patterns than `patterns`, or the rig is not open.
        """
        if not self._open:
            raise CaptureError("replay rig: not open; call open() before capture()")
        if self._next == len(self._captures):
            if not self._loop:
                raise CaptureError(
                    f"replay rig: all {len(self._captures)} captures of {self._folder} have been replayed; "
                    "set loop: true to begin again"
                )
            self._next = 0
        place = self._captures[self._next]
        self._next += 1
        if self._preload and not self._frames:
            self._frames = {each: self._read(each, patterns) for each in self._captures}
        frames = self._frames[place] if self._preload else self._read(place, patterns)
        if frames.patterns != patterns:
            raise CaptureError(
                f"replay rig: {place} shows other patterns than the campaign's; "
                "name the pattern file in rig option patterns or mend `patterns:` of the campaign"
            )
        return frames if self._keep_time else Frames(frames.stack, at, frames.patterns, frames.exposure_ms)

    def close(self) -> None:
        """Forget the captures; the rig may be opened again, and begins with the first."""
        self._frames = {}
        self._open = False

    def _read(self, place: Path, projected: PatternSet) -> Frames:
        says_itself = (place / "capture.json").is_file()
        return read_capture(place, self._patterns or (None if says_itself else projected))


def _captures(folder: Path) -> list[Path]:
    below = sorted((inner for inner in folder.iterdir() if inner.is_dir() and _holds_frames(inner)), key=_natural)
    if below:
        return below
    if _holds_frames(folder):
        return [folder]
    raise InputError(f"rig option folder: {folder} holds no capture: neither images nor folders of images")


def _holds_frames(folder: Path) -> bool:
    kinds = {".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".npy"}
    return any(file.suffix.lower() in kinds for file in folder.iterdir())


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", path.name)]
