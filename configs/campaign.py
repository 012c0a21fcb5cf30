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
    BeforeValidator,
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

from .alarm import Alarm
from .environment import Environment
from .settings import FolderPath, Number, Positive, Settings, Text, at_key, from_folder
from .units import DURATION, Duration, format_duration, parse_duration

__all__ = [
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
        return from_folder(Path(value), info)
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


StorePath = Annotated[
    Path | str,
    PlainValidator(_store_path),
    PlainSerializer(str, return_type=str),
    WithJsonSchema({"type": "string", "examples": ["soil.icechunk", "s3://bucket/soil"]}),
]
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


class Site(Settings):
    """Where the rig stands."""

    name: Text = Field(description="What people call the place; shown in reviews and reports.")
    zone: Annotated[str, AfterValidator(_zone)] = Field(
        default="UTC", description="Time zone of `cron` and of times that name none, such as Europe/Berlin."
    )


class StoreSettings(Settings):
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
            raise at_key(("folder",), "has no meaning beside a local store, whose ledger lies beside it")
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


class RigSettings(Settings):
    """What takes the captures."""

    name: Text = Field(description="Kind of rig.")
    options: Mapping[str, Any] = Field(default_factory=dict, description="Options of that kind of rig.")


class Video(Settings):
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


class Schedule(Settings):
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
            raise at_key(("every",), "must be at least 1 s: for more than one scan a second use video: {rate_hz: ...}")
        if self.video is not None:
            for name in ("start", "grace"):
                if getattr(self, name) is not None:
                    raise at_key((name,), "has no meaning with video, which starts when it is started")
        return self


class CalibrationSource(Settings):
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


class GridSettings(Settings):
    """The cells of the height maps."""

    pitch_mm: Positive | None = Field(
        default=None, description="Side of a cell; without it the camera's pixel on the object, rounded to 1-2-5."
    )


class Reconstruct(Settings):
    """How captures become height maps."""

    remove_background: bool = Field(
        default=True, strict=True, description="Remove what stands well apart behind the object (K-means)."
    )


class Register(Settings):
    """What holds still."""

    stable_mm: tuple[Polygon, ...] = Field(
        default=(),
        description="Polygons of (x, y) in the site frame that do not move: frame, fiducials, mask. "
        "Height and tilt are registered on them.",
    )


class Retain(Settings):
    """What is kept beside the height maps."""

    raw_frames: Kept = Field(
        default="off",
        description="Captured frames, from which `microrelief process` makes every scan again: off, all, or those of "
        "the last days, such as 30 days.",
    )


class Campaign(Settings):
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
    environment: Environment | None = Field(
        default=None, description="Temperature and humidity: kept with each scan, and regressed out of the trends."
    )
    retain: Retain = Retain()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        seen: set[str] = set()
        for index, name in enumerate(self.metrics):
            if name in seen:
                raise at_key(("metrics", index), f"{name!r} is given twice")
            seen.add(name)
        names: set[str] = set()
        for index, alarm in enumerate(self.alarms):
            if alarm.name in names:
                raise at_key(("alarms", index, "name"), f"{alarm.name!r} is given twice")
            names.add(alarm.name)
            if alarm.metric not in self.metrics:
                raise at_key(("alarms", index, "metric"), f"{alarm.metric!r} is not among this campaign's metrics")
        start, until = self.start, self.until
        if start is not None and until is not None and until < start:
            raise at_key(("schedule", "until"), "lies before start")
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
