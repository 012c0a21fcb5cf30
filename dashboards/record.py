"""A store as a Rerun recording: every scan, change, metric, alarm and event on the timelines `time` and `scan`.

The recording is a cache for people to look at; the store is the archive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from configs import InputError, StoreError
from pipelines import ALARM_STATES, Event, Instant, acknowledgements, alarm_changes
from storage import Store, Stored

from . import paths
from .blueprint import MOST_MAP_CELLS, Layout, review_blueprint
from .metric_names import TrendGroup, trend_groups
from .palette import ACKNOWLEDGED, CHANGE_SCALE, HEIGHT_SCALE, SERIES, STATE_COLOURS, VISIT_COLOURS, Rgb, colour_table
from .quantities import day_and_time, plain, unit_text
from .raster import Range, change_png, height_png, round_limit, texture_png
from .surface import surface, triangles
from .visits import Visit, visits

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["Progress", "record_review"]

Progress = Callable[[int, int], None]
"""Called with (scans done, scans in all)."""

_LEVELS = {"lost": "ERROR", "failed": "WARN", "missed": "WARN", "rejected": "WARN", "alarm": "WARN"}
_VERDICT_COLOURS = {"good": STATE_COLOURS["ok"], "doubtful": STATE_COLOURS["warning"], "failed": STATE_COLOURS["alarm"]}


def record_review(store: Store, file: Path, *, progress: Progress | None = None) -> None:
    """Write a store's review as an ``.rrd`` file, layout included.

    Parameters
    ----------
    store : Store
    file : Path
        Overwritten; its folder is made.
    progress : callable, optional
        Called after each scan with (done, total).

    Raises
    ------
    StoreError
        If the store holds no scan.
    InputError
        If the file cannot be written.
    """
    import rerun as rr

    if not len(store):
        raise StoreError(
            f"{store.about.location} holds no scan yet: nothing to review until the first one is committed"
        )
    series = store.series()
    layout = _layout(store, series)
    stream = rr.RecordingStream(paths.APPLICATION, recording_id=f"{store.about.site}-{store.about.snapshot}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()  # an operating system's error says more than Rerun's
    except OSError as error:
        raise InputError(f"{file}: the review cannot be written there: {error.strerror}") from None
    if file.is_dir():
        raise InputError(f"{file}: is a folder, name a file")
    stream.save(file, default_blueprint=review_blueprint(layout))
    try:
        stream.send_recording_name(store.about.site or paths.APPLICATION)
        _log_frame(stream, layout)
        total = len(store)
        times: list[Instant] = []
        planned: list[Instant] = []
        alarms: dict[str, str] = {}
        for number in range(total):
            stored = store[number]
            _log_scan(stream, stored, layout)
            _log_alarms(stream, stored, alarms)
            times.append(stored.scan.time)
            planned.append(stored.planned)
            if progress is not None:
                progress(number + 1, total)
        settled = visits(store, planned)
        _log_trends(stream, series, layout.trends, [visit.planned for visit in settled if visit.state != "taken"])
        _log_visits(stream, settled, times)
        _log_alarms_between(stream, store.events, times)
        for event in store.events:
            _log_event(stream, event, times)
    finally:
        stream.flush()
        stream.disconnect()


def _layout(store: Store, series: pd.DataFrame) -> Layout:
    """Choose scales that hold for the whole campaign from its first, middle and newest scan."""
    total = len(store)
    chosen = [store[number] for number in sorted({0, total // 2, total - 1})]
    heights = np.concatenate([stored.scan.height[np.isfinite(stored.scan.height)] for stored in chosen])
    low, high = (float(edge) for edge in np.percentile(heights, (2, 98))) if heights.size else (0.0, 1.0)
    span = Range(low, high) if high > low else Range(low - 0.5, high + 0.5)
    changes = [stored.change.dz for stored in chosen if stored.change is not None]
    moved = np.concatenate([np.abs(dz[np.isfinite(dz)]) for dz in changes]) if changes else np.zeros(0)
    limit = round_limit(float(np.percentile(moved, 95))) if moved.size else 0.0
    grid = chosen[-1].scan.grid
    lasted = (chosen[-1].scan.time - chosen[0].scan.time) / np.timedelta64(1, "s")
    interval = float(lasted) / max(total - 1, 1)
    groups = trend_groups(series, store.about.metrics)
    return Layout(grid, span, limit, _exaggeration(span, grid.extent_mm), interval, groups)


def _exaggeration(span: Range, extent: tuple[float, float, float, float]) -> float:
    """How much taller to draw heights so that relief is seen: a tenth of the width, at most 50 times."""
    wanted = 0.1 * max(extent[1] - extent[0], extent[3] - extent[2]) / (span.high - span.low)
    return float(max((step for step in (1, 2, 5, 10, 20, 50) if step <= wanted), default=1))


def _log_frame(stream: rr.RecordingStream, layout: Layout) -> None:
    """Log what does not change: triangles, the drawing scale, colour bars, the looks of lines and lanes."""
    import rerun as rr

    stream.log(paths.SURFACE, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log(paths.SURFACE, rr.Transform3D(scale=[1.0, 1.0, layout.exaggeration]), static=True)
    stream.log(f"{paths.SURFACE}/mesh", rr.Mesh3D.from_fields(triangle_indices=triangles(layout.grid)), static=True)
    rows, columns = layout.map_shape
    _log_colour_bar(stream, f"{paths.HEIGHT}/scale", HEIGHT_SCALE, layout.height, rows, columns)
    if layout.change_limit_mm > 0:
        ends = Range(-layout.change_limit_mm, layout.change_limit_mm)
        _log_colour_bar(stream, f"{paths.CHANGE}/scale", CHANGE_SCALE, ends, rows, columns)
    for group in layout.trends:
        for metric, colour in zip(group.metrics, SERIES * len(group.metrics), strict=False):
            looks = rr.Measurements.from_fields(
                names=[metric.title], units=[unit_text(metric.unit)], colors=[colour], widths=[2.0]
            )
            stream.log(paths.trend(metric.name), looks, static=True)


def _log_colour_bar(
    stream: rr.RecordingStream, path: str, scale: tuple[Rgb, ...], ends: Range, rows: int, columns: int
) -> None:
    """Draw a colour bar below a map, with its two ends and its middle in mm."""
    import rerun as rr

    steps = 64
    x = np.linspace(0.1 * columns, 0.9 * columns, steps + 1)
    top, bottom = 1.04 * rows, 1.08 * rows
    bars = [[[(a + b) / 2, top], [(a + b) / 2, bottom]] for a, b in pairwise(x)]
    radius = 0.75 * (x[1] - x[0])
    stream.log(path, rr.LineStrips2D(bars, colors=colour_table(scale, steps), radii=float(radius)), static=True)
    labels = [_signed(ends.low), _signed((ends.low + ends.high) / 2), f"{_signed(ends.high)} mm"]
    stream.log(
        f"{path}/labels",
        rr.Points2D(
            [[x[0], 1.075 * rows], [(x[0] + x[-1]) / 2, 1.075 * rows], [x[-1], 1.075 * rows]],
            labels=labels,
            radii=0.0,
            colors=[[200, 203, 208]],
            show_labels=True,
        ),
        static=True,
    )


def _log_scan(stream: rr.RecordingStream, stored: Stored, layout: Layout) -> None:
    import rerun as rr

    scan, change = stored.scan, stored.change
    _set_times(stream, scan.time, stored.number)
    if scan.grid == layout.grid:
        shape = surface(scan, layout.height)
        mesh = rr.Mesh3D.from_fields(
            vertex_positions=shape.positions, vertex_normals=shape.normals, vertex_colors=shape.colours
        )
        stream.log(f"{paths.SURFACE}/mesh", mesh)
    else:  # an earlier epoch on another grid: the triangles of this one would join the wrong vertices
        stream.log(f"{paths.SURFACE}/mesh", rr.Clear(recursive=False))
    stream.log(paths.HEIGHT, _encoded(height_png(scan.height, layout.height, MOST_MAP_CELLS)))
    stream.log(paths.CAMERA, _encoded(texture_png(scan.texture, MOST_MAP_CELLS)))
    if layout.change_limit_mm > 0:
        nothing = np.zeros(scan.grid.shape, dtype=np.float32)
        dz, lod = (change.dz, change.lod) if change is not None else (nothing, nothing)
        if change is None:
            dz = np.where(np.isfinite(scan.height), nothing, np.float32(np.nan))
        stream.log(paths.CHANGE, _encoded(change_png(dz, lod, layout.change_limit_mm, MOST_MAP_CELLS)))
    stream.log(paths.LOG, rr.TextLog(_line(scan.time, _scan_line(stored)), level="INFO"))
    if change is not None:
        stream.log(paths.REGISTRATION, rr.StateChange(state=change.motion.verdict))


def _scan_line(stored: Stored) -> str:
    measured = f"scan {stored.number}: {100 * stored.scan.coverage:.1f} % measured"
    if stored.change is None:
        return f"{measured}, baseline"
    motion = stored.change.motion
    reason = f", {motion.reason}" if motion.reason else ""
    return f"{measured}, registration {motion.verdict}, {plain(1000 * motion.residual_mm, 2)} µm{reason}"


def _log_alarms(stream: rr.RecordingStream, stored: Stored, last: dict[str, str]) -> None:
    """Log an alarm's state where it changes; its lane keeps the colour until the next."""
    import rerun as rr

    for name, state in stored.alarms.items():
        path = paths.alarm(name)
        if name not in last:
            looks = rr.StateConfiguration(
                values=[*ALARM_STATES, "acknowledged"],
                colors=[*(STATE_COLOURS[known] for known in ALARM_STATES), ACKNOWLEDGED],
            )
            stream.log(path, looks, static=True)
        if last.get(name) != state:
            stream.log(path, rr.StateChange(state=state))
            last[name] = state


