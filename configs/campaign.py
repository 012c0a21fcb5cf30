"""Campaign: one site, one rig, one schedule, one recipe, as a frozen value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    PlainValidator,
    Strict,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from .units import DURATION, Duration, format_duration, parse_duration

__all__ = [
    "Alarm",
    "CalibrationSource",
    "Campaign",
    "GridSettings",
    "Reconstruct",
    "Register",
    "Retain",
    "RigSettings",
    "Schedule",
    "Site",
    "StoreSettings",
    "Video",
]


class _Settings(BaseModel):
    """Frozen, and an unknown key is an error: a typo must never be a setting that does nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def _from_folder(path: Path, info: ValidationInfo) -> Path:
    """Relative paths are relative to the campaign file, wherever the program was started."""
    folder = (info.context or {}).get("folder")
    return Path(folder) / path if folder is not None else path


def _text(value: Any) -> Any:
    if isinstance(value, str) and not value.strip():
        raise ValueError("must not be empty")
    return value


def _mapping_or_file(value: Any) -> Any:
    if not isinstance(value, Mapping | str | Path):
        raise ValueError("must be a pattern set, such as {kind: gray, size: [608, 684]}, or the name of a pattern file")
    return value


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (ValueError, OSError):  # ZoneInfoNotFoundError is a KeyError on no system; IsADirectoryError for "Europe"
        raise ValueError(f"{name!r} is not a time zone: use a name like Europe/Berlin or UTC") from None
    except KeyError:
        raise ValueError(f"{name!r} is not a time zone: use a name like Europe/Berlin or UTC") from None
    return name


def _moment(value: Any) -> Any:
    if isinstance(value, datetime):
        return value
    if not isinstance(value, str):
        raise ValueError("is not a time: write it like 2026-11-22T21:00:00Z")
    try:
        return datetime.fromisoformat(value.strip())
    except ValueError:
        raise ValueError(f"{value!r} is not a time: write it like 2026-11-22T21:00:00Z") from None


def _store_path(value: Any, info: ValidationInfo) -> Path | str:
    """A bucket's URL stays as it is; anything else is a folder's path."""
    if not isinstance(value, str | Path) or not str(value).strip():
        raise ValueError("must be a folder, or s3://BUCKET/PREFIX")
    if "://" not in str(value):
        return _from_folder(Path(value), info)
    if not re.fullmatch(_BUCKET_URL, str(value)):
        raise ValueError(f"{str(value)!r} is no place for a store: give a folder, or s3://BUCKET/PREFIX")
    return str(value).rstrip("/")


_BUCKET_URL = r"s3://[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9](/[^/]+)+/?"


def _kept(value: Any) -> Any:
    if isinstance(value, timedelta) or (isinstance(value, str) and value in ("off", "all")):
        return value
    try:
        return parse_duration(value)
    except ValueError:
        raise ValueError(f"must be off, all, or how long, such as 30 days, not {value!r}") from None


FolderPath = Annotated[Path, AfterValidator(_from_folder)]
StorePath = Annotated[
    Path | str,
    PlainValidator(_store_path),
    PlainSerializer(str, return_type=str),
    WithJsonSchema({"type": "string", "examples": ["soil.icechunk", "s3://bucket/soil"]}),
]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Text = Annotated[str, BeforeValidator(_text)]
Moment = Annotated[
    datetime,
    BeforeValidator(_moment),
    PlainSerializer(lambda moment: moment.isoformat(), return_type=str),
    WithJsonSchema({"type": "string", "examples": ["2026-11-22T21:00:00Z", "2026-11-22 22:00"]}),
]
Kept = Annotated[
    Literal["off", "all"] | timedelta,
    BeforeValidator(_kept),
    PlainSerializer(lambda kept: kept if isinstance(kept, str) else format_duration(kept), return_type=str),
    WithJsonSchema({"type": "string", "pattern": rf"^(off|all|{DURATION})$", "examples": ["off", "all", "30 days"]}),
]
Point = tuple[Number, Number]
Patterns = Annotated[Mapping[str, Any] | FolderPath, BeforeValidator(_mapping_or_file)]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3)]


