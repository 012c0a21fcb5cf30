"""Projectors: the registry of everything that can show a pattern."""

from __future__ import annotations

from collections.abc import Callable

from .base import Projector
from .dlpc350 import Dlpc350Projector
from .dlpc3478 import Dlpc3478Projector
from .external import ExternalProjector
from .screen import ScreenProjector

__all__ = ["PROJECTORS", "Projector"]

PROJECTORS: dict[str, Callable[..., Projector]] = {
    "screen": ScreenProjector,
    "dlpc350": Dlpc350Projector,
    "dlpc3478": Dlpc3478Projector,
    "external": ExternalProjector,
}
"""Every kind of projector by name; each is made from plain keywords, the rig's option ``projector``."""
