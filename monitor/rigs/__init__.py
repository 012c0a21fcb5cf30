"""Rigs: the registry of everything that can take a capture."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from configs import InputError

from .base import Rig
from .board_poses import BOARD, calibration_captures
from .replay import ReplayRig
from .simulated import SimulatedRig

__all__ = ["BOARD", "RIGS", "ReplayRig", "Rig", "SimulatedRig", "calibration_captures", "make_rig", "rig_options"]

RIGS: dict[str, Callable[..., Rig]] = {
    "simulated": SimulatedRig,
    "replay": ReplayRig,
}
"""Every kind of rig by name; each is made from plain keywords, the campaign's rig options."""


def rig_options(name: str) -> tuple[str, ...]:
    """Name the options of a kind of rig. Raises KeyError where there is no such kind."""
    return tuple(inspect.signature(RIGS[name]).parameters)


def make_rig(name: str, options: Mapping[str, Any]) -> Rig:
    """Make a rig from its name and options.

    Raises
    ------
    InputError
        There is no such rig or option, an option lacks, or one has an impossible value.
    """
    if name not in RIGS:
        raise InputError(f"rig name: no rig {name!r}{_meant(name, RIGS)}; there are {', '.join(RIGS)}")
    known = rig_options(name)
    for option in options:
        if option not in known:
            raise InputError(
                f"rig option {option}: the {name} rig has none of that name{_meant(option, known)}; "
                f"its options are {', '.join(known)}"
            )
    try:
        return RIGS[name](**options)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"rig options of {name}: {error}") from None


def _meant(word: str, known: Mapping[str, Any] | tuple[str, ...]) -> str:
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f", did you mean {near[0]!r}?" if near else ""
