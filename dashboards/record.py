"""A store as one Rerun file: every scan, change, metric, alarm and event on the timelines `time` and `scan`.

A recording is a cache for people to look at; the store is the archive.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from configs import InputError, StoreError
from storage import Store, Stored, scan_table

from . import paths
from .alarm_limits import alarm_limits
from .blueprint import Layout, Preset, review_blueprint
from .campaign_text import settings_of
from .draw_cracks import log_sights
from .draw_frame import log_frame
from .draw_history import log_history
from .draw_scan import log_baseline, log_scan
from .draw_tracks import log_tracks
from .followed import Followed, follow, looks_for
from .metric_names import trend_groups
from .places import Places, places_of
from .scales import FULL, OVERVIEW, Scales, choose_scales, sample

if TYPE_CHECKING:
    import pandas as pd
    import rerun as rr

__all__ = ["Progress", "check_not_empty", "layout_of", "log_scans", "record_review", "recording_id"]

Progress = Callable[[int, int], None]
"""Called with (scans done, scans in all)."""


def record_review(
    store: Store,
    file: Path,
    *,
    preset: Preset = "overview",
    scans: tuple[int, int] | None = None,
    tracks: pd.DataFrame | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a store's review as an ``.rrd`` file, layout included.

    Parameters
    ----------
    store : Store
    file : Path
        Overwritten; its folder is made.
    preset : str
        What is in front when it opens.
    scans : (int, int), optional
        Only these, the first and the last, and at full resolution.
    tracks : DataFrame, optional
        Paths of what moves on the surface, as `read_tracks` gives them.
    progress : callable, optional
        Called after each scan with (done, total).

    Raises
    ------
    StoreError
        If the store holds no scan.
    InputError
        If the file cannot be written, or there are no such scans.
    """
    import rerun as rr

    check_not_empty(store)
    numbers = range(len(store)) if scans is None else _chosen(store, *scans)
    layout = layout_of(
        store, choose_scales(sample(store), OVERVIEW if scans is None else FULL), tracks=tracks is not None
    )
    # a name of its own: the viewer would lay two recordings of one name into each other, and show all of one
    # application in the layout of the first
    name = f"{recording_id(store)}-{store.about.snapshot}-{preset}"
    stream = rr.RecordingStream(f"{paths.APPLICATION}-{name}", recording_id=name)
    stream.disable_timeline("log_time")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()  # an operating system's error says more than Rerun's
    except OSError as error:
        raise InputError(f"{file}: the review cannot be written there: {error.strerror}") from None
    if file.is_dir():
        raise InputError(f"{file}: is a folder, name a file")
    stream.save(file)
    try:
        # active, not only the default: a viewer that remembers another layout would show that one
        stream.send_blueprint(review_blueprint(layout, preset))
        stream.send_recording_name(store.about.site or paths.APPLICATION)
        places = places_of(settings_of(store.about.campaign))
        log_frame(stream, layout.scales, places)
        first = store[numbers[0]]
        if first.baseline < first.number:
            log_baseline(stream, store[first.baseline], layout.scales, first.scan.time, first.number)
        log_scans(stream, store, numbers, layout, Followed(), places, progress)
        log_history(stream, store, layout.trends)
        if tracks is not None:
            log_tracks(stream, tracks, scan_table(store), layout.scales, numbers)
    finally:
        stream.flush()
        stream.disconnect()


def check_not_empty(store: Store) -> None:
    """Raise StoreError where there is no scan to look at."""
    if not len(store):
        raise StoreError(
            f"{store.about.location} holds no scan yet: nothing to review until the first one is committed"
        )


def recording_id(store: Store) -> str:
    """Name the recording of a store, one for all its days, so that it can stand in an address."""
    name = f"{store.about.site or paths.APPLICATION}-{store.about.campaign_hash[:12]}"
    return re.sub(r"[^A-Za-z0-9.]+", "-", name).strip("-")


def layout_of(store: Store, scales: Scales, *, tracks: bool = False) -> Layout:
    """Choose what is shown from what the store measures."""
    times = scan_table(store).times
    lasted = float((times[-1] - times[0]) / np.timedelta64(1, "s"))
    cracks, plates = looks_for(store.about.metrics)
    return Layout(
        scales,
        lasted / max(len(times) - 1, 1),
        trend_groups(store.series(), store.about.metrics),
        frozenset(alarm.metric for alarm in alarm_limits(store.about.campaign) if alarm.lines),
        cracks,
        plates,
        tracks,
    )


def log_scans(
    stream: rr.RecordingStream,
    store: Store,
    numbers: Sequence[int],
    layout: Layout,
    before: Followed,
    places: Places,
    progress: Progress | None = None,
    *,
    followed: frozenset[int] | None = None,
) -> Followed:
    """Log scans in their order; give what the next ones need to know of cracks and plates.

    Cracks are followed in the scans `followed`, in all where it is None.
    """
    for done, number in enumerate(numbers, start=1):
        stored = store[number]
        log_scan(stream, stored, layout.scales, store.about)
        if layout.cracks and (followed is None or number in followed):
            before = log_followed(stream, store, stored, layout, before, places)
        stream.flush()  # a chunk for each scan: the viewer then fetches those it shows
        if progress is not None:
            progress(done, len(numbers))
    return before


def log_followed(
    stream: rr.RecordingStream,
    store: Store,
    stored: Stored,
    layout: Layout,
    before: Followed,
    places: Places,
) -> Followed:
    """Log the cracks and plates of one scan, whose times are set; give what the next one needs."""
    held = before.baseline is not None and before.baseline[0] == stored.baseline
    baseline = None if held or stored.change is None or not layout.plates else store[stored.baseline]
    sights, after = follow(stored, baseline, before, places, plates=layout.plates)
    log_sights(stream, sights, layout.scales)
    return after


def _chosen(store: Store, first: int, last: int) -> range:
    total = len(store)
    first, last = (number + total if number < 0 else number for number in (first, last))
    if not 0 <= first <= last < total:
        raise InputError(f"{store.about.location}: has no scans {first} to {last}: they are 0 to {total - 1}")
    return range(first, last + 1)
