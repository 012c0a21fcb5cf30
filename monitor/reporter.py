"""Reporter: a report when a day or week is over or an alarm goes off, written by a process beside the visits."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from typing import Any, Protocol
from zoneinfo import ZoneInfo

import structlog

from configs import Campaign, Reports
from pipelines import Instant, alarm_changes, as_datetime
from storage import Store

from .settled import Settled

__all__ = ["Reporter", "reporter_of"]

_log = structlog.get_logger("microrelief.reporter")

_WRITTEN = (0, 3)
"""Exit codes of `microrelief report` that come with a report; 3 says that an alarm stands."""
_PATIENCE_S = 600.0
ON_ALARM = "%Y-%m-%dT%H%MZ-alarm"
"""Name of a report on alarms, by its slot, UTC."""


class Writing(Protocol):
    """A process that writes a report, as `subprocess.Popen` is one."""

    returncode: Any

    def poll(self) -> int | None:
        """Give its exit code, None while it runs."""
        ...

    def communicate(self, input: None = None, timeout: float | None = None) -> tuple[Any, Any]:  # noqa: A002 - Popen's
        """Wait for its end; give what it said on stdout and stderr."""
        ...


def _start(words: Sequence[str]) -> Writing:
    politely = ["nice", "-n", "10"] if shutil.which("nice") else []  # a report can wait, a visit cannot
    return subprocess.Popen(
        [*politely, sys.executable, "-m", "monitor.cli", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


@dataclass(slots=True)
class Reporter:
    """Told of every settled slot, it sees when a report is due; reports are written one after another.

    Which were written is told by their folders, so a restart writes none again and none twice.

    Parameters
    ----------
    settings : Reports
    store : str
        Where the store lies.
    zone : ZoneInfo
        The site's, in which days and weeks end.
    last : Instant or None
        The newest scan's time when the run began; None in an empty store.
    start : callable
        Starts ``microrelief`` with these words.
    reported : datetime or None
        Slot of the newest report on alarms.
    """

    settings: Reports
    store: str
    zone: ZoneInfo
    last: Instant | None = None
    start: Callable[[Sequence[str]], Writing] = _start
    reported: datetime | None = None
    _due: deque[tuple[str, list[str]]] = field(default_factory=deque)
    _alarmed: Instant | None = None
    _running: tuple[str, Writing] | None = None

    def settled(self, settled: Settled) -> Sequence[str]:
        """See whether a report is due, and begin it where none is being written."""
        notes = self._go_on()
        tick = settled.tick
        if self.settings.every is not None and self.last is not None:
            before, now = (self._stretch(moment) for moment in (self.last, settled.planned))
            if before != now:
                end = datetime.combine(self._begin(self.last) + self._length(), time(), self.zone)
                self._ask(before, end - timedelta(microseconds=1))
        alarms = alarm_changes(tick.events) if tick is not None else ()
        if self.settings.on_alarm and any(change.after in ("alarm", "no data") for change in alarms):
            self._alarmed = settled.planned
        if self._alarmed is not None and self._rested(settled.planned):
            self._ask_for_alarms(settled.planned)
        if settled.number is not None or (self.last is not None and self.settings.every is not None):
            self.last = settled.planned
        return [*notes, *self._go_on()]

    def close(self) -> None:
        """Let the reports that are due be finished; alarms that waited for one have it now."""
        if self._alarmed is not None:
            self._ask_for_alarms(self._alarmed)
        while self._running is not None or self._due:
            if self._running is not None:
                self._running[1].communicate(timeout=_PATIENCE_S)
            for note in self._go_on():
                _log.info(note)

    def _rested(self, now: Instant) -> bool:
        """Whether the newest report on alarms is old enough: an alarm that flaps would else have one for each flap."""
        return self.reported is None or as_datetime(now) - self.reported >= self.settings.alarm_rest

    def _ask_for_alarms(self, at: Instant) -> None:
        self._alarmed, self.reported = None, as_datetime(at)
        self._ask(f"{self.reported:{ON_ALARM}}", None)

    def _ask(self, name: str, end: datetime | None) -> None:
        folder = self.settings.out / name
        if (folder / "report.html").exists() or any(name == known for known, _ in self._due):
            return
        words = ["report", self.store, "--out", str(folder)]
        if end is not None:
            words += ["--to", end.isoformat()]
        if self.settings.covers is not None and self.last is not None:
            words += ["--from", ((end or as_datetime(self.last)) - self.settings.covers).isoformat()]
        words += ["--pdf"] if self.settings.pdf else []
        words += ["--templates", str(self.settings.templates)] if self.settings.templates is not None else []
        self._due.append((name, words))

    def _go_on(self) -> list[str]:
        """Say what has been written, and begin the next."""
        notes = []
        if self._running is not None and self._running[1].poll() is not None:
            name, writing = self._running
            self._running = None
            if writing.returncode in _WRITTEN:
                notes.append(f"report written: {self.settings.out / name}")
            else:
                lines = writing.communicate(timeout=1.0)[1].strip().splitlines()
                why = lines[-1].removeprefix("microrelief: ") if lines else f"exit code {writing.returncode}"
                notes.append(f"report {name} not written: {why}")
        if self._running is None and self._due:
            name, words = self._due.popleft()
            self._running = (name, self.start(words))
        return notes

    def _begin(self, moment: Instant) -> date:
        """Day on which the day or week of an instant began, in the site's zone."""
        day = as_datetime(moment).astimezone(self.zone).date()
        return day - timedelta(days=day.weekday()) if self.settings.every == "week" else day

    def _length(self) -> timedelta:
        return timedelta(days=7 if self.settings.every == "week" else 1)

    def _stretch(self, moment: Instant) -> str:
        begin = self._begin(moment)
        return f"{begin:%G-W%V}" if self.settings.every == "week" else f"{begin:%Y-%m-%d}"


def reporter_of(campaign: Campaign, store: Store) -> Reporter | None:
    """Give a campaign's reporter; None where it asks for none."""
    if campaign.report is None:
        return None
    last = store[-1].scan.time if len(store) else None
    where, zone = str(campaign.store.path), ZoneInfo(campaign.site.zone)
    return Reporter(campaign.report, where, zone, last, reported=_newest_on_alarm(campaign.report.out))


def _newest_on_alarm(out: Path) -> datetime | None:
    """Slot of the newest report on alarms in a folder, by the reports' names."""
    found = []
    for report in out.glob("*-alarm/report.html"):
        with suppress(ValueError):  # somebody's own folder
            found.append(datetime.strptime(report.parent.name, ON_ALARM).replace(tzinfo=UTC))
    return max(found, default=None)
