"""One visit: frames to a tick. Arrays in, values out; the loop around it has the clock, the rig and the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from configs import Alarm, CaptureError
from pipelines import (
    AlarmState,
    Calibration,
    Change,
    Comparison,
    Event,
    Frames,
    Grid,
    Instant,
    Measurement,
    PatternSet,
    Scan,
    Tick,
    with_uncertainty,
)

if TYPE_CHECKING:
    from pipelines.change import NoiseModel
    from pipelines.trends import Limits

__all__ = [
    "Epoch",
    "Finding",
    "Mask",
    "Recipe",
    "State",
    "Yield",
    "alarm_events",
    "compare_with",
    "failed_tick",
    "judged",
    "limits_of",
    "make_scan",
    "remarks",
    "visit",
]

Mask = npt.NDArray[np.bool_] | None
"""Shape (rows, columns), or none."""

State = Literal["taken", "missed", "rejected", "failed"]
"""How a planned slot ends."""


@dataclass(frozen=True, slots=True, eq=False)
class Recipe:
    """What is done with every capture of a campaign.

    Parameters
    ----------
    patterns : PatternSet
    calibration : Calibration
    grid : Grid
    stable, region : ndarray of bool, shape (rows, columns), or None
        Cells that hold still; cells that count.
    metrics : tuple of str
    alarms : tuple of Alarm
    remove_background : bool
        Remove what stands well apart behind the object.
    keep_frames : bool
    frames_for : timedelta64 or None
        How long frames are kept; None for ever.
    noise : NoiseModel or None
        What levels of detection rest on.
    """

    patterns: PatternSet
    calibration: Calibration
    grid: Grid
    stable: Mask = None
    region: Mask = None
    metrics: tuple[str, ...] = ()
    alarms: tuple[Alarm, ...] = ()
    remove_background: bool = True
    keep_frames: bool = False
    frames_for: np.timedelta64 | None = None
    noise: NoiseModel | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Epoch:
    """What a new scan is compared with: the baseline, and where the alarms stood."""

    baseline: Scan
    alarms: Mapping[str, AlarmState] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Yield:
    """A tick, how its slot ends, and why if it is not simply taken."""

    tick: Tick
    state: State
    cause: str = ""


def make_scan(frames: Frames, recipe: Recipe) -> Scan:
    """Turn one capture into a height map on the campaign's grid.

    Raises
    ------
    CaptureError
        If no cell of the grid was measured.
    ValueError
        If the frames are not of this rig.
    """
    from pipelines.reconstruction import scan_frames

    scan = scan_frames(frames, recipe.calibration, recipe.grid, remove_background=recipe.remove_background)
    if not np.isfinite(scan.height).any():
        raise CaptureError("no cell was measured: is the projector on, and the object in the field of view?")
    return scan


def visit(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """Work one capture out.

    Parameters
    ----------
    frames : Frames
    recipe : Recipe
    epoch : Epoch or None
        None before the first scan. A baseline of another calibration ends its epoch: the scan becomes the baseline
        of the next, and the store records that as an event.
    planned : Instant
        The slot that the capture answers.

    Returns
    -------
    Yield
        ``taken``, or ``rejected`` where the scan cannot be laid onto the baseline: it is kept with its flagged
        change, and gives no metrics.

    Raises
    ------
    CaptureError, ValueError
        If the frames cannot become a height map, or `diagnose` rejects them.
    """
    notes = remarks(frames)
    scan = make_scan(frames, recipe)
    baseline = epoch.baseline if epoch is not None else None
    finding = compare_with(baseline, scan, recipe.stable, recipe.region, recipe.metrics, recipe.noise)
    before = epoch.alarms if epoch is not None else {}
    result = judged(finding, recipe.alarms, before, planned, notes)
    kept = frames if recipe.keep_frames else None
    since = frames.time - recipe.frames_for if recipe.keep_frames and recipe.frames_for is not None else None
    return replace(result, tick=replace(result.tick, calibration=recipe.calibration, frames=kept, frames_since=since))


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one scan says, before the alarms have been judged: its change against the baseline, and its metrics."""

    scan: Scan
    change: Change | None = None
    metrics: Mapping[str, Measurement] = field(default_factory=dict)


