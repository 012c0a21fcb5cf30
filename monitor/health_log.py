"""Health log: how each visit went, the failed and rejected ones too, beside the ledger; and how the lamp ages."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from configs import AutoExposure, Campaign
from pipelines import Frames, Instant, PatternSet
from pipelines.trends import Trend, trend

from .rigs import Rig
from .settled import Settled
from .vital_signs import VitalSigns, next_exposure, over_captures, vital_signs

__all__ = ["Health", "HealthKeeper", "HealthLog", "Promptness", "health_file", "lamp_trends", "promptness"]

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
    latency_s : float
        From the slot until the scan was worked out.
    dropped : int
        Slots that were missed right after it, although the campaign ran.
    """

    planned: int
    state: str
    lag_s: float = NAN
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
    latency_s: float = NAN
    dropped: int = 0

    @property
    def time(self) -> Instant:
        """The slot."""
        return np.datetime64(self.planned, "ns")


_KINDS = {"int": "INTEGER", "str": "TEXT", "float": "REAL"}
_COLUMNS = {each.name: _KINDS[str(each.type)] for each in fields(Health)}


class HealthLog:
    """The visits of one campaign, in SQLite. Readers and the writer each open it anew."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def add(self, health: Health) -> None:
        """Keep a visit; the same slot again replaces it."""
        with closing(sqlite3.connect(self._file, timeout=10.0)) as data, data:
            data.execute("PRAGMA journal_mode = WAL")
            data.execute("CREATE TABLE IF NOT EXISTS health (planned INTEGER PRIMARY KEY)")
            there = _columns_of(data)
            for name in _COLUMNS.keys() - there:  # a new file, or one of an older version
                data.execute(f"ALTER TABLE health ADD COLUMN {name} {_COLUMNS[name]}")
            names, marks = ", ".join(_COLUMNS), ", ".join("?" * len(_COLUMNS))
            data.execute(f"INSERT OR REPLACE INTO health ({names}) VALUES ({marks})", astuple(health))  # noqa: S608 - our own names

    def add_dropped(self, count: int) -> None:
        """Count slots that were missed after the newest visit."""
        newest = "planned = (SELECT max(planned) FROM health)"
        with closing(sqlite3.connect(self._file, timeout=10.0)) as data, data:
            if "dropped" in _columns_of(data):
                data.execute(f"UPDATE health SET dropped = coalesce(dropped, 0) + ? WHERE {newest}", (count,))  # noqa: S608 - a constant

    def newest(self, count: int) -> tuple[Health, ...]:
        """Give the newest visits, oldest first; none where nothing was kept yet."""
        if not self._file.exists():
            return ()
        try:
            with closing(sqlite3.connect(self._file, timeout=10.0)) as data:
                names = [name for name in _COLUMNS if name in _columns_of(data)]
                query = f"SELECT {', '.join(names)} FROM health ORDER BY planned DESC LIMIT ?"  # noqa: S608 - our own names
                rows = data.execute(query, (count,)).fetchall()
        except sqlite3.Error:
            return ()
        # SQLite keeps NaN as NULL
        known = ({name: value for name, value in zip(names, row, strict=True) if value is not None} for row in rows)
        return tuple(Health(**each) for each in reversed(list(known)))


def _columns_of(data: sqlite3.Connection) -> set[str]:
    return {name for _, name, *_ in data.execute("PRAGMA table_info(health)")}


def health_file(campaign: Campaign) -> Path:
    """Where a campaign's health is kept."""
    return campaign.store.beside / f"{Path(campaign.store.path).stem}.health.sqlite"