class Site(_Settings):
    """Where the rig stands."""

    name: Text = Field(description="What people call the place; shown in reviews and reports.")
    zone: Annotated[str, AfterValidator(_zone)] = Field(
        default="UTC", description="Time zone of `cron` and of times that name none, such as Europe/Berlin."
    )


class StoreSettings(_Settings):
    """Where scans are kept. The path alone says it all: ``store: s3://bucket/site``."""

    path: StorePath = Field(
        description="Folder of the store, relative to this file, or s3://BUCKET/PREFIX; made by the first run."
    )
    kind: Text = Field(default="icechunk", description="Kind of store.")
    reserve_mb: Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)] | None = Field(
        default=None,
        description="Stop scanning while the disk has less than this free, MB. Without it the greater of 500 MB and "
        "ten scans, but no more than a twentieth of the disk.",
    )
    folder: FolderPath = Field(
        default=Path(),
        validate_default=True,
        description="For a store on S3: folder of the ledger and of a simulated calibration; this file's unless given.",
    )

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, given: Any) -> Any:
        return {"path": given} if isinstance(given, str | Path) else given

    @model_validator(mode="after")
    def _folder_of_what(self) -> Self:
        if isinstance(self.path, Path) and "folder" in self.model_fields_set:
            raise _at(("folder",), "has no meaning beside a local store, whose ledger lies beside it")
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core))
        schema["type"] = ["object", "string"]
        return schema

    @property
    def beside(self) -> Path:
        """The folder of what lies beside the store: its ledger, a simulated rig's calibration."""
        return self.path.parent if isinstance(self.path, Path) else self.folder


class RigSettings(_Settings):
    """What takes the captures."""

    name: Text = Field(description="Kind of rig.")
    options: Mapping[str, Any] = Field(default_factory=dict, description="Options of that kind of rig.")


class Video(_Settings):
    """Continuous capture."""

    rate_hz: Positive = Field(description="Scans per second, 1 for one a second.", le=1000)
    for_: Duration | None = Field(
        default=None, alias="for", description="How long each recording lasts; without it, until it is stopped."
    )
    commit_every_s: Annotated[float, Strict(), Field(ge=0, le=3600, allow_inf_nan=False)] = Field(
        default=0.0,
        description="Commit scans in groups, s: less work for each, and a power cut loses at most the last group. "
        "0: each scan at once.",
    )


