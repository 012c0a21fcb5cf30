"""Stages: the registry of everything that can move a sample."""

from __future__ import annotations

from collections.abc import Callable

from .base import Stage
from .gcode import GcodeStage
from .micromanager import MicroManagerStage
from .simulated import SimulatedStage
from .standa import StandaStage

__all__ = ["STAGES", "SimulatedStage", "Stage"]

STAGES: dict[str, Callable[..., Stage]] = {
    "gcode": GcodeStage,
    "micromanager": MicroManagerStage,
    "simulated": SimulatedStage,
    "standa": StandaStage,
}
"""Every kind of stage by name; each is made from plain keywords, the campaign's ``area.stage``."""