def _log_alarms_between(stream: rr.RecordingStream, events: Sequence[Event], times: list[Instant]) -> None:
    """Log what became of alarms between scans: no data after slots that gave none, and acknowledgements."""
    import rerun as rr

    scans = set(times)
    for change in alarm_changes(events):
        if change.time not in scans:
            _set_times(stream, change.time, _scan_at(change.time, times))
            stream.log(paths.alarm(change.name), rr.StateChange(state=change.after))
    for seen in acknowledgements(events):
        _set_times(stream, seen.time, _scan_at(seen.time, times))
        stream.log(paths.alarm(seen.name), rr.StateChange(state="acknowledged"))


def _log_trends(
    stream: rr.RecordingStream, series: pd.DataFrame, groups: Sequence[TrendGroup], gaps: list[Instant]
) -> None:
    """Log each metric's whole history at once, with a break in the line where a visit yielded nothing."""
    import rerun as rr

    if series.empty:
        return
    names = [metric.name for group in groups for metric in group.metrics]
    times = series.index.tz_convert("UTC").tz_localize(None).to_numpy().astype("datetime64[ns]")  # type: ignore[attr-defined] # an Index by its stub
    for name in names:
        values = series[name].to_numpy(dtype=np.float64)
        sigmas = series[f"{name}_sigma"].to_numpy(dtype=np.float64)
        variances = np.where(np.isfinite(sigmas), sigmas, 0.0) ** 2
        stream.send_columns(
            paths.trend(name),
            indexes=[
                rr.TimeColumn(paths.TIME_TIMELINE, timestamp=times),
                rr.TimeColumn(paths.SCAN_TIMELINE, sequence=series["scan"].to_numpy().astype(np.int64)),
            ],
            columns=rr.Measurements.columns(values=values, variances=variances),
        )
        lost = [moment for moment in gaps if times[0] < moment < times[-1]]
        if lost:
            nothing = np.full(len(lost), np.nan)
            stream.send_columns(
                paths.trend(name),
                indexes=[rr.TimeColumn(paths.TIME_TIMELINE, timestamp=np.array(lost, dtype="datetime64[ns]"))],
                columns=rr.Measurements.columns(values=nothing, variances=np.zeros(len(lost))),
            )


