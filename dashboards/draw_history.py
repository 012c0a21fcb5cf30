"""Draws what is known of a whole campaign without its cells: trends with limits and gaps, visits, alarms, events."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pipelines import ALARM_STATES, Event, Instant, acknowledgements, alarm_changes
from storage import ScanTable, Store, scan_table

from . import paths
from .alarm_limits import alarm_limits
from .draw_scan import clock_line, set_times
from .happened import known_events
from .metric_names import TrendGroup
from .palette import ACKNOWLEDGED, LINES, STATE_COLOURS, VISIT_COLOURS
from .quantities import unit_text
from .visits import Visit, visits

if TYPE_CHECKING:
    import rerun as rr

__all__ = [
    "log_acknowledgements",
    "log_alarm",
    "log_alarm_looks",
    "log_event",
    "log_history",
    "log_lanes",
    "log_state",
    "log_trend_looks",
    "log_visit",
    "scan_at",
]

Times = npt.NDArray[np.datetime64]

_LEVELS = {"lost": "ERROR", "failed": "WARN", "missed": "WARN", "rejected": "WARN", "alarm": "WARN"}
_VERDICT_COLOURS = {"good": STATE_COLOURS["ok"], "doubtful": STATE_COLOURS["warning"], "failed": STATE_COLOURS["alarm"]}


_FAR = 3.0
"""A limit that is so many times what was ever measured would flatten the plot."""


def log_history(stream: rr.RecordingStream, store: Store, groups: Sequence[TrendGroup]) -> None:
    """Log the lanes, lines and texts of a whole campaign at once."""
    table = scan_table(store)
    log_trend_looks(stream, groups)
    log_lanes(stream)
    settled = visits(store, list(table.planned))
    lost = [visit.planned for visit in settled if visit.state != "taken"]
    _log_trends(stream, table, groups, lost)
    _log_limits(stream, store.about.campaign, groups, table)
    for visit in settled:
        log_visit(stream, visit, scan_at(visit.planned, table.times))
    for number, verdict in enumerate(table.verdicts):
        if verdict:
            log_state(stream, paths.REGISTRATION, verdict, table.times[number], number)
    events = known_events(store)
    _log_alarms(stream, table, events)
    for event in events:
        log_event(stream, event, scan_at(event.time, table.times))


def log_trend_looks(stream: rr.RecordingStream, groups: Sequence[TrendGroup]) -> None:
    """Log the name, unit and colour of each metric's line."""
    import rerun as rr

    for group in groups:
        for number, metric in enumerate(group.metrics):
            looks = rr.Measurements.from_fields(
                names=[metric.title],
                units=[unit_text(metric.unit)],
                colors=[LINES[number % len(LINES)]],
                widths=[2.0],
            )
            stream.log(paths.trend(metric.name), looks, static=True)


def log_lanes(stream: rr.RecordingStream) -> None:
    """Log the colours of the lanes of visits and registrations."""
    import rerun as rr

    for path, colours in ((paths.VISITS, VISIT_COLOURS), (paths.REGISTRATION, _VERDICT_COLOURS)):
        looks = rr.StateConfiguration(values=list(colours), colors=list(colours.values()))
        stream.log(path, looks, static=True)


def log_visit(stream: rr.RecordingStream, visit: Visit, number: int) -> None:
    """Log what became of one visit."""
    log_state(stream, paths.VISITS, visit.state, visit.planned, number)


def log_event(stream: rr.RecordingStream, event: Event, number: int) -> None:
    """Log one event's line."""
    import rerun as rr

    set_times(stream, event.time, number)
    line = clock_line(event.time, f"{event.kind}: {event.text}")
    stream.log(paths.LOG, rr.TextLog(line, level=_LEVELS.get(event.kind, "INFO")))


def log_alarm(stream: rr.RecordingStream, name: str, state: str, moment: Instant, number: int) -> None:
    """Log that an alarm is in a state from now on; its lane keeps the colour until the next."""
    log_state(stream, paths.alarm(name), state, moment, number)


def log_alarm_looks(stream: rr.RecordingStream, name: str) -> None:
    """Log the colours of one alarm's lane."""
    import rerun as rr

    looks = rr.StateConfiguration(
        values=[*ALARM_STATES, "acknowledged"],
        colors=[*(STATE_COLOURS[known] for known in ALARM_STATES), ACKNOWLEDGED],
    )
    stream.log(paths.alarm(name), looks, static=True)


