"""Shards: a store's recording in a file for each day, kept beside the store; only what has changed is made."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from configs import InputError, MicroreliefError
from storage import Store, only_grown, scan_table, whole_file

from . import paths
from .blueprint import Layout
from .campaign_text import settings_of
from .draw_frame import log_frame
from .draw_history import log_history
from .draw_tracks import log_tracks
from .followed import Followed, keep, looks_for, remember
from .places import Places, places_of
from .record import Progress, check_not_empty, layout_of, log_scans, recording_id
from .scales import Scales, choose_scales, sample, still_fit

if TYPE_CHECKING:
    import pandas as pd
    import rerun as rr

__all__ = ["Shards", "cache_folder", "update_shards"]

FORMAT = 3
"""Grows with what is drawn, and how: shards of another format are made again."""

MOST_A_DAY = 720
"""Scans of one day that are drawn, evenly spread: one every two minutes. All are in trends, lanes and log."""

MOST_FOLLOWED_A_DAY = 24
"""Scans of one day in which cracks are followed: one an hour."""

_MANIFEST = "shards.json"
_FRAME, _HISTORY, _PATHS = "frame.rrd", "history.rrd", "paths.rrd"
_BYTES_A_VERTEX, _BYTES_A_CELL = 40, 6
_SPARE_BYTES = 2_000_000_000
"""What a review leaves free on the disk, for the campaign that may be writing there."""


@dataclass(frozen=True, slots=True)
class Shards:
    """The files of a store's recording, and how they are shown.

    Parameters
    ----------
    files : mapping of str to Path
        By layer: ``frame``, ``history``, ``paths`` where there are some, and each day.
    recording : str
        The recording's id, the same in all of them.
    layout : Layout
    made : int
        Scans that were drawn for it just now.
    """

    files: Mapping[str, Path]
    recording: str
    layout: Layout
    made: int


@dataclass(frozen=True, slots=True)
class _Day:
    name: str
    numbers: Sequence[int]
    followed: frozenset[int]
    key: str


@dataclass(frozen=True, slots=True)
class _Kept:
    """What an earlier review left: what it was made of, and the key of each day that is there."""

    recipe: str = ""
    snapshot: str = ""
    scales: Scales | None = None
    days: Mapping[str, str] = field(default_factory=dict)


def cache_folder(store: Store) -> Path:
    """Give the folder of a store's shards: beside it, or the user's own where that cannot be written or is a bucket."""
    location = store.about.location
    if "://" not in location and Path(location).exists():
        beside = Path(location).parent / f"{Path(location).stem}.review"
        with suppress(OSError):
            beside.mkdir(exist_ok=True)
            with (beside / ".writable").open("w"):
                pass
            (beside / ".writable").unlink()
            return beside
    import platformdirs

    digest = hashlib.sha256(str(location).encode()).hexdigest()[:12]
    return Path(platformdirs.user_cache_dir(paths.APPLICATION, False)) / "review" / digest


def update_shards(
    store: Store,
    folder: Path,
    *,
    tracks: pd.DataFrame | None = None,
    progress: Progress | None = None,
) -> Shards:
    """Bring the shards in `folder` up to a store's newest snapshot.

    A day is made again where scans came to it; all days where scans were processed again, another baseline was chosen,
    or values have outgrown the colour scales.

    Parameters
    ----------
    store : Store
    folder : Path
        As `cache_folder` gives it; made if it is not there.
    tracks : DataFrame, optional
        Paths of what moves on the surface, as `read_tracks` gives them; drawn anew each time, in a file of their own.
    progress : callable, optional
        Called after each scan that is drawn with (done, total).

    Raises
    ------
    StoreError
        If the store holds no scan.
    InputError
        If the folder cannot be written.
    MicroreliefError
        If the disk has no room for it.
    """
    check_not_empty(store)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the review cannot be kept there: {error.strerror}") from None
    places = places_of(settings_of(store.about.campaign))
    recipe = _recipe(store, places)
    kept = _read(folder)
    good = kept.recipe == recipe and kept.scales is not None and only_grown(store, kept.snapshot)
    scales = kept.scales if good and kept.scales is not None and still_fit(kept.scales, store[len(store) - 1]) else None
    if scales is None:
        scales, kept = choose_scales(sample(store)), _Kept()
    layout = layout_of(store, scales, tracks=tracks is not None)
    days = _days(store, recipe)
    present = {
        day.name: day.key for day in days if kept.days.get(day.name) == day.key and _file(folder, day.name).exists()
    }
    todo = _from_first_missing(days, present, layout.cracks)
    total = sum(len(day.numbers) for day in todo)
    _check_room(folder, scales, total)
    recording = recording_id(store)
    if not present or not (folder / _FRAME).exists():
        with _stream(folder / _FRAME, recording) as stream:
            stream.send_recording_name(store.about.site or paths.APPLICATION)
            log_frame(stream, scales, places)
    done = 0
    for day in todo:
        before = _before(folder, days, day)
        with _stream(_file(folder, day.name), recording) as stream:

            def step(count: int, _: int, done: int = done) -> None:
                if progress is not None:
                    progress(done + count, total)

            after = log_scans(stream, store, day.numbers, layout, before, places, step, followed=day.followed)
        if layout.cracks:
            with whole_file(_memory(folder, day.name)) as file:
                keep(after, file)
        done += len(day.numbers)
        present[day.name] = day.key
        # after each day: work that was cut short goes on where it stood
        _write(folder, _Kept(recipe, store.about.snapshot, scales, present))
    _write(folder, _Kept(recipe, store.about.snapshot, scales, present))
    with _stream(folder / _HISTORY, recording) as stream:
        log_history(stream, store, layout.trends)
    files = {"frame": folder / _FRAME, "history": folder / _HISTORY}
    if tracks is not None:
        files["paths"] = folder / _PATHS
        with _stream(files["paths"], recording) as stream:
            log_tracks(stream, tracks, scan_table(store), scales, range(len(store)))
    _sweep(folder, present)
    return Shards(files | {day.name: _file(folder, day.name) for day in days}, recording, layout, total)


def _recipe(store: Store, places: Places) -> str:
    """Name what all shards depend on beside the scans."""
    made_of = [
        FORMAT,
        version("rerun-sdk").rpartition(".")[0],
        recording_id(store),
        looks_for(store.about.metrics),
        places.named,
    ]
    return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()[:16]


def _days(store: Store, recipe: str) -> list[_Day]:
    table = scan_table(store)
    names = np.datetime_as_string(table.times, unit="D")
    days = []
    for name in dict.fromkeys(names.tolist()):
        numbers = np.flatnonzero(names == name)
        drawn = _spread(numbers, MOST_A_DAY)
        made_of = [recipe, [[int(number), str(table.times[number]), int(table.epochs[number])] for number in drawn]]
        key = hashlib.sha256(json.dumps(made_of).encode()).hexdigest()[:16]
        days.append(_Day(name, drawn, frozenset(_spread(np.array(drawn), MOST_FOLLOWED_A_DAY)), key))
    return days


def _spread(numbers: npt.NDArray[np.integer[Any]], most: int) -> list[int]:
    """Give all of some numbers, or `most` of them evenly spread, the last among them."""
    step = -(-len(numbers) // most)
    return [int(number) for number in numbers[::-1][::step][::-1]]


def _from_first_missing(days: list[_Day], present: dict[str, str], cracks: bool) -> list[_Day]:
    """Give the days to make: the missing ones, and where cracks are followed from day to day all that come after."""
    missing = [day.name not in present for day in days]
    if cracks and any(missing):
        first = missing.index(True)
        missing = [number >= first for number in range(len(days))]
    return [day for day, away in zip(days, missing, strict=True) if away]


def _before(folder: Path, days: list[_Day], day: _Day) -> Followed:
    """Recall the cracks and plates of the day before; where that cannot be read, their names begin anew."""
    number = days.index(day)
    if number:
        with suppress(OSError, ValueError, KeyError):
            return remember(_memory(folder, days[number - 1].name))
    return Followed()


@contextmanager
def _stream(file: Path, recording: str) -> Iterator[rr.RecordingStream]:
    """Record into a file that takes its place when it is whole."""
    import rerun as rr

    with whole_file(file) as draft:
        stream = rr.RecordingStream(paths.APPLICATION, recording_id=recording)
        stream.disable_timeline("log_time")
        stream.save(draft)
        try:
            yield stream
        finally:
            stream.flush()
            stream.disconnect()


def _file(folder: Path, day: str) -> Path:
    return folder / f"{day}.rrd"


def _memory(folder: Path, day: str) -> Path:
    return folder / f"{day}.cracks.npz"


def _read(folder: Path) -> _Kept:
    """Read what an earlier review left; what cannot be read is made again."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        kept = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return _Kept(str(kept["recipe"]), str(kept["snapshot"]), Scales.from_json(kept["scales"]), dict(kept["days"]))
    return _Kept()


