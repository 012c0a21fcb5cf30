"""Clocks: time is handed in, so that a year of campaign can pass in a minute."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import timedelta
from threading import Event, Lock
from typing import Protocol

import numpy as np

from configs import format_duration
from pipelines import Instant

__all__ = ["AcceleratedClock", "Clock", "RealClock", "SteadyClock", "seconds_between"]

NAP_S = 30.0
"""The real clock looks at the time at least this often: a set clock is noticed, and a wait never overshoots by more."""

STEP_S = 1.0
"""A clock that differs by so much at once was set; what NTP does by and by is less."""

SLEW = 0.02
"""A clock that is ahead of the system's runs slower by this part: an hour is made up for in two days."""


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

    def notices(self) -> tuple[str, ...]:
        """Say what was done to the time since this was last asked."""
        ...


class RealClock:
    """The system's clock, except that it never goes back.

    Where the system's clock is set back, this one goes on evenly ahead of it, a little slower until they agree again:
    a store takes no scan that is older than its newest, and a wait for a time that comes again would stall the
    campaign. Where it is set forward, this one follows at once. Sleep of the machine is time that passed.

    Parameters
    ----------
    wall, even : callable
        The system's clock, and one that nobody can set, s; other ones in tests.
    not_before : Instant, optional
        The newest time that is known: after a start with a clock that is behind it, go on from there.
    nap : callable
        Called at least every `NAP_S` of a wait: the program is alive (watchdog).
    """

    def __init__(
        self,
        wall: Callable[[], float] = time.time,
        even: Callable[[], float] | None = None,
        not_before: Instant | None = None,
        nap: Callable[[], None] = lambda: None,
    ) -> None:
        self._wall = wall
        self._even = even if even is not None else _even_seconds
        self._nap = nap
        self._lock = Lock()
        self._ahead = 0.0
        self._last_wall, self._last_even = self._wall(), self._even()
        self._told: list[str] = []
        if not_before is not None:
            self.go_on_from(not_before)

    def go_on_from(self, moment: Instant) -> None:
        """Be at `moment` or later, whatever the system's clock says."""
        behind = seconds_between(self.now(), moment)
        if behind > 0:
            self._ahead += behind
            self._told.append(
                f"the system's clock is {_length(behind)} behind the newest scan: time goes on from there"
            )

    def now(self) -> Instant:
        """Tell the time, UTC. Other threads may ask too."""
        with self._lock:
            return self._now()

    def _now(self) -> Instant:
        wall, even = self._wall(), self._even()
        passed = even - self._last_even
        step = (wall - self._last_wall) - passed
        self._last_wall, self._last_even = wall, even
        self._ahead = max(0.0, self._ahead - SLEW * passed)
        if abs(step) >= STEP_S:
            way = "forward" if step > 0 else "back"
            self._told.append(f"the system's clock was set {way} by {_length(abs(step))}")
        self._ahead = max(0.0, self._ahead - step)  # set back: so much further ahead; forward: less
        moment: Instant = np.datetime64(round((wall + self._ahead) * 1e6), "us").astype("datetime64[ns]")
        return moment

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Return at `moment`, or as soon as `stop` is set."""
        while (left := seconds_between(self.now(), moment)) > 0:
            self._nap()
            if stop.wait(min(left, NAP_S)):
                return

    def steady(self) -> SteadyClock:
        """Give a clock that starts at this one's time and then follows the monotonic one."""
        return SteadyClock(self.now(), self._nap)

    def notices(self) -> tuple[str, ...]:
        """Say what was done to the time since this was last asked."""
        told, self._told = tuple(self._told), []
        return told


def _even_seconds() -> float:
    """Seconds that nobody can set and that go on while the machine sleeps, where the system has such a clock."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


def _length(seconds: float) -> str:
    return format_duration(timedelta(seconds=round(seconds)))


class SteadyClock:
    """Starts at a given time and follows the monotonic clock: for rates at which a step of the system's clock shows."""

    def __init__(self, start: Instant, nap: Callable[[], None] = lambda: None) -> None:
        self._start = start
        self._nap = nap
        self._origin = time.monotonic_ns()

    def now(self) -> Instant:
        """Tell the time, UTC."""
        return self._start + np.timedelta64(time.monotonic_ns() - self._origin, "ns")

    def wait_until(self, moment: Instant, stop: Event) -> None:
        """Return at `moment`, or as soon as `stop` is set."""
        self._nap()
        while (left := seconds_between(self.now(), moment)) > 0:
            if stop.wait(min(left, NAP_S)):
                return
            self._nap()

    def steady(self) -> SteadyClock:
        """Give itself."""
        return self

    def notices(self) -> tuple[str, ...]:
        """Nothing can be done to it."""
        return ()


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

    def notices(self) -> tuple[str, ...]:
        """Nothing can be done to it."""
        return ()


def seconds_between(first: Instant, last: Instant) -> float:
    """Seconds from `first` to `last`."""
    return float((last - first) / np.timedelta64(1, "ns")) * 1e-9