def log_acknowledgements(stream: rr.RecordingStream, events: Iterable[Event], number: Callable[[Instant], int]) -> None:
    """Log in an alarm's lane that somebody has seen it; `number` gives the newest scan at a moment."""
    for seen in acknowledgements(events):
        log_alarm(stream, seen.name, "acknowledged", seen.time, number(seen.time))


def scan_at(moment: Instant, times: Times) -> int:
    """Number of the newest scan at that moment, 0 before the first: where the `scan` timeline shows it."""
    return max(int(np.searchsorted(times, moment, side="right")) - 1, 0)


def log_state(stream: rr.RecordingStream, path: str, state: str, moment: Instant, number: int) -> None:
    """Log that a lane is in a state from a moment on."""
    import rerun as rr

    set_times(stream, moment, number)
    stream.log(path, rr.StateChange(state=state))


def _log_alarms(stream: rr.RecordingStream, table: ScanTable, events: Iterable[Event]) -> None:
    """Log where alarms stand after each scan, and what became of them in between: silence, and acknowledgements."""
    told: dict[str, str] = {}
    for number, states in enumerate(table.alarms):
        for name, state in states.items():
            if name not in told:
                log_alarm_looks(stream, name)
            if told.get(name) != state:
                told[name] = state
                log_alarm(stream, name, state, table.times[number], number)
    scans = set(table.times)
    for change in alarm_changes(events):
        if change.time not in scans:
            log_alarm(stream, change.name, change.after, change.time, scan_at(change.time, table.times))
    log_acknowledgements(stream, events, lambda moment: scan_at(moment, table.times))


def _log_trends(
    stream: rr.RecordingStream, table: ScanTable, groups: Sequence[TrendGroup], gaps: list[Instant]
) -> None:
    """Log each metric's whole history at once, with a break in the line where a visit yielded nothing."""
    import rerun as rr

    if not len(table):
        return
    lost = np.array([at for at in gaps if table.times[0] < at < table.times[-1]], dtype="datetime64[ns]")
    lost = lost[~np.isin(lost, table.times)]
    nothing = np.full(len(lost), np.nan)
    for name in (metric.name for group in groups for metric in group.metrics):
        values, sigmas = table.metrics[name]
        stream.send_columns(
            paths.trend(name),
            indexes=[
                rr.TimeColumn(paths.TIME_TIMELINE, timestamp=table.times),
                rr.TimeColumn(paths.SCAN_TIMELINE, sequence=np.arange(len(table))),
            ],
            columns=rr.Measurements.columns(values=values, variances=np.where(np.isfinite(sigmas), sigmas, 0.0) ** 2),
        )
        if len(lost):  # on the timeline `scan` there is no place for what was not scanned
            stream.send_columns(
                paths.trend(name),
                indexes=[rr.TimeColumn(paths.TIME_TIMELINE, timestamp=lost)],
                columns=rr.Measurements.columns(values=nothing, variances=np.zeros(len(lost))),
            )


def _log_limits(stream: rr.RecordingStream, campaign: str, groups: Sequence[TrendGroup], table: ScanTable) -> None:
    """Log the limits that a campaign set, from its first scan to its last, where they do not dwarf the values."""
    import rerun as rr

    if not len(table):
        return
    reach = {metric.name: _reach(table, group) for group in groups for metric in group.metrics}
    numbers = np.unique([0, len(table) - 1])
    count: dict[str, int] = {}
    for alarm in alarm_limits(campaign):
        for line in alarm.lines:
            if abs(line.value) > _FAR * reach.get(alarm.metric, 0.0):
                continue
            number = count[alarm.metric] = count.get(alarm.metric, 0) + 1
            path = paths.limit(alarm.metric, number)
            words = f"{alarm.name}: {line.grade}{' below' if line.side == 'below' else ''}"
            colour = STATE_COLOURS["warning" if line.grade == "warning" else "alarm"]
            stream.log(path, rr.SeriesLines(names=words, colors=colour, widths=1.0), static=True)
            stream.send_columns(
                path,
                indexes=[
                    rr.TimeColumn(paths.TIME_TIMELINE, timestamp=table.times[numbers]),
                    rr.TimeColumn(paths.SCAN_TIMELINE, sequence=numbers),
                ],
                columns=rr.Scalars.columns(scalars=np.full(len(numbers), line.value)),
            )


def _reach(table: ScanTable, group: TrendGroup) -> float:
    """Give the largest magnitude that a plot shows."""
    values = [np.abs(table.metrics[metric.name][0]) for metric in group.metrics]
    return max((float(np.nanmax(each, initial=0.0)) for each in values), default=0.0)
