"""Health log: how each visit went, the failed and rejected ones too, beside the ledger; and how the lamp ages."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path

import numpy as np

from configs import AutoExposure, Campaign
from pipelines import Frames, Instant, PatternSet
from pipelines.trends import Trend, trend

from .loop import Settled
from .rigs import Rig
from .visit import Epoch, Recipe, Yield
from .vital_signs import VitalSigns, next_exposure, vital_signs

__all__ = ["Health", "HealthKeeper", "HealthLog", "health_file", "lamp_trends"]

NAN = float("nan")
CLIPPED = 0.02
"""A capture with a larger part of its white frame at the end of the scale tells less light than there is."""

DAY = np.timedelta64(86400 * 10**9, "ns")


@dataclass(frozen=True, slots=True)
class Health:
    """One visit.

    Parameters
    ----------
    planned : int
        The slot, nanoseconds since 1970 UTC.
    state : str
    lag_s, capture_s, work_s, took_s : float
        How late it began; taking the frames; working them out; all of it until it was durable. NaN where it never was.
    exposure_ms, bright, light, dark, saturated : float
        See `VitalSigns`.
    temperature_c : float
        Of the rig, where it tells; else NaN.
    verdict : str
        Of the registration: good, doubtful, failed; empty without one.
    residual_mm : float
    """

    planned: int
    state: str
    lag_s: float
    capture_s: float = NAN
    work_s: float = NAN
    took_s: float = NAN
    exposure_ms: float = NAN
    bright: float = NAN
    light: float = NAN
    dark: float = NAN
    saturated: float = NAN
    temperature_c: float = NAN
    verdict: str = ""
    residual_mm: float = NAN

    @property
    def time(self) -> Instant:
        """The slot."""
        return np.datetime64(self.planned, "ns")


_NAMES = tuple(each.name for each in fields(Health))


class HealthLog:
    """The visits of one campaign, in SQLite. Readers and the writer each open it anew."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def add(self, health: Health) -> None:
        """Keep a visit; the same slot again replaces it."""
        with closing(sqlite3.connect(self._file, timeout=10.0)) as data, data:
            data.execute("PRAGMA journal_mode = WAL")
            kinds = ["INTEGER PRIMARY KEY", "TEXT", *["REAL"] * (len(_NAMES) - 2)]
            columns = ", ".join(f"{name} {kind}" for name, kind in zip(_NAMES, kinds, strict=True))
            data.execute(f"CREATE TABLE IF NOT EXISTS health ({columns})")
            marks = ", ".join("?" * len(_NAMES))
            data.execute(f"INSERT OR REPLACE INTO health VALUES ({marks})", astuple(health))  # noqa: S608 - only marks

    def newest(self, count: int) -> tuple[Health, ...]:
        """Give the newest visits, oldest first; none where nothing was kept yet."""
        if not self._file.exists():
            return ()
        query = f"SELECT {', '.join(_NAMES)} FROM health ORDER BY planned DESC LIMIT ?"  # noqa: S608 - our own names
        try:
            with closing(sqlite3.connect(self._file, timeout=10.0)) as data:
                rows = data.execute(query, (count,)).fetchall()
        except sqlite3.Error:
            return ()
        return tuple(_health(*row) for row in reversed(rows))


def _health(planned: int, state: str, *values: float | str | None) -> Health:
    """SQLite keeps NaN as NULL."""
    return Health(planned, state, *(NAN if value is None else value for value in values))  # type: ignore[arg-type]  # in the order of its fields


def health_file(campaign: Campaign) -> Path:
    """Where a campaign's health is kept."""
    return campaign.store.beside / f"{Path(campaign.store.path).stem}.health.sqlite"


