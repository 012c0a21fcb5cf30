"""Projectors: the registry of everything that can show a pattern."""

from __future__ import annotations

from collections.abc import Callable

from .base import Projector
from .external import ExternalProjector
from .screen import ScreenProjector

__all__ = ["PROJECTORS", "Projector"]

PROJECTORS: dict[str, Callable[..., Projector]] = {
    "screen": ScreenProjector,
    "external": ExternalProjector,
}
"""Every kind of projector by name; each is made from plain keywords, the rig's option ``projector``."""