def _write(folder: Path, kept: _Kept) -> None:
    assert kept.scales is not None
    text = json.dumps(
        {"recipe": kept.recipe, "snapshot": kept.snapshot, "scales": kept.scales.to_json(), "days": dict(kept.days)},
        indent=1,
    )
    with whole_file(folder / _MANIFEST) as file:
        file.write_text(text, encoding="utf-8")


def _sweep(folder: Path, present: Mapping[str, str]) -> None:
    """Remove days that are not the store's any more."""
    for file in (*folder.glob("????-??-??.rrd"), *folder.glob("????-??-??.cracks.npz")):
        if file.name.partition(".")[0] not in present:
            file.unlink(missing_ok=True)


def _check_room(folder: Path, scales: Scales, scans: int) -> None:
    cells, vertices = scales.grid.rows * scales.grid.columns, scales.detail.vertices
    needed = scans * (_BYTES_A_VERTEX * min(cells, vertices) + _BYTES_A_CELL * min(cells, scales.detail.cells))
    free = shutil.disk_usage(folder).free
    if needed and free < needed + _SPARE_BYTES:
        raise MicroreliefError(
            f"{folder}: a review of {scans} scans takes {needed / 1e9:.1f} GB there and {free / 1e9:.1f} GB are free: "
            "make room, or look at some scans with --scans FIRST:LAST"
        )
