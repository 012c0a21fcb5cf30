"""Reports: when a campaign writes them by itself, where, and how."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from .settings import FolderPath, Settings
from .units import Duration

__all__ = ["Reports"]


class Reports(Settings):
    """What `microrelief report` is run for by the campaign itself, beside the visits and never in their way."""

    every: Literal["day", "week"] | None = Field(
        default=None, description="Write one when a day or a week (from Monday) is over, in the site's zone."
    )
    on_alarm: bool = Field(
        default=False, strict=True, description="Write one when an alarm goes off, or has no data any more."
    )
    alarm_rest: Duration = Field(
        default=timedelta(hours=6),
        validate_default=True,
        description="Least time between two reports on alarms; what goes off meanwhile is in one when it is over.",
    )
    out: FolderPath = Field(
        default=Path("reports"),
        validate_default=True,
        description="Folder; each report has one of its own in it, such as 2026-11-22 or 2026-W47.",
    )
    covers: Duration | None = Field(
        default=None, description="How far back a report goes, such as 30 days; without it to the beginning."
    )
    pdf: bool = Field(default=False, strict=True, description="As PDF too (pip install 'microrelief[pdf]').")
    templates: FolderPath | None = Field(default=None, description="Folder of your own templates.")

    @model_validator(mode="after")
    def _ever(self) -> Self:
        if self.every is None and not self.on_alarm:
            raise PydanticCustomError("never", "needs every: day or week, or on_alarm: true")
        return self