@dataclass(slots=True)
class HealthKeeper:
    """Goes along with a run: watches the rig, keeps each visit's health, and sets the exposure.

    It looks at a capture on the thread that captures, and keeps it on the one that settles, which may be long after.

    Parameters
    ----------
    rig : Rig
        The rig; it is used through this one, which keeps its protocol.
    log : HealthLog
    auto : AutoExposure or None
        Bounds of the exposure, on a rig that has `set_exposure(ms)`.
    tiles : bool
        A visit is many captures, of an area's tiles, and not one and its tries.
    """

    rig: Rig
    log: HealthLog
    auto: AutoExposure | None = None
    tiles: bool = False
    _seen: dict[Instant, tuple[list[VitalSigns], float]] = field(default_factory=dict)
    _told: SimpleQueue[str] = field(default_factory=SimpleQueue)

    def open(self) -> None:
        """Open the rig."""
        self.rig.open()

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Capture, look at what came, and set the exposure of the next."""
        frames = self.rig.capture(patterns, at)
        signs = vital_signs(frames)
        before = self._seen[at][0] if self.tiles and at in self._seen else []
        self._seen[at] = [*before, signs], float(getattr(self.rig, "temperature_c", NAN))
        self._expose(signs)
        return frames

    def close(self) -> None:
        """Close the rig."""
        self.rig.close()

    def settled(self, settled: Settled) -> Sequence[str]:
        """Keep a visit's health; give what is to be noted."""
        if settled.state != "missed":
            self._keep(settled)
        elif settled.dropped:
            self.log.add_dropped(settled.dropped)
        return [self._told.get() for _ in range(self._told.qsize())]

    def _keep(self, settled: Settled) -> None:
        nothing = [VitalSigns(NAN, NAN, NAN, NAN, NAN)], NAN
        seen, temperature_c = self._seen.pop(settled.began, nothing) if settled.began is not None else nothing
        signs = over_captures(seen)
        motion = settled.tick.change.motion if settled.tick is not None and settled.tick.change is not None else None
        self.log.add(
            Health(
                int(settled.planned.astype("datetime64[ns]").astype(np.int64)),
                settled.state,
                settled.lag_s,
                settled.timings.capture_s,
                settled.timings.work_s,
                settled.took_s,
                signs.exposure_ms,
                signs.bright,
                signs.light,
                signs.dark,
                signs.saturated,
                temperature_c,
                motion.verdict if motion is not None else "",
                motion.residual_mm if motion is not None else NAN,
                settled.latency_s,
            )
        )

    def _expose(self, signs: VitalSigns) -> None:
        set_exposure = getattr(self.rig, "set_exposure", None)
        if self.auto is None or set_exposure is None:
            return
        wanted = next_exposure(signs, self.auto)
        if not np.isfinite(wanted) or wanted == signs.exposure_ms:
            return
        why = f"{signs.saturated:.1%} saturated" if wanted < signs.exposure_ms else f"brightest {signs.bright:.0%}"
        try:
            set_exposure(wanted)
        except Exception as error:  # noqa: BLE001 - a device that refuses it still captures
            why = f"{why}, but the rig refused: {error}"
        self._told.put(f"exposure {signs.exposure_ms:.2f} ms -> {wanted:.2f} ms: {why}")


@dataclass(frozen=True, slots=True)
class Promptness:
    """How the newest visits kept their slots: the newest one's lateness, and of all of them what was dropped.

    `latency_s` is from the slot until the scan was worked out, NaN where none was.
    """

    lag_s: float
    latency_s: float
    dropped: int
    visits: int

    @property
    def told(self) -> str:
        """In words."""
        after = f", worked out after {self.latency_s:.2f} s" if np.isfinite(self.latency_s) else ""
        told = f"of the newest {self.visits + self.dropped} slots {self.dropped} were dropped"
        return f"newest began {self.lag_s:.3f} s late{after}; {told}"


def promptness(visits: Sequence[Health]) -> Promptness | None:
    """How visits kept their slots; None where there are none."""
    if not visits:
        return None
    return Promptness(visits[-1].lag_s, visits[-1].latency_s, sum(each.dropped for each in visits), len(visits))


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
