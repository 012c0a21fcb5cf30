"""Notify: who is told of what. Addresses hold passwords, so they stand in the environment or in a file of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, Strict, model_validator
from pydantic_core import PydanticCustomError

from .settings import FolderPath, Positive, Settings
from .units import Duration

__all__ = ["CONDITIONS", "Condition", "Notifies", "Notify"]

Condition = Literal["alarm", "no data", "device gone", "disk filling", "not taken"]
"""What people are told of when it begins and when it is over."""

CONDITIONS: tuple[Condition, ...] = get_args(Condition)


class Notify(Settings):
    """One group of addresses, and what it is told of.

    The addresses are Apprise URLs (mailto://, slack://, json:// ...), one a line.
    """

    env: str | None = Field(
        default=None, pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", description="Environment variable that holds the addresses."
    )
    file: FolderPath | None = Field(
        default=None, description="File that holds the addresses, readable by its owner alone; not this one."
    )
    on: tuple[Condition, ...] = Field(
        default=CONDITIONS, min_length=1, description="What they are told of, and of its end; without it everything."
    )
    remind: Duration | None = Field(default=None, description="Tell again after so long while it lasts, such as 1 day.")
    disk_days: Positive = Field(
        default=14.0, description="The disk is filling where it is full in fewer days at this pace."
    )
    after: Annotated[int, Strict(), Field(ge=1, le=100)] = Field(
        default=2, description="'not taken' begins after so many slots in a row without a scan."
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.env is None) == (self.file is None):
            raise PydanticCustomError("one_source", "needs either env or file, which hold the addresses")
        return self


def _no_secret_here(given: Any) -> Any:
    """An address in the campaign would go into the store with the campaign's text; it is not repeated here either."""
    groups = given if isinstance(given, list | tuple) else [given]
    values = [value for group in groups for value in (group.values() if isinstance(group, Mapping) else [group])]
    if any(isinstance(value, str) and "://" in value for value in values):
        raise ValueError(
            "an address must not stand in the campaign, which is kept in the store: "
            "give env: NAME of an environment variable, or file: of another file, that holds it"
        )
    return [given] if isinstance(given, Mapping) else given


Notifies = Annotated[tuple[Notify, ...], BeforeValidator(_no_secret_here)]
