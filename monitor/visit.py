"""One visit: frames to a tick. Arrays in, values out; the loop around it has the clock, the rig and the store."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from configs import Alarm, CaptureError, Environment
from pipelines import (
    Calibration,
    Change,
    Comparison,
    Event,
    Frames,
    Grid,
    Instant,
    Measurement,
    Motion,
    PatternSet,
    Scan,
    Tick,
)

from .alarms import Seen, Watches, after_scan, states_of, told

if TYPE_CHECKING:
    from pipelines.change import NoiseModel

__all__ = [
    "Capture",
    "Epoch",
    "Finding",
    "Mask",
    "Measured",
    "Recipe",
    "Rules",
    "State",
    "Work",
    "Yield",
    "compare_with",
    "compared",
    "failed_tick",
    "judged",
    "make_scan",
    "remarks",
    "visit",
]

Mask = npt.NDArray[np.bool_] | None
"""Shape (rows, columns), or none."""

NO_AIR: Mapping[str, Measurement] = MappingProxyType({})
"""Nothing was read beside the scan."""

State = Literal["taken", "missed", "rejected", "failed"]
"""How a planned slot ends."""

Between = TypeVar("Between")
"""What the first step of the work gives to the second."""


@dataclass(frozen=True, slots=True, eq=False)
class Rules:
    """What is done with every scan, however it came about.

    Parameters
    ----------
    grid : Grid
    stable, region : ndarray of bool, shape (rows, columns), or None
        Cells that hold still; cells that count.
    metrics : tuple of str
    alarms : tuple of Alarm
    remove_background : bool
        Remove what stands well apart behind the object.
    local_integration : bool
        Read pixels too faint by themselves from sums over a window.
    noise : NoiseModel or None
        What levels of detection rest on.
    environment : Environment or None
        What is read beside the scans: control charts take its effect out.
    settings : str
        Hash of the settings that say so; `process` tells by it what it did already.
    """

    grid: Grid
    stable: Mask = None
    region: Mask = None
    metrics: tuple[str, ...] = ()
    alarms: tuple[Alarm, ...] = ()
    remove_background: bool = True
    local_integration: bool = False
    noise: NoiseModel | None = None
    environment: Environment | None = None
    settings: str = ""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recipe(Rules):
    """What is done with every capture of a campaign.

    Parameters
    ----------
    patterns : PatternSet
    calibration : Calibration
    keep_frames : bool
    frames_for : timedelta64 or None
        How long frames are kept; None for ever.
    follow : bool
        Register from where the scan before lay, as in a video.
    """

    patterns: PatternSet
    calibration: Calibration
    keep_frames: bool = False
    frames_for: np.timedelta64 | None = None
    follow: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Epoch:
    """What a new scan is judged by: the baseline, what the alarms remember since, and the environment at the scan.

    `near` is the motion of the scan before, onto the same baseline.
    """

    baseline: Scan
    watches: Watches = field(default_factory=dict)
    air: Mapping[str, Measurement] = field(default_factory=dict)
    near: Motion | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Yield:
    """A tick, how its slot ends, and why if it is not simply taken; and what the alarms remember after it."""

    tick: Tick
    state: State
    cause: str = ""
    watches: Watches = field(default_factory=dict)


def make_scan(frames: Frames, calibration: Calibration, rules: Rules) -> Scan:
    """Turn one capture into a height map on the campaign's grid.

    Raises
    ------
    CaptureError
        If no cell of the grid was measured.
    ValueError
        If the frames are not of this rig.
    """
    from pipelines.reconstruction import scan_frames

    scan = scan_frames(
        frames,
        calibration,
        rules.grid,
        remove_background=rules.remove_background,
        local_integration=rules.local_integration,
    )
    if not np.isfinite(scan.height).any():
        raise CaptureError("no cell was measured: is the projector on, and the object in the field of view?")
    return scan


class Capture(Protocol):
    """What a visit captured: frames, or whatever else the work that goes with it takes."""

    @property
    def time(self) -> Instant:
        """When it was begun."""
        ...


@dataclass(frozen=True, slots=True)
class Work(Generic[Between]):
    """How a capture becomes a tick: two steps, which a video does side by side, each on another capture.

    Parameters
    ----------
    reconstruct : callable
        From the capture to what was measured. Nobody holds its frames after it, unless the recipe keeps them.
    compare : callable
        From there to a yield, against the epoch (None before the first scan); last comes the slot that is answered.

    Raises
    ------
    CaptureError, ValueError
        Each, if the capture cannot be used.
    """

    reconstruct: Callable[[Any, Recipe], Between]
    compare: Callable[[Between, Recipe, Epoch | None, Instant], Yield]

    def __call__(self, capture: Any, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
        """Do both."""
        return self.compare(self.reconstruct(capture, recipe), recipe, epoch, planned)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What a capture gave: its scan, what there is to say of it, and its frames where they are kept."""

    scan: Scan
    notes: tuple[Event, ...] = ()
    frames: Frames | None = None