def _log_visits(stream: rr.RecordingStream, settled: tuple[Visit, ...], times: list[Instant]) -> None:
    import rerun as rr

    looks = rr.StateConfiguration(values=list(VISIT_COLOURS), colors=list(VISIT_COLOURS.values()))
    stream.log(paths.VISITS, looks, static=True)
    verdicts = rr.StateConfiguration(values=list(_VERDICT_COLOURS), colors=list(_VERDICT_COLOURS.values()))
    stream.log(paths.REGISTRATION, verdicts, static=True)
    for visit in settled:
        _set_times(stream, visit.planned, _scan_at(visit.planned, times))
        stream.log(paths.VISITS, rr.StateChange(state=visit.state))


def _log_event(stream: rr.RecordingStream, event: Event, times: list[Instant]) -> None:
    import rerun as rr

    _set_times(stream, event.time, _scan_at(event.time, times))
    line = _line(event.time, f"{event.kind}: {event.text}")
    stream.log(paths.LOG, rr.TextLog(line, level=_LEVELS.get(event.kind, "INFO")))


def _line(moment: Instant, text: str) -> str:
    """Begin with the time: the viewer's own time column is too narrow for it."""
    return f"{day_and_time(moment).removesuffix(' UTC')}  {text}"


def _scan_at(moment: Instant, times: list[Instant]) -> int:
    """Number of the newest scan at that moment, 0 before the first: where the `scan` timeline shows it."""
    return max(int(np.searchsorted(np.array(times), moment, side="right")) - 1, 0)


def _set_times(stream: rr.RecordingStream, moment: Instant, number: int) -> None:
    stream.set_time(paths.TIME_TIMELINE, timestamp=moment)
    stream.set_time(paths.SCAN_TIMELINE, sequence=number)


def _encoded(png: bytes) -> Any:
    import rerun as rr

    return rr.EncodedImage(contents=png, media_type="image/png")


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{plain(value, 2)}"
