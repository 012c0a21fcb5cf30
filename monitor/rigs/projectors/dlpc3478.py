"""Dlpc3478Projector: a DLP3010EVM-LC that plays the patterns in its flash, and triggers the camera at each."""

from __future__ import annotations

from collections.abc import Sequence

from configs import DeviceUnavailable, InputError
from pipelines import PatternSet

from . import dlpc3478_commands as commands
from .base import Again
from .i2c_bridge import I2CBridge

__all__ = ["Dlpc3478Projector"]

SIZE = (1280, 720)
NOT_OPEN = "DLP3010EVM-LC: not open; call open() before show()"


class Dlpc3478Projector:
    """TI's DLPC3478 over I2C, by the USB bridge on the evaluation module. Not tried on hardware.

    The patterns lie in the module's flash in sets of one bit and one direction (stripes of columns, or of rows): put
    those that `microrelief patterns` writes there with TI's own program, in their order. The module plays them once, by
    its own clock; its line TRIG_OUT_2 is high while a pattern is lit and goes to the camera's trigger input.

    Parameters
    ----------
    sets : sequence of (int, int)
        Number of each pattern set in the flash, and how many of its patterns are shown, in the order of the patterns:
        ``[[0, 22], [1, 20]]``.
    exposure_ms : float
        How long each pattern is lit; the camera exposes as long or longer.
    dark_ms : float
        How long it is dark before the next, at least; the camera reads its frame out meanwhile.
    led : str
        ``red``, ``green``, ``blue`` or ``white``.
    """

    again: Again = "capture"

    def __init__(
        self, *, sets: Sequence[Sequence[int]], exposure_ms: float = 20.0, dark_ms: float = 20.0, led: str = "blue"
    ) -> None:
        if exposure_ms <= 0 or dark_ms < 0:
            raise ValueError(f"exposure_ms must be above 0 and dark_ms not below, not {exposure_ms} and {dark_ms}")
        self._sets = tuple(tuple(each) for each in sets)
        self._exposure_us, self._dark_us = round(exposure_ms * 1000), round(dark_ms * 1000)
        self._led = led
        list(commands.sequence(self._sets, self._exposure_us, 0, 0, led))  # what can never work
        self._bus: I2CBridge | None = None
        self._loaded: PatternSet | None = None

    def open(self) -> None:
        """Find the module on USB."""
        if self._bus is None:
            self._bus = I2CBridge().__enter__()

    def load(self, patterns: PatternSet) -> None:
        """Ask for the times that the controller needs, and set the sequence up."""
        bus = self._held()
        if patterns == self._loaded:
            return
        self._refuse(patterns)
        self._loaded = None
        times = commands.read_times(bus.read(commands.ask_times(self._exposure_us), commands.ANSWER_BYTES))
        if not times.possible:
            raise InputError(
                f"the DLP3010EVM-LC cannot light its patterns for {self._exposure_us / 1000:g} ms; the shortest is "
                f"{times.shortest_us / 1000:g} ms: set the projector's exposure_ms"
            )
        after_us = max(times.after_us, self._dark_us - times.before_us)
        for command in commands.sequence(self._sets, self._exposure_us, times.before_us, after_us, self._led):
            bus.write(command)
        self._loaded = patterns

    def _refuse(self, patterns: PatternSet) -> None:
        if patterns.size != SIZE:
            raise InputError(f"the DLP3010EVM-LC has {SIZE[0]}x{SIZE[1]} mirrors: set patterns.size to {[*SIZE]}")
        if patterns.kind == "phase":
            raise InputError("the DLP3010EVM-LC is driven with patterns of one bit: kind gray or stripes")
        shown = sum(count for _, count in self._sets)
        if shown != len(patterns.roles):
            raise InputError(
                f"projector option sets: they show {shown} patterns, and the campaign's pattern set has "
                f"{len(patterns.roles)}"
            )

    def show(self, frame: int) -> None:
        """Play from the beginning at image 0; the others follow by themselves."""
        bus = self._held()
        if frame == 0:
            bus.write(commands.play("stop"))
            bus.write(commands.play("start"))

    def close(self) -> None:
        """Stop the sequence, which leaves the module dark, and let it go."""
        bus, self._bus = self._bus, None
        loaded, self._loaded = self._loaded, None
        if bus is None:
            return
        try:
            if loaded is not None:
                bus.write(commands.play("stop"))
        except DeviceUnavailable:  # it went away: nothing is left to stop
            pass
        finally:
            bus.__exit__(None, None, None)

    def _held(self) -> I2CBridge:
        if self._bus is None:
            raise DeviceUnavailable(NOT_OPEN)
        return self._bus
