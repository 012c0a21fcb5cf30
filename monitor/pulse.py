"""Pulse: how a video keeps up, from scan to scan: its rate, how late it is, how much is under way, what was dropped."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from pipelines import Instant

from .clock import seconds_between
from .items import Visit
from .settled import Settled

__all__ = ["Pulse", "PulseMeter"]

LAST = 10
"""Scans that the rate is told over."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """How it keeps up when a scan has been worked out.

    Parameters
    ----------
    scans, dropped : int
        Worked out, and slots missed, since the recording began.
    rate_hz : float
        Over the last ten scans, by when they were worked out; NaN at first.
    lag_s : float
        How late the newest scan began.
    latency_s : float
        How old it was when it had been worked out.
    under_way, most : int
        Scans captured and not yet stored, and how many there may be.
    """

    scans: int
    dropped: int
    rate_hz: float
    lag_s: float
    latency_s: float
    under_way: int
    most: int

    @property
    def line(self) -> str:
        """In one line."""
        rate = f"{self.rate_hz:.2f} Hz" if self.rate_hz == self.rate_hz else "- Hz"
        return (
            f"{self.scans} scans, {rate}, began {self.lag_s:.3f} s late, worked out after {self.latency_s:.2f} s, "
            f"{self.under_way} of {self.most} under way, {self.dropped} dropped"
        )


@dataclass(slots=True)
class PulseMeter:
    """Feels the pulse: told of each slot that is settled and each visit that is worked out, by different threads."""

    most: int
    _scans: int = 0
    _dropped: int = 0
    _ends: deque[Instant] = field(default_factory=lambda: deque(maxlen=LAST))

    def settled(self, settled: Settled) -> None:
        """Count what was dropped."""
        self._dropped += settled.dropped

    def worked(self, visit: Visit, under_way: int) -> Pulse | None:
        """Take a visit into account; None where it gave no scan."""
        if visit.worked_out is None:
            return None
        self._scans += 1
        self._ends.append(visit.worked_out)
        lasted = seconds_between(self._ends[0], self._ends[-1])
        rate = (len(self._ends) - 1) / lasted if lasted > 0 else float("nan")
        lag = seconds_between(visit.planned, visit.began)
        return Pulse(self._scans, self._dropped, rate, lag, visit.latency_s, under_way, self.most)
