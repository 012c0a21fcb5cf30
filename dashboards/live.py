"""Live: sends each new scan to an open viewer, on a thread of its own; who hands a scan over never waits."""

from __future__ import annotations

import importlib
import os
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType

import numpy as np
import pandas as pd

from pipelines import Instant, Tick
from storage import About, Store, Stored, scan_table

from . import paths
from .blueprint import Layout, Preset, review_blueprint
from .campaign_text import settings_of
from .draw_cracks import log_sights
from .draw_frame import log_frame
from .draw_history import (
    log_acknowledgements,
    log_alarm,
    log_alarm_looks,
    log_event,
    log_history,
    log_lanes,
    log_state,
    log_trend_looks,
    log_visit,
)
from .draw_scan import log_baseline, log_scan, set_times
from .followed import Followed, follow, looks_for
from .metric_names import trend_groups
from .palette import VISIT_COLOURS
from .places import places_of
from .record import layout_of
from .scales import choose_scales, sample, still_fit
from .visits import Visit

__all__ = ["LiveReview"]

WAITING = 4
"""Scans that may wait for the viewer; beyond, the oldest of them is left out."""

RECENT = np.timedelta64(3600, "s")
RECENT_SCANS = 60
"""What is shown first when a review attaches late: the last hour, so many scans of it, spread evenly."""

FOLLOWED_EVERY_S = 10.0
"""Cracks take longer to follow than a scan to draw: they are shown where scans come no faster than this."""


_PATIENCE_S = 60.0
"""How long the end of a review waits for what is still being drawn."""


def _quiet_rerun() -> ModuleType:
    """Import rerun so that it does not print that a window was closed before all was sent; `trouble` tells the rest.

    It reads what to print from the environment, once, by its import, and nowhere else; whoever imported it before has
    chosen. The environment is left as it was.
    """
    before = os.environ.get("RUST_LOG")
    os.environ["RUST_LOG"] = before or "error,re_grpc_client=off,re_sdk=off"
    try:
        return importlib.import_module("rerun")
    finally:
        if before is None:
            del os.environ["RUST_LOG"]


