"""Campaign: one site, one rig, one schedule, one recipe, as a frozen value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import (
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
from .area import Area
from .environment import Environment
from .exposure import AutoExposure
from .notify import Notifies
from .reports import Reports
from .schedule import Schedule
from .settings import FolderPath, Polygon, Positive, Settings, Text, Zone, at_key, from_folder
from .units import DURATION, format_duration, parse_duration

__all__ = [
    "CalibrationSource",
    "Campaign",
    "GridSettings",
    "Reconstruct",
    "Register",
    "Retain",
    "RigSettings",
    "Site",
    "StoreSettings",
]


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


def _mapping_or_file(value: Any) -> Any:
    if not isinstance(value, Mapping | str | Path):
        raise ValueError("must be a pattern set, such as {kind: gray, size: [608, 684]}, or the name of a pattern file")
    return value


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
Kept = Annotated[
    Literal["off", "all"] | timedelta,
    BeforeValidator(_kept),
    PlainSerializer(lambda kept: kept if isinstance(kept, str) else format_duration(kept), return_type=str),
    WithJsonSchema({"type": "string", "pattern": rf"^(off|all|{DURATION})$", "examples": ["off", "all", "30 days"]}),
]
Patterns = Annotated[Mapping[str, Any] | FolderPath, BeforeValidator(_mapping_or_file)]


class Site(Settings):
    """Where the rig stands."""

    name: Text = Field(description="What people call the place; shown in reviews and reports.")
    zone: Zone = Field(
        default="UTC", description="Time zone of `cron` and of times that name none, such as Europe/Berlin."
    )
    latitude: Annotated[float, Strict(), Field(ge=-90, le=90)] | None = Field(
        default=None, description="Degrees, north is positive; for `schedule.within.daylight`."
    )
    longitude: Annotated[float, Strict(), Field(ge=-180, le=180)] | None = Field(
        default=None, description="Degrees, east is positive."
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.latitude is None) != (self.longitude is None):
            missing = "latitude" if self.latitude is None else "longitude"
            raise PydanticCustomError("half_a_place", f"a place needs latitude and longitude: {missing} is missing")
        return self


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
    local_integration: bool = Field(
        default=False,
        strict=True,
        description="Read pixels that are too faint by themselves from sums over 3x3 or 5x5 pixels (Gray code only).",
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
    exposure: AutoExposure | None = Field(
        default=None, description="Let the exposure follow the light between these bounds; without it it is the rig's."
    )
    report: Reports | None = Field(
        default=None, description="Reports that the campaign writes by itself: daily, weekly, on alarm."
    )
    area: Area | None = Field(
        default=None, description="A stage that carries the sample from tile to tile: each scan covers all of them."
    )
    notify: Notifies = Field(default=(), description="Who is told of alarms, missing data, a lost device, a full disk.")

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
        within = self.schedule.within
        if within is not None and within.daylight and self.site.latitude is None:
            text = "needs the site's place: give site.latitude and site.longitude, or use hours"
            raise at_key(("schedule", "within", "daylight"), text)
        adaptive = self.schedule.adaptive
        for index, name in enumerate(adaptive.alarms if adaptive is not None else ()):
            if name not in names:
                raise at_key(("schedule", "adaptive", "alarms", index), f"{name!r} is not among this campaign's alarms")
        if adaptive is not None and not names:
            raise at_key(("schedule", "adaptive"), "needs an alarm to follow: give alarms")
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
