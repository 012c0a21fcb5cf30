"""StandaStage: two axes of Standa's controllers (8SMC4, 8SMC5) through libximc."""

from __future__ import annotations

import contextlib
from typing import Any

from configs import DeviceUnavailable

from ...extras import load_extra
from .base import check_arrived

__all__ = ["StandaStage"]

ROUND_MS = 10
ERRORS = (ConnectionError, RuntimeError, ValueError, NotImplementedError)
"""What libximc raises for a result that is not fine."""


class StandaStage:
    """One axis per controller, each by the URI that libximc names it with.

    Parameters
    ----------
    x, y : str
        URI of each axis: ``xi-com:///dev/ttyACM0``, ``xi-net://HOST/SERIAL``, or ``xi-emu:///ABSOLUTE/PATH`` for the
        vendor's virtual controller.
    steps_per_mm : float
        Whole steps of the motor to a mm of travel: 400 for stages of 2.5 um a step.
    """

    def __init__(self, *, x: str, y: str, steps_per_mm: float = 400.0) -> None:
        if steps_per_mm <= 0:
            raise ValueError(f"steps_per_mm must be above 0, not {steps_per_mm}")
        if x == y:
            raise ValueError(f"x and y must be two axes, not twice {x}")
        self._uris = (x, y)
        self._mm_per_step = 1.0 / steps_per_mm
        self._axes: tuple[Any, ...] = ()

    def open(self) -> None:
        """Find both controllers."""
        if self._axes:
            return
        ximc = load_extra("libximc.highlevel", "standa", "a Standa stage")
        opened: list[Any] = []
        for uri in self._uris:
            try:
                axis = ximc.Axis(uri)
                axis.open_device()
                opened.append(axis)
                axis.set_calb(self._mm_per_step, axis.get_engine_settings().MicrostepMode)
            except ERRORS as error:
                _let_go(opened)
                raise DeviceUnavailable(
                    f"no Standa axis answers at {uri}: look at its power and cable, and whether another program holds "
                    f"it ({str(error).partition(chr(10))[0]})"
                ) from None
        self._axes = tuple(opened)

    def home(self) -> None:
        """Find both zeros, one after the other."""
        for axis in self._held():
            self._ask(axis.command_homezero)

    def move_to(self, x_mm: float, y_mm: float) -> None:
        """Move both axes at once, and wait for them."""
        axes = self._held()
        for axis, place in zip(axes, (x_mm, y_mm), strict=True):
            self._ask(axis.command_move_calb, float(place))
        for axis in axes:
            self._ask(axis.command_wait_for_stop, ROUND_MS)
        check_arrived("the Standa stage", (x_mm, y_mm), self.where())

    def where(self) -> tuple[float, float]:
        """By the controllers' own count: of the encoder where the axis has one."""
        x, y = (float(self._ask(axis.get_position_calb).Position) for axis in self._held())
        return x, y

    def close(self) -> None:
        """Stop softly and let both go."""
        axes, self._axes = self._axes, ()
        _let_go(axes)

    def _held(self) -> tuple[Any, ...]:
        if not self._axes:
            raise DeviceUnavailable("Standa stage: not open; call open() before it moves")
        return self._axes

    def _ask(self, verb: Any, *given: Any) -> Any:
        try:
            return verb(*given)
        except ERRORS as error:
            told = str(error).partition("\n")[0]
            raise DeviceUnavailable(f"the Standa stage went away: look at its power and cable ({told})") from None


def _let_go(axes: Any) -> None:
    for axis in axes:
        with contextlib.suppress(*ERRORS):  # it may be gone
            axis.command_stop()
        with contextlib.suppress(*ERRORS):
            axis.close_device()