def compare_with(
    baseline: Scan | None,
    scan: Scan,
    stable: Mask,
    region: Mask,
    metrics: tuple[str, ...],
    noise: NoiseModel | None = None,
) -> Finding:
    """Compare a scan with its epoch's baseline; one of another calibration, or without a baseline, starts an epoch."""
    if baseline is None or scan.calibration_id != baseline.calibration_id:
        return Finding(scan)
    from pipelines.change import compare, measure

    comparison: Comparison = compare(scan, baseline, stable=stable, region=region, noise=noise)
    failed = comparison.change.motion.verdict == "failed"
    return Finding(scan, comparison.change, {} if failed else measure(comparison, metrics))


def judged(
    finding: Finding,
    alarms: tuple[Alarm, ...],
    before: Mapping[str, AlarmState],
    planned: Instant,
    notes: tuple[Event, ...] = (),
) -> Yield:
    """Judge the alarms of a scan and say what happened; `before` is where they stood."""
    scan, change, metrics = finding.scan, finding.change, finding.metrics
    if change is None:
        fine: dict[str, AlarmState] = {alarm.name: "ok" for alarm in alarms}
        return Yield(Tick(planned, scan, alarms=fine, events=notes), "taken")
    motion = change.motion
    cause = f"registration failed: {motion.reason}" if motion.verdict == "failed" else ""
    states = {alarm.name: judge_alarm(alarm, metrics.get(alarm.metric)) for alarm in alarms}
    events = alarm_events(alarms, states, before, metrics, scan.time)
    if cause:
        events = (Event(scan.time, "rejected", cause), *events)
    elif motion.verdict == "doubtful":
        events = (Event(scan.time, "note", f"registration doubtful: {motion.reason}"), *events)
    tick = Tick(planned, scan, change, metrics, states, (*events, *notes))
    return Yield(tick, "rejected" if cause else "taken", cause)


def remarks(frames: Frames) -> tuple[Event, ...]:
    """Refuse a capture that would give wrong heights; of one that is to be used with care, say why."""
    from pipelines.reconstruction import diagnose

    found = diagnose(frames)
    if found.verdict == "reject":
        raise CaptureError(f"capture rejected: {found.findings[0].line}")
    return tuple(Event(frames.time, "note", f"capture: {finding.line}") for finding in found.findings)


def failed_tick(planned: Instant, at: Instant, kind: Literal["failed", "rejected", "missed"], text: str) -> Tick:
    """Make the tick of a visit that yielded no scan."""
    return Tick(planned, events=(Event(at, kind, text),))


def judge_alarm(alarm: Alarm, measurement: Measurement | None) -> AlarmState:
    """Say where an alarm stands; without a value it is "no data"."""
    from pipelines.trends import judge

    if measurement is None:
        return "no data"
    return judge(measurement.value, measurement.sigma, limits_of(alarm))


def limits_of(alarm: Alarm) -> Limits:
    """Give an alarm's limits. Raises ValueError where they leave no value that is ok."""
    from pipelines.trends import Limits

    return Limits(alarm.warn_above, alarm.alarm_above, alarm.warn_below, alarm.alarm_below)


def alarm_events(
    alarms: tuple[Alarm, ...],
    states: Mapping[str, AlarmState],
    before: Mapping[str, AlarmState],
    metrics: Mapping[str, Measurement],
    time: Instant,
) -> tuple[Event, ...]:
    """One event per alarm that changed its state; a first state other than ok is a change too."""
    events = []
    for alarm in alarms:
        old, new = before.get(alarm.name, "ok"), states[alarm.name]
        if new != old:
            value = metrics.get(alarm.metric)
            told = f", {alarm.metric.replace('_', ' ')} {_with_unit(alarm.metric, value)}" if value is not None else ""
            events.append(Event(time, "alarm", f"{alarm.name}: {old} -> {new}{told}"))
    return tuple(events)


def _with_unit(metric: str, measurement: Measurement) -> str:
    from pipelines.change import METRICS

    return with_uncertainty(measurement, METRICS[metric].unit)
