"""Area: what a stage visits, tile by tile, where one field of view is not enough."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, Strict, model_validator

from .settings import Number, Positive, Settings, at_key

__all__ = ["Area"]

Axis = Literal["x", "y", "-x", "-y"]
Travel = tuple[Number, Number]


class Area(Settings):
    """Where a stage carries the sample, so that a scan covers more than one field of view."""

    stage: Mapping[str, Any] = Field(description="The stage: its kind, and the options of that kind.")
    x_mm: Travel = Field(description="From where to where the stage travels along its first axis, mm.")
    y_mm: Travel = Field(description="The same along its second axis.")
    overlap: Annotated[float, Strict(), Field(ge=0.05, le=0.8)] = Field(
        default=0.25, description="Share of the field of view that neighbouring tiles have in common, at least."
    )
    settle_s: Annotated[float, Strict(), Field(ge=0, le=600)] = Field(
        default=0.5, description="Wait after each move, for what still swings."
    )
    home: bool = Field(default=False, strict=True, description="Let the stage find its zero by its switches first.")
    tries: Annotated[int, Strict(), Field(ge=1, le=100)] = Field(
        default=3, description="How often one tile is tried before it is left out."
    )
    axes: tuple[Axis, Axis] | None = Field(
        default=None,
        description="Along which of the image's axes each of the stage's moves the sample, such as [-x, y]. "
        "A schedule needs it; `microrelief area` finds it by the overlaps and prints it.",
    )
    sigma_mm: Positive = Field(default=0.05, description="How far off the stage may be.")
    least_tiles: Annotated[float, Strict(), Field(gt=0, le=1)] = Field(
        default=0.5, description="Share of the tiles that a scheduled scan needs: with fewer the visit fails."
    )

    @model_validator(mode="after")
    def _two_axes(self) -> Self:
        if self.axes is not None and self.axes[0][-1] == self.axes[1][-1]:
            raise at_key(("axes",), "must be one along x and one along y")
        for name in ("x_mm", "y_mm"):
            begin, end = getattr(self, name)
            if end < begin:
                raise at_key((name,), f"must go from the lesser to the greater, not from {begin:g} to {end:g}")
        if self.x_mm[0] == self.x_mm[1] and self.y_mm[0] == self.y_mm[1]:
            raise at_key(("x_mm",), "the stage goes nowhere: give it some way along x or y")
        return self
