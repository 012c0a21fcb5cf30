"""Capture folders: frames as image files, and what was projected while they were taken."""

from __future__ import annotations

import json
import logging
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import Frames, Instant, PatternSet, format_instant, instant, parse_instant
from pipelines.reconstruction import suggest_order

from .pattern_file import natural_key, read_patterns

__all__ = ["read_capture", "read_image", "write_capture"]

CAPTURE_FILE = "capture.json"
PATTERN_FILES = ("patterns.yaml", "patterns.yml")
STACK_FILE = "frames.npy"
IMAGE_SUFFIXES = frozenset({".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg"})
SCHEMA = 1
THREADS = 4
TWELVE_BITS = 4095

log = logging.getLogger("microrelief.capture")


def read_capture(folder: str | Path, patterns: PatternSet | None = None) -> Frames:
    """Read a capture folder.

    With a ``capture.json`` that file names the frames. Without, they are ``frames.npy`` or the images in natural
    name order (2 before 10); their pattern set is `patterns`, or ``patterns.yaml`` in the folder or beside it. Colour
    becomes grey. Values of 12 bits in 16 are scaled to the whole range. Files that are no frame are skipped, and
    named in one line of the log ``microrelief.capture``.

    Parameters
    ----------
    folder : path
    patterns : PatternSet, optional
        What was projected; overrules what the folder says.

    Returns
    -------
    Frames
        Its time is ``taken_at``, or else when the first frame's file was last changed.

    Raises
    ------
    InputError
        If the folder holds no whole capture: the message names the file and says what to do.
    """
    folder = Path(folder)
    if not folder.exists():
        raise InputError(f"{folder}: no such folder")
    if not folder.is_dir():
        raise InputError(f"{folder}: is a file, a capture is a folder of frames")
    about = _read_about(folder)
    files = _named_frames(folder, about)
    stacked = files is None and (folder / STACK_FILE).exists()
    if files == [] or not (files or stacked or _images(folder)):
        raise InputError(f"{folder}: no frames in it (PNG, TIFF, BMP, JPEG or {STACK_FILE}){_captures_below(folder)}")
    if patterns is None:
        patterns = _patterns_of(folder, about)
    if stacked:
        first = folder / STACK_FILE
        stack = _read_stack(first)
    else:
        files = files or _find_frames(folder, len(patterns.roles))
        first = files[0]
        stack = _read_images(files)
    if len(stack) != len(patterns.roles):
        more = len(stack) > len(patterns.roles)
        mend = "move what is no frame away" if more else "take the capture again"
        raise InputError(
            f"{folder}: found {len(stack)} frames, the pattern set has {len(patterns.roles)}: {mend}, "
            "or name the pattern file of what was projected"
        )
    if stack.dtype == np.uint16 and about.get("bits") != 16 and int(stack.max()) <= TWELVE_BITS:
        stack = (stack * np.uint16(16)).astype(np.uint16)
    frames = Frames(stack, _time_of(folder, about, first), patterns, _exposure(folder, about))
    better = suggest_order(frames)
    if better:
        raise InputError(f"{folder}: {better}")
    return frames


def write_capture(frames: Frames, folder: str | Path, *, suffix: str = ".png") -> None:
    """Write a capture folder: one image per frame, and a ``capture.json`` that makes it whole.

    Parameters
    ----------
    frames : Frames
    folder : path
        Made if it is not there; must hold nothing else.
    suffix : str
        ``.png``, ``.tiff``, ``.bmp`` (8 bits only) or ``.npy`` (one file, fastest to read).

    Raises
    ------
    InputError
        If the folder holds files already, or cannot be written.
    """
    import cv2

    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot make this folder: {error.strerror}") from None
    if any(folder.iterdir()):
        raise InputError(f"{folder}: holds files already, give a new folder")
    names = [f"{number:02d}_{role.name}{suffix}" for number, role in enumerate(frames.patterns.roles)]
    if suffix == ".npy":
        names = [STACK_FILE]
        np.save(folder / STACK_FILE, frames.stack)
    else:
        if suffix not in IMAGE_SUFFIXES or (suffix == ".bmp" and frames.stack.dtype == np.uint16):
            raise InputError(f"{suffix}: frames of {frames.stack.dtype} cannot be written so, use .png, .tiff or .npy")
        for name, image in zip(names, frames.stack, strict=True):
            (folder / name).write_bytes(cv2.imencode(suffix, image)[1].tobytes())
    about: dict[str, Any] = {"microrelief_capture": SCHEMA, "taken_at": format_instant(frames.time)}
    if np.isfinite(frames.exposure_ms):
        about["exposure_ms"] = frames.exposure_ms
    about |= {"bits": 8 * frames.stack.itemsize, "patterns": frames.patterns.as_mapping(), "frames": names}
    (folder / CAPTURE_FILE).write_text(json.dumps(about, indent=1), encoding="utf-8")


def _read_about(folder: Path) -> Mapping[str, Any]:
    file = folder / CAPTURE_FILE
    if not file.exists():
        return {}
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read: {error}") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{file}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from None
    if not isinstance(about, dict) or about.get("microrelief_capture") != SCHEMA:
        raise InputError(f'{file}: is not a capture of this version, it must say "microrelief_capture": {SCHEMA}')
    return about


def _patterns_of(folder: Path, about: Mapping[str, Any]) -> PatternSet:
    if "patterns" in about:
        try:
            return PatternSet.from_mapping(about["patterns"])
        except ValueError as error:
            raise InputError(f"{folder / CAPTURE_FILE}: patterns: {error}") from None
    for place in (folder, folder.resolve().parent):
        for name in PATTERN_FILES:
            if (place / name).is_file():
                return read_patterns(place / name)
    raise InputError(f"{folder}: nothing says what was projected; name the pattern file with --patterns FILE.yaml")


