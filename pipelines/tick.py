"""Tick: what one visit to the site yielded, or why it failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .change import Change, Measurement, NoiseModel
from .instant import Instant, check_instant
from .reconstruction import Calibration, Frames
from .scan import Scan
from .trends import AlarmState

__all__ = ["Event", "Tick"]


@dataclass(frozen=True, slots=True)
class Event:
    """Something that people should know about a campaign, at a time.

    `kind` is one of ``failed``, ``missed``, ``rejected``, ``lost`` (scans that were kept are gone), ``alarm``,
    ``acknowledged``, ``annotation`` (a person's remark), ``epoch``, ``note``.
    """

    time: Instant
    kind: str
    text: str

    def __post_init__(self) -> None:
        check_instant(self.time, "event time")


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """One visit: a scan with its change, metrics and alarms; or none of them, and the events that say why.

    Parameters
    ----------
    planned : Instant
        The slot of the schedule that this visit answers.
    scan, change : Scan, Change or None
        None where the visit failed. `change` is None too for the first scan of an epoch.
    metrics : mapping of str to Measurement
        By metric name; empty where there is no scan.
    alarms : mapping of str to AlarmState
        State of each alarm of the campaign after this visit, by alarm name.
    events : tuple of Event
        Failures, alarms that changed state, remarks.
    calibration : Calibration or None
        What placed the scan; the store keeps each one once, by id.
    frames : Frames or None
        Raw frames to keep, where the campaign retains them.
    frames_since : Instant or None
        Raw frames that were taken before are let go with this tick.
    noise : NoiseModel or None
        What levels of detection rest on from now on; the store keeps the newest.
    """

    planned: Instant
    scan: Scan | None = None
    change: Change | None = None
    metrics: Mapping[str, Measurement] = field(default_factory=dict)
    alarms: Mapping[str, AlarmState] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    calibration: Calibration | None = None
    frames: Frames | None = None
    frames_since: Instant | None = None
    noise: NoiseModel | None = None

    def __post_init__(self) -> None:
        check_instant(self.planned, "planned time")
        if self.scan is None and (self.change is not None or self.metrics):
            raise ValueError("a tick without a scan has neither change nor metrics")
        if self.change is not None and self.scan is not None and self.change.grid != self.scan.grid:
            raise ValueError("a tick's change and scan lie on different grids")
