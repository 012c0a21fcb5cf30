"""What a running campaign says: a plain line for each slot, and on a terminal what it waits for or how it keeps up."""

from __future__ import annotations

import statistics
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.status import Status

from configs import Campaign
from pipelines import Instant, format_instant

from .items import Visit
from .pulse import PulseMeter
from .settled import Outcome, Settled

__all__ = ["Teller"]


class Teller:
    """Says what happens, one line each, flushed: whoever reads a pipe knows of a scan as soon as it is durable.

    Of a video it says how late each scan began and was worked out; on a terminal one line stands for all scans that
    were simply taken. Several threads may tell it.

    Parameters
    ----------
    campaign : Campaign
    """

    def __init__(self, campaign: Campaign) -> None:
        video = campaign.schedule.video
        self._until = campaign.until
        self._pulse = PulseMeter(video.most_under_way) if video is not None else None
        self._console = Console(highlight=False, soft_wrap=True)
        self._waited = False
        self._status: Status | None = None

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._status = self._console.status("starting", refresh_per_second=4)
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def say(self, line: str) -> None:
        """Say one line."""
        self._console.print(line, markup=False)
        self._console.file.flush()

    def stage(self, what: str) -> None:
        """Say what is being done before the first visit."""
        if self._status is not None:
            self._status.update(what)
        else:
            self.say(what)

    def wait(self, slot: Instant) -> None:
        """Say what is being waited for: always on a terminal, elsewhere the first only."""
        line = f"next scan {format_instant(slot)}"
        if self._status is not None:
            if self._pulse is None or not self._waited:
                self._status.update(line)
        elif not self._waited:
            self.say(line)
        self._waited = True

    def worked(self, visit: Visit, under_way: int) -> None:
        """Show on a terminal how a video keeps up, now that a visit is worked out."""
        pulse = self._pulse.worked(visit, under_way) if self._pulse is not None else None
        if self._status is not None and pulse is not None:
            self._status.update(pulse.line)

    def settled(self, settled: Settled) -> None:
        """Say how a slot ended."""
        if self._pulse is not None:
            self._pulse.settled(settled)
        if settled.number is not None and settled.tick is not None and settled.tick.scan is not None:
            line = f"committed scan {settled.number} {format_instant(settled.tick.scan.time)}"
            if self._pulse is not None:
                late = f"lag {settled.lag_s:.3f} s worked out {settled.latency_s:.3f} s took {settled.took_s:.3f} s"
                line = f"{line} {late}"
            if settled.state == "rejected":
                line += f" rejected: {settled.cause}"
            if self._pulse is None or self._status is None or settled.state != "taken":
                self.say(line)
            if settled.number and settled.tick.change is None:
                self.say(
                    f"scan {settled.number} begins a new epoch: later ones are compared with it, not with those before"
                )
        elif settled.count > 1:
            self.say(settled.told)
        else:
            self.say(f"{settled.state} {format_instant(settled.planned)}: {settled.cause}")
        for event in settled.tick.events if settled.tick is not None else ():
            if event.kind in ("alarm", "note"):
                self.say(f"{event.kind} {format_instant(event.time)}: {event.text}")

    def summary(self, outcome: Outcome) -> None:
        """Say what the run came to."""
        parts = [f"{outcome.taken} taken"]
        if self._pulse is not None:
            parts.append(f"{outcome.missed} dropped")
        elif outcome.missed:
            parts.append(f"{outcome.missed} missed")
        parts += [f"{count} {state}" for state in ("rejected", "failed") if (count := getattr(outcome, state))]
        for name, values in (("lag", outcome.lags_s), ("worked out after", outcome.latencies_s)):
            if self._pulse is not None and values:
                parts.append(f"{name} p50 {statistics.median(values):.3f} s max {max(values):.3f} s")
        over = ""
        if not (outcome.stopped or outcome.visits) and self._until is not None:
            over = f"; the schedule ends at {self._until:%Y-%m-%d %H:%M} (schedule.until)"
        self.say(("stopped: " if outcome.stopped else "done: ") + ", ".join(parts) + over)
