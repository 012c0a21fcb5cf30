"""Exposure: the bounds within which it follows the light by itself."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from .settings import Positive, Settings

__all__ = ["AutoExposure"]


class AutoExposure(Settings):
    """Automatic exposure, on rigs that can set it: changed between visits, never within one."""

    shortest_ms: Positive
    longest_ms: Positive

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.shortest_ms > self.longest_ms:
            raise PydanticCustomError("bounds", "shortest_ms must not be above longest_ms")
        return self