class Schedule(_Settings):
    """When to scan: exactly one of `every`, `cron` and `video`."""

    every: Duration | None = Field(default=None, description="A fixed interval, such as 6 h; at least 1 s.")
    cron: Text | None = Field(
        default=None,
        description="Minute, hour, day, month, weekday (0 and 7 are Sunday), in the site's zone.",
    )
    video: Video | None = Field(default=None, description="Continuous capture, instead of single visits.")
    start: Moment | None = Field(
        default=None, description="First slot of `every`, and nothing before it; without it, the first run."
    )
    until: Moment | None = Field(default=None, description="No scan after this time.")
    grace: Duration | None = Field(
        default=None,
        description="How late a scan may begin; later, the slot is missed. "
        "Without it half the time to the next slot, at most 15 min.",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        given = [name for name in ("every", "cron", "video") if getattr(self, name) is not None]
        if len(given) != 1:
            names = " and ".join(given) if given else "none"
            raise PydanticCustomError("one_kind", f"needs exactly one of every, cron and video, not {names}")
        if self.every is not None and self.every.total_seconds() < 1:
            raise _at(("every",), "must be at least 1 s: for more than one scan a second use video: {rate_hz: ...}")
        if self.video is not None:
            for name in ("start", "grace"):
                if getattr(self, name) is not None:
                    raise _at((name,), "has no meaning with video, which starts when it is started")
        return self


class CalibrationSource(_Settings):
    """What places the points: a file, or for the simulated rig its own board."""

    file: FolderPath | None = Field(default=None, description="calibration.json of `microrelief calibrate`.")
    simulated: bool = Field(
        default=False,
        strict=True,
        description="Let the simulated rig calibrate itself on its simulated board, once; kept beside the store.",
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (not self.simulated):
            raise PydanticCustomError("one_source", "needs either file: calibration.json or simulated: true")
        return self


class GridSettings(_Settings):
    """The cells of the height maps."""

    pitch_mm: Positive | None = Field(
        default=None, description="Side of a cell; without it the camera's pixel on the object, rounded to 1-2-5."
    )


class Reconstruct(_Settings):
    """How captures become height maps."""

    remove_background: bool = Field(
        default=True, strict=True, description="Remove what stands well apart behind the object (K-means)."
    )


class Register(_Settings):
    """What holds still."""

    stable_mm: tuple[Polygon, ...] = Field(
        default=(),
        description="Polygons of (x, y) in the site frame that do not move: frame, fiducials, mask. "
        "Height and tilt are registered on them.",
    )


Count = Annotated[int, Strict(), Field(ge=1)]
LIMITS = ("warn_above", "alarm_above", "warn_below", "alarm_below")
RATES = tuple(f"{name.replace('_', '_rate_')}_per_day" for name in LIMITS)


class Alarm(_Settings):
    """What raises an alarm on one metric, in the metric's unit: each part by itself, the gravest counts."""

    name: Text = Field(description="Short name, shown to people.")
    metric: Text = Field(description="One of `metrics`.")
    unit: str | None = Field(default=None, description="Unit of the limits; checked against the metric's.")
    warn_above: Number | None = Field(default=None, description="A greater value is a warning.")
    alarm_above: Number | None = Field(default=None, description="A greater value is an alarm.")
    warn_below: Number | None = Field(default=None, description="A smaller value is a warning.")
    alarm_below: Number | None = Field(default=None, description="A smaller value is an alarm.")
    confirm: tuple[Count, Count] = Field(
        default=(1, 1), description="[m, n]: the limits count once m of the newest n values are beyond them."
    )
    clear_by: Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)] = Field(
        default=0.0, description="What was raised falls back only once the value is so far inside its limit."
    )
    warn_rate_above_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is greater is a warning."
    )
    alarm_rate_above_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is greater is an alarm."
    )
    warn_rate_below_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is smaller (more negative) is a warning."
    )
    alarm_rate_below_per_day: Number | None = Field(
        default=None, description="A rate whose whole 95 % interval is smaller (more negative) is an alarm."
    )
    within_days: Positive | None = Field(
        default=None, description="A warning if the trend, which must be certain, reaches a limit within so many days."
    )
    window_days: Positive | None = Field(
        default=None, description="Rate and trend are of so many days back; without it, since the baseline."
    )
    chart: Literal["cusum", "ewma"] | None = Field(
        default=None,
        description="A warning where the values change against those before, found by a control chart: cusum finds "
        "lasting changes, ewma also drifts.",
    )
    chart_model: Literal["level", "line"] | None = Field(
        default=None, description="What the chart takes for no change: a level (unless given), or a steady rate."
    )
    false_alarm_every_scans: Annotated[float, Strict(), Field(ge=10, le=100_000)] | None = Field(
        default=None,
        description="Of the chart: scans between two false alarms in the mean while nothing changes; 370 unless given.",
    )
    no_data_after_slots: Count = Field(
        default=3, description="No data is an alarm: after so many slots in a row without a value that can be judged."
    )

    @model_validator(mode="after")
    def _limits(self) -> Self:
        given = {name for name in (*LIMITS, *RATES) if getattr(self, name) is not None}
        if not given and self.chart is None:
            raise PydanticCustomError(
                "no_limit",
                "needs a limit: warn_above, alarm_above, warn_below or alarm_below, one of a rate such as "
                "warn_rate_above_per_day, or a chart",
            )
        for part in ("", "_rate"):
            for side, wrong in (("above", "above"), ("below", "below")):
                warn, alarm = (f"{grade}{part}_{side}{'_per_day' if part else ''}" for grade in ("warn", "alarm"))
                first, last = getattr(self, warn), getattr(self, alarm)
                if first is not None and last is not None and (first > last if side == "above" else first < last):
                    raise _at((warn,), f"must not be {wrong} {alarm}, {last:g}")
        for name, needed in (
            ("within_days", LIMITS),
            ("clear_by", LIMITS),
            ("confirm", LIMITS),
            ("window_days", (*RATES, "within_days")),
            ("chart_model", ("chart",)),
            ("false_alarm_every_scans", ("chart",)),
        ):
            if name in self.model_fields_set and all(getattr(self, other) is None for other in needed):
                raise _at((name,), f"has no meaning without {' or '.join(_short(needed))}")
        if self.confirm[0] > self.confirm[1]:
            raise _at(("confirm",), f"is [m, n] with m of the newest n values: {self.confirm[0]} of {self.confirm[1]}?")
        return self


