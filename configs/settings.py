"""What all settings share: frozen models, and the fields that many of them have."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any
from zoneinfo import ZoneInfo

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    Strict,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

__all__ = [
    "Count",
    "FolderPath",
    "Moment",
    "Number",
    "Point",
    "Polygon",
    "Positive",
    "Settings",
    "Text",
    "Zone",
    "at_key",
    "from_folder",
]


class Settings(BaseModel):
    """Frozen, and an unknown key is an error: a typo must never be a setting that does nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def at_key(route: tuple[str | int, ...], text: str) -> PydanticCustomError:
    """A problem that belongs to a value below the model that found it."""
    return PydanticCustomError("at", "{text}", {"text": text, "route": list(route)})


def from_folder(path: Path, info: ValidationInfo) -> Path:
    """Relative paths are relative to the campaign file, wherever the program was started."""
    folder = (info.context or {}).get("folder")
    return Path(folder) / path if folder is not None else path


def _text(value: Any) -> Any:
    if isinstance(value, str) and not value.strip():
        raise ValueError("must not be empty")
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


FolderPath = Annotated[Path, AfterValidator(from_folder)]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Strict(), Field(ge=1)]
Text = Annotated[str, BeforeValidator(_text)]
Zone = Annotated[str, AfterValidator(_zone)]
Moment = Annotated[
    datetime,
    BeforeValidator(_moment),
    PlainSerializer(lambda moment: moment.isoformat(), return_type=str),
    WithJsonSchema({"type": "string", "examples": ["2026-11-22T21:00:00Z", "2026-11-22 22:00"]}),
]
Point = tuple[Number, Number]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3)]
