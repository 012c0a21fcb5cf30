"""Packets of a DLPC350 (LightCrafter 4500): by what a sequence of stored one-bit patterns is set up, checked, played.

After the tables of TI's DLPC350 Programmer's Guide (DLPU010). A packet is one command as it goes over USB HID: a head
of flags, sequence number and length, the command, its data, in reports of 64 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Literal

__all__ = ["LUT_CHECK", "PLANES", "REPORT", "play", "read", "refusal", "reports", "sequence", "write"]

REPORT = 64
PLANES = 24
"""One-bit patterns in one stored image of 24 bits."""
MOST_PATTERNS = 128
"""Entries of the controller's table."""
MOST_IMAGES = 64
BLACK_US = 230
"""An exposure ends at least so long before the next begins, or they touch."""

READ, WRITE, WITH_REPLY = 0x80, 0x00, 0x40
START_STOP, DISPLAY_MODE, SOURCE, TRIGGER_MODE = 0x1A24, 0x1A1B, 0x1A22, 0x1A23
EXPOSURE, LUT_CONFIG, MAILBOX_ADDRESS, MAILBOX, MAILBOX_DATA = 0x1A29, 0x1A31, 0x1A32, 0x1A33, 0x1A34
LUT_CHECK = 0x1A1A

LEDS = {"red": 1, "green": 2, "blue": 4, "white": 7}


def write(command: int, data: bytes) -> bytes:
    """Give the packet that sets something, and asks for the reply that says whether it was taken."""
    return _packet(WRITE | WITH_REPLY, command, data)


def read(command: int) -> bytes:
    """Give the packet that asks for something."""
    return _packet(READ | WITH_REPLY, command, b"")


def _packet(flags: int, command: int, data: bytes) -> bytes:
    return struct.pack("<BBHH", flags, 0, len(data) + 2, command) + data


def reports(packet: bytes) -> Iterator[bytes]:
    """Cut a packet into reports; the last one is filled with zeros."""
    for start in range(0, len(packet), REPORT):
        yield packet[start : start + REPORT].ljust(REPORT, b"\0")


def play(what: Literal["stop", "start"]) -> bytes:
    """Give the packet that stops the sequence, or plays it from its beginning."""
    return write(START_STOP, bytes([2 if what == "start" else 0]))


def sequence(patterns: int, images: Sequence[int], exposure_us: int, period_us: int, led: str) -> Iterator[bytes]:
    """Give the packets that set up one play of stored patterns, each with a pulse on TRIG_OUT_1, and ask for the check.

    Parameters
    ----------
    patterns : int
        How many; pattern k is bit plane ``k % 24`` of image ``k // 24``.
    images : sequence of int
        Numbers of the images in the controller's flash.
    exposure_us, period_us : int
        How long each pattern is lit, and from one to the next.
    led : str
        Key of `LEDS`.

    Raises
    ------
    ValueError
        Too many patterns, too few images, an LED or a time that there is not.
    """
    if not 1 <= patterns <= min(MOST_PATTERNS, PLANES * len(images)):
        raise ValueError(
            f"{patterns} patterns do not fit: {len(images)} images hold {PLANES * len(images)}, "
            f"the controller plays {MOST_PATTERNS}"
        )
    if len(images) > MOST_IMAGES or not all(0 <= image < MOST_IMAGES for image in images):
        raise ValueError(f"images must be numbers of 0 to {MOST_IMAGES - 1} in the module's flash, not {list(images)}")
    if led not in LEDS:
        raise ValueError(f"led must be one of {', '.join(LEDS)}, not {led!r}")
    if not 0 < exposure_us <= period_us - BLACK_US:
        raise ValueError(
            f"a pattern must be dark for {BLACK_US} us before the next: of a period of {period_us} us "
            f"{exposure_us} us cannot be lit"
        )
    yield play("stop")
    yield write(DISPLAY_MODE, b"\1")  # pattern sequences
    yield write(SOURCE, b"\3")  # from flash
    yield write(LUT_CONFIG, bytes([patterns - 1, 0, patterns - 1, len(images) - 1]))  # once, not again and again
    yield write(TRIGGER_MODE, b"\1")  # by its own clock
    yield write(EXPOSURE, struct.pack("<II", exposure_us, period_us))
    # TI's own library sends two images in reverse, and only two
    yield from _mailbox(1, bytes(reversed(images)) if len(images) == 2 else bytes(images))
    yield from _mailbox(2, b"".join(_entry(number, LEDS[led]) for number in range(patterns)))
    yield write(LUT_CHECK, b"\0")


def _mailbox(number: int, data: bytes) -> Iterator[bytes]:
    yield write(MAILBOX, bytes([number]))
    yield write(MAILBOX_ADDRESS, b"\0")
    yield write(MAILBOX_DATA, data)
    yield write(MAILBOX, b"\0")


def _entry(number: int, led: int) -> bytes:
    """One row of the table: by the internal trigger, one bit deep, black after it; a new image at its first plane."""
    plane = number % PLANES
    insert_black, swap_buffer = 0b0010, 0b0100
    return bytes([plane << 2, led << 4 | 1, insert_black | (swap_buffer if plane == 0 else 0)])


def refusal(check: int) -> str:
    """Say in words why the controller does not play what was set up; empty where it does.

    Parameters
    ----------
    check : int
        Its answer to `LUT_CHECK`, once that has ended (bit 7 is 0). Bits 2 to 4 are warnings.
    """
    reasons = {0: "its exposure or period is impossible", 1: "a pattern number is impossible"}
    return " and ".join(words for bit, words in reasons.items() if check >> bit & 1)