def _short(names: tuple[str, ...]) -> tuple[str, ...]:
    """Name a few of many."""
    return names if len(names) < 3 else (f"a limit such as {names[1]}", *(name for name in names[4:] if name[0] == "w"))


class Retain(_Settings):
    """What is kept beside the height maps."""

    raw_frames: Kept = Field(
        default="off",
        description="Captured frames, from which `microrelief process` makes every scan again: off, all, or those of "
        "the last days, such as 30 days.",
    )


class Campaign(_Settings):
    """One site, one rig, one schedule, one recipe."""

    site: Site
    store: StoreSettings
    rig: RigSettings
    schedule: Schedule
    patterns: Patterns | None = Field(
        default=None,
        description="What is projected: a pattern set here, or the file of one; without it Gray code.",
    )
    calibration: CalibrationSource
    grid: GridSettings = GridSettings()
    reconstruct: Reconstruct = Reconstruct()
    register_: Register = Field(default=Register(), alias="register")
    region_mm: Polygon | None = Field(
        default=None, description="Polygon of (x, y) in the site frame whose cells count in the metrics."
    )
    metrics: tuple[Text, ...] = Field(default=("net_volume",), description="What is followed through time.")
    alarms: tuple[Alarm, ...] = ()
    retain: Retain = Retain()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        seen: set[str] = set()
        for index, name in enumerate(self.metrics):
            if name in seen:
                raise _at(("metrics", index), f"{name!r} is given twice")
            seen.add(name)
        names: set[str] = set()
        for index, alarm in enumerate(self.alarms):
            if alarm.name in names:
                raise _at(("alarms", index, "name"), f"{alarm.name!r} is given twice")
            names.add(alarm.name)
            if alarm.metric not in self.metrics:
                raise _at(("alarms", index, "metric"), f"{alarm.metric!r} is not among this campaign's metrics")
        start, until = self.start, self.until
        if start is not None and until is not None and until < start:
            raise _at(("schedule", "until"), "lies before start")
        return self

    @property
    def start(self) -> datetime | None:
        """`schedule.start`, aware: a time without a zone is in the site's."""
        return self._aware(self.schedule.start)

    @property
    def until(self) -> datetime | None:
        """`schedule.until`, aware: a time without a zone is in the site's."""
        return self._aware(self.schedule.until)

    def _aware(self, moment: datetime | None) -> datetime | None:
        if moment is not None and moment.tzinfo is None:
            moment = moment.replace(tzinfo=ZoneInfo(self.site.zone))
        return moment.astimezone(UTC) if moment is not None else None


def _at(route: tuple[str | int, ...], text: str) -> PydanticCustomError:
    """A problem that belongs to a value below the model that found it."""
    return PydanticCustomError("at", "{text}", {"text": text, "route": list(route)})