@dataclass(slots=True)
class HealthKeeper:
    """Goes along with a run: watches the rig and the work, keeps each visit's health, and sets the exposure.

    Parameters
    ----------
    rig : Rig
        The rig; it is used through this one, which keeps its protocol.
    log : HealthLog
    auto : AutoExposure or None
        Bounds of the exposure, on a rig that has `set_exposure(ms)`.
    """

    rig: Rig
    log: HealthLog
    auto: AutoExposure | None = None
    _seen: tuple[VitalSigns, float] | None = None
    _slots: dict[Instant, tuple[VitalSigns, float, float]] = field(default_factory=dict)
    _newest: Instant | None = None

    def open(self) -> None:
        """Open the rig."""
        self.rig.open()

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Capture, and look at what came."""
        self._seen = None
        began = time.perf_counter()
        frames = self.rig.capture(patterns, at)
        took = time.perf_counter() - began
        self._seen = vital_signs(frames), took
        return frames

    def close(self) -> None:
        """Close the rig."""
        self.rig.close()

    def timed(self, work: Callable[[Frames, Recipe, Epoch | None, Instant], Yield]) -> Callable[..., Yield]:
        """Give the work, and note how long it takes."""

        def timing(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
            began = time.perf_counter()
            try:
                return work(frames, recipe, epoch, planned)
            finally:
                if self._seen is not None:  # kept by slot: video settles in groups, long after
                    self._slots[planned] = *self._seen, time.perf_counter() - began
                    self._newest = planned

        return timing

    def settled(self, settled: Settled) -> Sequence[str]:
        """Keep a visit's health, and set the exposure of the next; give what is to be noted."""
        if settled.state == "missed":
            return ()
        nothing = VitalSigns(NAN, NAN, NAN, NAN, NAN), NAN, NAN
        signs, capture_s, work_s = self._slots.pop(settled.planned, nothing)
        motion = settled.tick.change.motion if settled.tick is not None and settled.tick.change is not None else None
        health = Health(
            int(settled.planned.astype("datetime64[ns]").astype(np.int64)),
            settled.state,
            settled.lag_s,
            capture_s,
            work_s,
            settled.took_s,
            signs.exposure_ms,
            signs.bright,
            signs.light,
            signs.dark,
            signs.saturated,
            float(getattr(self.rig, "temperature_c", NAN)),
            motion.verdict if motion is not None else "",
            motion.residual_mm if motion is not None else NAN,
        )
        told = self._expose(signs) if settled.planned == self._newest else ()
        self.log.add(health)
        return told

    def _expose(self, signs: VitalSigns) -> tuple[str, ...]:
        set_exposure = getattr(self.rig, "set_exposure", None)
        if self.auto is None or set_exposure is None:
            return ()
        wanted = next_exposure(signs, self.auto)
        if not np.isfinite(wanted) or wanted == signs.exposure_ms:
            return ()
        set_exposure(wanted)
        why = f"{signs.saturated:.1%} saturated" if wanted < signs.exposure_ms else f"brightest {signs.bright:.0%}"
        return (f"exposure {signs.exposure_ms:.2f} ms -> {wanted:.2f} ms: {why}",)


def lamp_trends(visits: Sequence[Health]) -> dict[str, Trend]:
    """Fit what ages: the lamp's light for the same exposure, and the dark against the white (dust, stray light).

    Values are relative to the first ones, so that a slope of -0.001 is a loss of 0.1 % a day. Saturated captures and
    those that were not taken say nothing of the lamp; less than three visits or a day give no trend.
    """
    found: dict[str, Trend] = {}
    visits = [each for each in visits if each.state == "taken" and each.saturated <= CLIPPED]
    if len(visits) < 3 or visits[-1].time - visits[0].time < DAY:
        return found
    times = np.array([each.time for each in visits], dtype="datetime64[ns]")
    lamp = np.array([each.light / each.exposure_ms if each.exposure_ms > 0 else np.nan for each in visits])
    for name, values in (("lamp", lamp), ("dark", np.array([each.dark for each in visits]))):
        known = np.isfinite(values)
        if known.sum() >= 3:
            first = float(np.median(values[known][:5]))
            found[name] = trend(times[known], values[known] / first if first else values[known])
    return found
