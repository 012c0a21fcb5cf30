"""Clocks: time is handed in, so that a year of campaign can pass in a minute."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from threading import Event
from typing import Protocol

import numpy as np

from pipelines import Instant, instant

__all__ = ["AcceleratedClock", "Clock", "RealClock", "SteadyClock", "seconds_between"]

NAP_S = 30.0
"""The real clock looks at the time at least this often: a set clock is noticed, and a wait never overshoots by more."""


class Clock(Protocol):
    """Tells the time and waits for one."""

    def now(self) -> Instant:
        """Tell the time, UTC."""
        ...

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Return at `moment`, or as soon as `stop` is set; at once if it has passed."""
        ...

    def steady(self) -> Clock:
        """Give a clock that runs evenly from now on, whatever is done to the system's clock."""
        ...


class RealClock:
    """The system's clock."""

    def now(self) -> Instant:
        """Tell the time, UTC."""
        return instant(datetime.now(UTC))

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Return at `moment`, or as soon as `stop` is set."""
        while (left := seconds_between(self.now(), moment)) > 0:
            if stop.wait(min(left, NAP_S)):
                return

    def steady(self) -> SteadyClock:
        """Give a clock that starts at this one's time and then follows the monotonic one."""
        return SteadyClock(self.now())


class SteadyClock:
    """Starts at a given time and follows the monotonic clock: for rates at which a step of the system's clock shows."""

    def __init__(self, start: Instant) -> None:
        self._start = start
        self._origin = time.monotonic_ns()

    def now(self) -> Instant:
        """Tell the time, UTC."""
        return self._start + np.timedelta64(time.monotonic_ns() - self._origin, "ns")

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Return at `moment`, or as soon as `stop` is set."""
        while (left := seconds_between(self.now(), moment)) > 0:
            if stop.wait(left):
                return

    def steady(self) -> SteadyClock:
        """Give itself."""
        return self


class AcceleratedClock:
    """Jumps to whatever it is asked to wait for. Work takes no time on it unless `advance` says so."""

    def __init__(self, start: Instant) -> None:
        self._now = start

    def now(self) -> Instant:
        """Tell the pretended time."""
        return self._now

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Be at `moment` at once, unless `stop` is set; never goes back."""
        if not stop.is_set():
            self._now = max(self._now, moment)

    def advance(self, seconds: float) -> None:
        """Let time pass, as work would."""
        self._now = self._now + np.timedelta64(round(seconds * 1e9), "ns")

    def steady(self) -> AcceleratedClock:
        """Give itself."""
        return self


def seconds_between(first: Instant, last: Instant) -> float:
    """Seconds from `first` to `last`."""
    return float((last - first) / np.timedelta64(1, "ns")) * 1e-9