class LiveReview:
    """The review of a campaign or video while it goes on.

    `show` takes each scan as it was committed. Drawing and sending go on elsewhere; where that cannot keep up, scans
    are left out, and counted, as is one that cannot be drawn. Nothing that fails here reaches who calls it.

    Parameters
    ----------
    address : str
        Where a viewer listens: ``rerun+http://127.0.0.1:PORT/proxy``.
    about : About
        Of the store that is written.
    preset : str
        What is in front.
    interval_s : float
        Time between scans.
    """

    def __init__(self, address: str, about: About, *, preset: Preset = "overview", interval_s: float = 1.0) -> None:
        rr = _quiet_rerun()
        self._about, self._preset, self._interval_s = about, preset, interval_s
        self._places = places_of(settings_of(about.campaign))
        self._layout: Layout | None = None
        self._baseline: Stored | None = None
        self._followed = Followed()
        self._alarms: dict[str, str] = {}
        self._left_out = 0
        self.trouble = ""
        """What went wrong with the last scan that could not be shown."""
        self._waiting: deque[tuple[Tick, int]] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._busy = False
        self._stream = rr.RecordingStream(paths.APPLICATION, recording_id=f"{about.site or paths.APPLICATION}-live")
        self._stream.disable_timeline("log_time")
        self._stream.connect_grpc(address)
        self._thread = threading.Thread(target=self._work, name="live review", daemon=True)
        self._thread.start()

    @property
    def left_out(self) -> int:
        """Scans that were not shown because others came too fast."""
        return self._left_out

    def attach(self, store: Store) -> int:
        """Show what is there already: all trends, the newest scan, then the last hour backwards; give how many scans.

        For the start, before the first `show`; this one does wait.
        """
        total = len(store)
        if not total:
            return 0
        newest = store[total - 1]
        self._arrange(layout_of(store, choose_scales(sample(store))))
        assert self._layout is not None
        log_history(self._stream, store, self._layout.trends)
        self._alarms = {name: str(state) for name, state in newest.alarms.items()}
        self._baseline = store[newest.baseline]
        first = self._baseline.scan.time
        log_baseline(self._stream, self._baseline, self._layout.scales, first, newest.baseline)
        times = scan_table(store).times
        recent = np.flatnonzero(times >= times[-1] - RECENT)[::-1]
        for number in recent[:: -(-len(recent) // RECENT_SCANS)]:
            log_scan(self._stream, store[int(number)], self._layout.scales, self._about)
        self._follow(newest)
        self._stream.flush()
        return total

    def show(self, tick: Tick, number: int) -> None:
        """Hand over one visit that was committed; `number` is that of its scan, or of the newest where it has none."""
        with self._changed:
            if len(self._waiting) == WAITING:
                self._waiting.popleft()
                self._left_out += 1
            self._waiting.append((tick, number))
            self._changed.notify_all()

    def wait_until_shown(self) -> None:
        """Return when all that was handed over has been sent."""
        with self._changed:
            self._changed.wait_for(lambda: (not self._waiting and not self._busy) or not self._thread.is_alive())

    def close(self) -> None:
        """Send what still waits, and let go of the viewer."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout=_PATIENCE_S)
        self._stream.disconnect()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                tick, number = self._waiting.popleft()
                self._busy = True
            try:
                self._send(tick, number)
            except Exception as error:  # noqa: BLE001 - a picture that fails must not end a measurement
                self.trouble = f"scan {number}: {type(error).__name__}: {error}"
                self._left_out += 1
            finally:
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()

    def _send(self, tick: Tick, number: int) -> None:
        ends = [event.kind for event in tick.events if event.kind in VISIT_COLOURS]
        state = "taken" if tick.scan is not None else next(iter(ends), "" if tick.events else "failed")
        if tick.scan is not None:
            epoch = 0 if self._baseline is None else self._baseline.epoch
            baseline = number if tick.change is None or self._baseline is None else self._baseline.number
            stored = Stored(number, epoch, baseline, tick.planned, tick.scan, tick.change, dict(tick.alarms))
            if tick.change is None:
                self._baseline = replace(stored, epoch=epoch + (self._baseline is not None))
            if self._layout is None or not still_fit(self._layout.scales, stored):
                self._rescale(stored, tick)
            assert self._layout is not None
            log_scan(self._stream, stored, self._layout.scales, self._about)
            self._follow(stored)
            self._log_metrics(tick, number)
            if tick.change is not None:
                log_state(self._stream, paths.REGISTRATION, tick.change.motion.verdict, tick.scan.time, number)
            self._log_alarms(tick.alarms, tick.scan.time, number)
        if state:  # a remark is no visit
            log_visit(self._stream, Visit(tick.planned, state), number)
        for event in tick.events:
            log_event(self._stream, event, number)
        log_acknowledgements(self._stream, tick.events, lambda moment: number)
        self._stream.flush()

    def _rescale(self, newest: Stored, tick: Tick) -> None:
        """Choose scales by the baseline and the newest scan, the trends by what it measured."""
        chosen = [newest] if self._baseline is None else [self._baseline, newest]
        scales = choose_scales(chosen)
        if self._layout is None:
            cracks, plates = looks_for(self._about.metrics)
            layout = Layout(scales, self._interval_s, (), frozenset(), cracks, plates)
        else:
            layout = replace(self._layout, scales=scales)
        if tick.metrics:
            table = pd.DataFrame({name: [measured.value] for name, measured in tick.metrics.items()})
            layout = replace(layout, trends=layout.trends or trend_groups(table, self._about.metrics))
        self._arrange(layout)
        if self._baseline is not None and self._layout is not None:
            first = self._baseline
            log_baseline(self._stream, first, self._layout.scales, first.scan.time, first.number)

    def _arrange(self, layout: Layout) -> None:
        if self._interval_s < FOLLOWED_EVERY_S:
            layout = replace(layout, cracks=False, plates=False)
        self._layout = layout
        self._stream.send_blueprint(review_blueprint(layout, self._preset))
        log_frame(self._stream, layout.scales, self._places)
        log_lanes(self._stream)
        log_trend_looks(self._stream, layout.trends)

    def _follow(self, stored: Stored) -> None:
        assert self._layout is not None
        if not self._layout.cracks:
            return
        set_times(self._stream, stored.scan.time, stored.number)
        plates = self._layout.plates
        sights, self._followed = follow(stored, self._baseline, self._followed, self._places, plates=plates)
        log_sights(self._stream, sights, self._layout.scales)

    def _log_metrics(self, tick: Tick, number: int) -> None:
        import rerun as rr

        assert tick.scan is not None
        set_times(self._stream, tick.scan.time, number)
        for name, measured in tick.metrics.items():
            variance = measured.sigma**2 if np.isfinite(measured.sigma) else 0.0
            point = rr.Measurements.from_fields(values=[measured.value], variances=[variance])
            self._stream.log(paths.trend(name), point)

    def _log_alarms(self, states: Mapping[str, str], moment: Instant, number: int) -> None:
        for name, state in states.items():
            if name not in self._alarms:
                log_alarm_looks(self._stream, name)
            if self._alarms.get(name) != state:
                self._alarms[name] = state
                log_alarm(self._stream, name, state, moment, number)
