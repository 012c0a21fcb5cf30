"""Rigs: the registry of everything that can take a capture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .base import Rig
from .board_poses import BOARD, calibration_captures
from .delay import Delay, measure_delay
from .devices import DevicesRig
from .parts import make_from_kind, make_part, option_names
from .replay import ReplayRig
from .simulated import SimulatedRig
from .stages import STAGES, SimulatedStage, Stage

__all__ = [
    "BOARD",
    "RIGS",
    "STAGES",
    "Delay",
    "DevicesRig",
    "ReplayRig",
    "Rig",
    "SimulatedRig",
    "SimulatedStage",
    "Stage",
    "calibration_captures",
    "make_rig",
    "make_stage",
    "measure_delay",
    "rig_options",
]

RIGS: dict[str, Callable[..., Rig]] = {
    "simulated": SimulatedRig,
    "replay": ReplayRig,
    "devices": DevicesRig,
}
"""Every kind of rig by name; each is made from plain keywords, the campaign's rig options."""


def rig_options(name: str) -> tuple[str, ...]:
    """Name the options of a kind of rig. Raises KeyError where there is no such kind."""
    return option_names(RIGS[name])


def make_stage(options: Mapping[str, Any]) -> Stage:
    """Make a stage from its kind and options. Raises InputError as `make_rig` does."""
    return make_from_kind("stage", STAGES, options, "area.")


def make_rig(name: str, options: Mapping[str, Any]) -> Rig:
    """Make a rig from its name and options.

    Raises
    ------
    InputError
        There is no such rig or option, an option lacks, or one has an impossible value.
    """
    return make_part("rig", RIGS, name, options)
