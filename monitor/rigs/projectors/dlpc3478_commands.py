"""Commands of a DLPC3478 (DLP3010EVM-LC): what a sequence of stored patterns is set up, checked and played with.

After TI's DLPC3470 and DLPC3478 Software Programmer's Guide (DLPU075). A command is its number and its parameters, as
they go over I2C.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

__all__ = ["ANSWER_BYTES", "Times", "ask_times", "play", "read_times", "sequence"]

MODE, TRIGGER_IN, TRIGGER_OUT, ORDER_TABLE, CHECK_EXPOSURE, PLAY = 0x05, 0x90, 0x92, 0x98, 0x9D, 0x9E
INTERNAL_PATTERNS = 4
ONE_BIT, INTERNAL = 0, 1
LEDS = {"red": 1, "green": 2, "blue": 4, "white": 7}
MOST_IN_SET = 64
ANSWER_BYTES = 13
"""Length of the answer to `ask_times`."""


@dataclass(frozen=True, slots=True)
class Times:
    """What the controller says to an exposure: whether it can show one-bit patterns so long, and how long it is dark.

    Parameters
    ----------
    possible : bool
    shortest_us : int
        The shortest exposure that is possible.
    before_us, after_us : int
        Dark times that it needs before and after each pattern.
    """

    possible: bool
    shortest_us: int
    before_us: int
    after_us: int


def ask_times(exposure_us: int) -> bytes:
    """Give the command that asks whether one-bit patterns from flash can be lit so long; ask before each set-up."""
    return struct.pack("<BBBI", CHECK_EXPOSURE, INTERNAL, ONE_BIT, exposure_us)


def read_times(answer: bytes) -> Times:
    """Read the answer to `ask_times`, of `ANSWER_BYTES` bytes."""
    flags, shortest, before, after = struct.unpack("<BIII", answer)
    return Times(bool(flags & 1), shortest, before, after)


def play(what: Literal["start", "stop"]) -> bytes:
    """Give the command that plays the sequence once from its beginning, or stops it."""
    return bytes([PLAY, 0 if what == "start" else 1, 0])


def sequence(
    sets: Sequence[Sequence[int]], exposure_us: int, before_us: int, after_us: int, led: str
) -> Iterator[bytes]:
    """Give the commands that set up a sequence of stored patterns, with a pulse on TRIG_OUT_2 at each.

    Parameters
    ----------
    sets : sequence of (int, int)
        Number of each pattern set in the flash, and how many of its patterns are shown, in the order of showing.
    exposure_us, before_us, after_us : int
        How long each pattern is lit, and dark before and after.
    led : str
        Key of `LEDS`.

    Raises
    ------
    ValueError
        There is no such LED, or a set is not two numbers that can be.
    """
    if led not in LEDS:
        raise ValueError(f"led must be one of {', '.join(LEDS)}, not {led!r}")
    for each in sets:
        if len(each) != 2 or not (0 <= each[0] < 128 and 1 <= each[1] <= MOST_IN_SET):
            raise ValueError(
                f"sets must be pairs of the set's number in the flash and how many patterns of it are shown (1 to "
                f"{MOST_IN_SET}), not {list(each)}"
            )
    yield play("stop")
    for place, (number, count) in enumerate(sets):
        begins = 1 if place == 0 else 0  # a new table, or one more row of it
        inverted = 0
        yield struct.pack(
            "<BBBBBQIII", ORDER_TABLE, begins, number, count, LEDS[led], inverted, exposure_us, before_us, after_us
        )
    yield bytes([TRIGGER_IN, 0])  # its own clock leads
    yield struct.pack("<BBi", TRIGGER_OUT, 0b011, 0)  # line 2, on, high while a pattern is lit, not delayed
    yield bytes([MODE, INTERNAL_PATTERNS])
