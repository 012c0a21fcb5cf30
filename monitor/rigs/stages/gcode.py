"""GcodeStage: an XY stage that speaks G-code over a serial line, as 3D printers and many stages of one's own do."""

from __future__ import annotations

import re
import time
from typing import Any

from configs import DeviceUnavailable, InputError

from ...extras import load_extra
from .base import check_arrived

__all__ = ["GcodeStage"]

PLACE = re.compile(r"X:\s*(-?[\d.]+)\s+Y:\s*(-?[\d.]+)")
WAKES_S = 20.0
"""Many boards start anew when their line is opened."""
LINE_S = 0.5
COMPLAINTS = ("error", "!!", "resend")


class GcodeStage:
    """A firmware of the Marlin family: it answers each line with ``ok``, waits at M400 and tells its place at M114.

    Parameters
    ----------
    port : str
        Serial device such as ``/dev/ttyACM0``, or what pyserial takes as a URL.
    baud : int
    feed_mm_min : float
        Speed of travel.
    slowest_s : float
        A move that takes longer has failed.
    """

    def __init__(self, *, port: str, baud: int = 115_200, feed_mm_min: float = 600.0, slowest_s: float = 120.0) -> None:
        if baud <= 0 or feed_mm_min <= 0 or slowest_s <= 0:
            raise ValueError("baud, feed_mm_min and slowest_s must be above 0")
        self._port, self._baud, self._feed, self._slowest_s = port, baud, feed_mm_min, slowest_s
        self._line: Any = None

    def open(self) -> None:
        """Open the line, wait until the firmware has woken up, and choose mm and absolute places."""
        if self._line is not None:
            return
        serial = load_extra("serial", "gcode", "a G-code stage")
        self._lost = (serial.SerialException, OSError)
        try:
            self._line = serial.serial_for_url(self._port, self._baud, timeout=LINE_S, write_timeout=5.0)
        except self._lost as error:
            raise DeviceUnavailable(
                f"no stage answers at {self._port}: look at its power and cable, and whether another program holds it "
                f"({error})"
            ) from None
        except ValueError as error:
            raise InputError(f"stage option port: {error}") from None
        try:
            self._wake()
            self._ask("G90")
        except BaseException:
            self.close()
            raise

    def home(self) -> None:
        """Find both zeros by the end switches."""
        self._ask("G28 X Y")
        self._ask("M400")

    def move_to(self, x_mm: float, y_mm: float) -> None:
        """Move both axes in a line, and wait until they stand."""
        self._ask(f"G0 X{x_mm:.4f} Y{y_mm:.4f} F{self._feed:g}")
        self._ask("M400")
        check_arrived("the G-code stage", (x_mm, y_mm), self.where())

    def where(self) -> tuple[float, float]:
        """By the firmware's own count; without encoders, where it was sent."""
        told = self._ask("M114")
        for line in told:
            if found := PLACE.search(line):
                return float(found[1]), float(found[2])
        raise DeviceUnavailable(f"the G-code stage does not tell its place (M114): {' / '.join(told) or 'nothing'}")

    def close(self) -> None:
        """Let the line go; the firmware ends the move under way."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _wake(self) -> None:
        until = time.monotonic() + WAKES_S
        while True:
            try:
                self._ask("G21", within_s=2.0)
            except DeviceUnavailable:
                if time.monotonic() > until:
                    raise DeviceUnavailable(
                        f"what is at {self._port} does not speak G-code within {WAKES_S:g} s: check baud ({self._baud})"
                    ) from None
            else:
                self._line.reset_input_buffer()  # answers to lines that were sent while it woke
                return

    def _ask(self, line: str, within_s: float | None = None) -> list[str]:
        """Send a line; give what is said before its ``ok``."""
        if self._line is None:
            raise DeviceUnavailable("G-code stage: not open; call open() before it moves")
        until = time.monotonic() + (self._slowest_s if within_s is None else within_s)
        told: list[str] = []
        try:
            self._line.write(f"{line}\n".encode())
            while time.monotonic() < until:
                answer = self._line.readline().decode(errors="replace").strip()
                if answer.startswith("ok"):
                    return [*told, answer.removeprefix("ok").strip()]
                if answer.lower().startswith(COMPLAINTS):
                    raise DeviceUnavailable(f"the G-code stage answers {line!r} with {answer!r}")
                if answer:
                    told.append(answer)
        except self._lost as error:
            raise DeviceUnavailable(f"the G-code stage went away: look at its power and cable ({error})") from None
        raise DeviceUnavailable(f"the G-code stage did not finish {line!r} in time")