def measured(frames: Frames, recipe: Recipe) -> Measured:
    """Work a capture out up to its height map.

    Raises
    ------
    CaptureError, ValueError
        If the frames cannot become a height map, or `diagnose` rejects them.
    """
    notes = remarks(frames)
    return Measured(make_scan(frames, recipe.calibration, recipe), notes, frames if recipe.keep_frames else None)


def compared(capture: Measured, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """Compare with the baseline, measure and judge.

    A baseline of another calibration ends its epoch: the scan becomes the baseline of the next, and the store records
    that as an event.

    Returns
    -------
    Yield
        ``taken``, or ``rejected`` where the scan cannot be laid onto the baseline: it is kept with its flagged
        change, and gives no metrics.
    """
    baseline = epoch.baseline if epoch is not None else None
    # the first scan after its baseline begins where that lay: whether it holds is proven, or all is searched
    near = (epoch.near or Motion.none()) if epoch is not None and recipe.follow else None
    finding = compare_with(baseline, capture.scan, recipe, near)
    before, air = (epoch.watches, epoch.air) if epoch is not None else ({}, {})
    result = judged(finding, recipe, before, planned, capture.notes, air=air)
    kept, since = capture.frames, None
    if kept is not None and recipe.frames_for is not None:
        since = kept.time - recipe.frames_for
    return replace(result, tick=replace(result.tick, calibration=recipe.calibration, frames=kept, frames_since=since))


visit = Work(measured, compared)
"""What every campaign does with its captures."""


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one scan says, before the alarms have been judged: its change against the baseline, and its metrics."""

    scan: Scan
    change: Change | None = None
    metrics: Mapping[str, Measurement] = field(default_factory=dict)


def compare_with(baseline: Scan | None, scan: Scan, rules: Rules, near: Motion | None = None) -> Finding:
    """Compare a scan with its epoch's baseline; one of another calibration, or without a baseline, starts an epoch.

    `near` is the motion of a scan shortly before, onto the same baseline, from where this one is followed.
    """
    if baseline is None or scan.calibration_id != baseline.calibration_id:
        return Finding(scan)
    from pipelines.change import compare, measure

    comparison: Comparison = compare(scan, baseline, rules.stable, rules.region, rules.noise, near)
    failed = comparison.change.motion.verdict == "failed"
    return Finding(scan, comparison.change, {} if failed else measure(comparison, rules.metrics))


def judged(
    finding: Finding,
    rules: Rules,
    before: Watches,
    planned: Instant,
    notes: tuple[Event, ...] = (),
    *,
    air: Mapping[str, Measurement] = NO_AIR,
) -> Yield:
    """Judge the alarms of a scan and say what happened; `before` is what they remember, `air` what was read beside."""
    scan, change, metrics, alarms = finding.scan, finding.change, finding.metrics, rules.alarms
    motion = change.motion if change is not None else None
    verdict, reason = (motion.verdict, motion.reason) if motion is not None else ("", "")
    seen = Seen(scan.time, verdict, {**metrics, **air}, reason)
    watches = after_scan(alarms, before, seen, rules.environment)
    events = tuple(each.event for each in told(alarms, before, watches, scan.time, seen))
    cause = f"registration failed: {reason}" if verdict == "failed" else ""
    if cause:
        events = (Event(scan.time, "rejected", cause), *events)
    elif verdict == "doubtful":
        held = "; no alarm is judged by it" if alarms else ""
        events = (Event(scan.time, "note", f"registration doubtful: {reason}{held}"), *events)
    elif reason:
        events = (Event(scan.time, "note", reason), *events)
    states = states_of(alarms, watches)
    tick = Tick(planned, scan, change, metrics, states, (*events, *notes))
    return Yield(tick, "rejected" if cause else "taken", cause, watches)


def remarks(frames: Frames) -> tuple[Event, ...]:
    """Refuse a capture that would give wrong heights; of one that is to be used with care, say why."""
    from pipelines.reconstruction import diagnose

    found = diagnose(frames)
    if found.verdict == "reject":
        raise CaptureError(f"capture rejected: {found.findings[0].line}")
    lines = (*frames.remarks, *(finding.line for finding in found.findings))
    return tuple(Event(frames.time, "note", f"capture: {line}") for line in lines)


def failed_tick(planned: Instant, at: Instant, kind: Literal["failed", "rejected", "missed"], text: str) -> Tick:
    """Make the tick of a visit that yielded no scan."""
    return Tick(planned, events=(Event(at, kind, text),))
