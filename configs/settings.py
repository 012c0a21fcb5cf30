"""What all settings share: frozen models, and the fields that many of them have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationInfo
from pydantic_core import PydanticCustomError

__all__ = ["Count", "FolderPath", "Number", "Positive", "Settings", "Text", "at_key", "from_folder"]


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


FolderPath = Annotated[Path, AfterValidator(from_folder)]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Strict(), Field(ge=1)]
Text = Annotated[str, BeforeValidator(_text)]
