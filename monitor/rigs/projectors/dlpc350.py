"""Dlpc350Projector: a LightCrafter 4500 that plays the patterns in its flash, and triggers the camera at each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from configs import DeviceUnavailable, InputError
from pipelines import PatternSet

from ...extras import load_extra
from . import dlpc350_packets as packets
from .base import Again

__all__ = ["Dlpc350Projector"]

VENDOR, PRODUCT = 0x0451, 0x6401
SIZE = (912, 1140)
ANSWER_MS = 1000
CHECK_S = 2.0
CHECK_ROUND_S = 0.05
ERROR = 0x20
BUSY = 0x80


class Dlpc350Projector:
    """TI's DLPC350 over USB HID. Not tried on hardware.

    The patterns lie in the module's flash, 24 in an image of 24 bits: add what `microrelief patterns` writes to images
    with TI's own program, in their order. The module plays them once, by its own clock; its line TRIG_OUT_1 is high
    while a pattern is lit and goes to the camera's trigger input.

    Parameters
    ----------
    images : sequence of int
        Numbers of the images in the flash, in the order of the patterns.
    exposure_ms : float
        How long each pattern is lit; the camera exposes as long or longer.
    dark_ms : float
        How long it is dark before the next; the camera reads its frame out meanwhile.
    led : str
        ``red``, ``green``, ``blue`` or ``white``.
    """

    again: Again = "capture"

    def __init__(
        self, *, images: Sequence[int] = (0, 1), exposure_ms: float = 20.0, dark_ms: float = 20.0, led: str = "blue"
    ) -> None:
        self._images = tuple(images)
        self._exposure_us = round(exposure_ms * 1000)
        self._period_us = self._exposure_us + round(dark_ms * 1000)
        self._led = led
        list(packets.sequence(1, self._images, self._exposure_us, self._period_us, led))  # what can never work
        self._device: Any = None
        self._loaded: PatternSet | None = None

    def open(self) -> None:
        """Find the module on USB."""
        if self._device is not None:
            return
        hid = load_extra("hid", "dlpc350", "a LightCrafter 4500")
        device = hid.device()
        try:
            device.open(VENDOR, PRODUCT)
        except OSError as error:
            raise DeviceUnavailable(
                "no LightCrafter 4500 can be opened: look at its power and USB cable, and whether this user may use it "
                f"by udev's rules ({error})"
            ) from None
        self._device = device

    def load(self, patterns: PatternSet) -> None:
        """Set the sequence up and let the module check it."""
        if patterns == self._loaded:
            return
        if patterns.size != SIZE:
            raise InputError(f"the LightCrafter 4500 has {SIZE[0]}x{SIZE[1]} mirrors: set patterns.size to {[*SIZE]}")
        if patterns.kind == "phase":
            raise InputError("the LightCrafter 4500 is driven with patterns of one bit: kind gray or stripes")
        self._loaded = None
        try:
            rows = list(
                packets.sequence(len(patterns.roles), self._images, self._exposure_us, self._period_us, self._led)
            )
        except ValueError as error:
            raise InputError(f"projector option images: {error}") from None
        for packet in rows:
            self._ask(packet)
        self._check()
        self._loaded = patterns

    def _check(self) -> None:
        until = time.monotonic() + CHECK_S
        while (found := self._ask(packets.read(packets.LUT_CHECK))[6]) & BUSY:
            if time.monotonic() > until:
                raise DeviceUnavailable(f"the LightCrafter 4500 has not checked its sequence within {CHECK_S:g} s")
            time.sleep(CHECK_ROUND_S)
        if why := packets.refusal(found):
            raise InputError(f"the LightCrafter 4500 refuses the sequence: {why}; mend the projector's options")

    def show(self, frame: int) -> None:
        """Play from the beginning at image 0; the others follow by themselves."""
        if frame == 0:
            self._ask(packets.play("stop"))
            self._ask(packets.play("start"))
        elif self._device is None:
            raise DeviceUnavailable(NOT_OPEN)

    def close(self) -> None:
        """Stop the sequence, which leaves the module dark, and let it go."""
        device, loaded = self._device, self._loaded
        if device is None:
            return
        try:
            if loaded is not None:
                self._ask(packets.play("stop"))
        except DeviceUnavailable:  # it went away: nothing is left to stop
            pass
        finally:
            self._device = self._loaded = None
            device.close()

    def _ask(self, packet: bytes) -> bytes:
        """Send a packet; give the report that answers it."""
        if self._device is None:
            raise DeviceUnavailable(NOT_OPEN)
        try:
            for report in packets.reports(packet):
                if self._device.write(b"\0" + report) < 0:  # hidapi wants the report's number first; there is one, 0
                    raise DeviceUnavailable(GONE)
            answer = bytes(self._device.read(packets.REPORT, ANSWER_MS))
        except (OSError, ValueError):
            raise DeviceUnavailable(GONE) from None
        if not answer:
            raise DeviceUnavailable(GONE)
        if answer[0] & ERROR:
            raise InputError(
                f"the LightCrafter 4500 refuses command {packet[5]:02X}{packet[4]:02X} {packet[6:14].hex()}"
            )
        return answer


NOT_OPEN = "LightCrafter 4500: not open; call open() before show()"
GONE = "the LightCrafter 4500 does not answer: look at its power and USB cable"