def _named_frames(folder: Path, about: Mapping[str, Any]) -> list[Path] | None:
    names = about.get("frames")
    if names is None or names == [STACK_FILE]:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{folder / CAPTURE_FILE}: frames must be a list of file names")
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice:
        raise InputError(f"{folder / CAPTURE_FILE}: frames names {twice[0]} twice: each frame is a file of its own")
    files = [folder / name for name in names]
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: missing, {CAPTURE_FILE} names it as a frame")
    return files


def _images(folder: Path) -> list[Path]:
    """Image files by their names, in natural order; hidden ones are none."""
    return sorted(
        (
            file
            for file in folder.iterdir()
            if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".") and file.is_file()
        ),
        key=lambda file: natural_key(file.name),
    )


def _captures_below(folder: Path) -> str:
    """Say so where somebody named the folder of their captures instead of one."""
    below = sorted(each.name for each in folder.iterdir() if each.is_dir() and (_images(each) or _holds_stack(each)))
    return f"; it holds captures, name one: {', '.join(below[:3])}{', ...' * (len(below) > 3)}" if below else ""


def _holds_stack(folder: Path) -> bool:
    return (folder / STACK_FILE).is_file()


def _find_frames(folder: Path, expected: int) -> list[Path]:
    """Images in natural order; of too many, those whose name starts like most of the others."""
    images = _images(folder)
    known = {CAPTURE_FILE, *PATTERN_FILES, *(file.name for file in images)}
    skipped = sorted(file.name for file in folder.iterdir() if file.name not in known)
    if len(images) > expected:
        heads = Counter(_head(file) for file in images)
        head, _ = heads.most_common(1)[0]
        frames = [file for file in images if _head(file) == head]
        if len(frames) != expected:
            frames = _of_common_size(images)
        if len(frames) == expected:
            skipped += [file.name for file in images if file not in frames]
            images = frames
    if skipped:
        log.warning("%s: skipped, not frames: %s", folder, ", ".join(skipped))
    return images


def _head(file: Path) -> str:
    """What stands before the first number of a name, and the suffix."""
    found = re.match(r"\D*(?=\d)", file.stem)
    return f"{found.group()}#{file.suffix.lower()}" if found else file.name


def _of_common_size(files: Sequence[Path]) -> list[Path]:
    with _quiet_opencv(), ThreadPoolExecutor(THREADS) as pool:
        shapes = list(pool.map(_shape_of, files))
    common, _ = Counter(shapes).most_common(1)[0]
    return [file for file, shape in zip(files, shapes, strict=True) if shape == common]


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """What OpenCV would print of a broken image is said in our own words, in one line."""
    from cv2.utils import logging as opencv

    before = opencv.setLogLevel(opencv.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        opencv.setLogLevel(before)


def _shape_of(file: Path) -> tuple[int, ...]:
    try:
        return read_image(file).shape
    except InputError:
        return ()  # no image is no frame; where it should be one, it is named when it is read


def _read_images(files: Sequence[Path]) -> npt.NDArray[Any]:
    with _quiet_opencv(), ThreadPoolExecutor(THREADS) as pool:
        images = list(pool.map(read_image, files))
    common, votes = Counter((image.shape, image.dtype) for image in images).most_common(1)[0]
    for file, image in zip(files, images, strict=True):
        if image.shape != common[0]:
            raise InputError(
                f"{file}: is {image.shape[1]}x{image.shape[0]}, {votes} of {len(files)} frames are "
                f"{common[0][1]}x{common[0][0]}; if it is no frame move it away, else take the capture again"
            )
        if image.dtype != common[1]:
            raise InputError(f"{file}: has {8 * image.itemsize} bits, most frames have {8 * common[1].itemsize}")
    return np.stack(images)


def read_image(file: Path) -> npt.NDArray[Any]:
    """Read one image; colour becomes grey.

    Returns
    -------
    ndarray of uint8 or uint16, shape (row, column)

    Raises
    ------
    InputError
        If it cannot be read, is no whole image, or has other values.
    """
    import cv2

    try:
        data = np.fromfile(file, dtype=np.uint8)
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{file}: is not a whole image, take it again or move it away")
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{file}: has values of type {image.dtype}, frames have 8 or 16 bits")
    if image.ndim == 3:
        channels = image.shape[2]
        image = image[:, :, 0] if channels < 3 else cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image)


def _read_stack(file: Path) -> npt.NDArray[Any]:
    try:
        stack: npt.NDArray[Any] = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        raise InputError(
            f"{file}: is no whole array of numbers as numpy.save writes it: take the capture again"
        ) from None
    if stack.ndim != 3 or stack.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{file}: must be (frame, row, column) in uint8 or uint16, not {stack.dtype} of shape {stack.shape}"
        )
    return np.ascontiguousarray(stack)


def _time_of(folder: Path, about: Mapping[str, Any], first: Path) -> Instant:
    if "taken_at" not in about:
        return instant(datetime.fromtimestamp(first.stat().st_mtime, UTC))
    try:
        return parse_instant(str(about["taken_at"]))
    except ValueError as error:
        raise InputError(f"{folder / CAPTURE_FILE}: taken_at: {error}") from None


def _exposure(folder: Path, about: Mapping[str, Any]) -> float:
    value = about.get("exposure_ms", float("nan"))
    if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
        raise InputError(f"{folder / CAPTURE_FILE}: exposure_ms must be a number above 0, not {value!r}")
    return float(value)
