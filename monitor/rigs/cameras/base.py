"""Camera: what takes one frame of what is projected now. Four verbs: open, start, take, close."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from configs import CaptureError

__all__ = ["Camera", "FrameLost", "Image", "Shot", "bits_of", "check_timeout", "lost_between", "to_full_range"]

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class FrameLost(CaptureError):  # noqa: N818 - a state of the world, not a fault of the program
    """A frame came damaged, incomplete or not at all; the same pattern may be taken again."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame of a camera.

    Parameters
    ----------
    image : ndarray of uint8 or uint16, shape (row, column)
        The camera's own orientation. Values of fewer than 16 bits in uint16 are scaled to the whole range.
    number : int or None
        The device's own count of its frames; None where it has none.
    """

    image: Image
    number: int | None = None


@runtime_checkable
class Camera(Protocol):
    """A camera that gives one frame for each trigger.

    Made by its registered factory from plain keywords, it touches no device before ``open``, and after ``close`` may
    be opened again.
    """

    wraps_at: int | None
    """After this count the device's frames begin again with 1; None: they never do."""

    @property
    def awaits_trigger(self) -> bool:
        """Whether a frame is taken when the projector pulls a line, and not when we ask for it."""
        ...

    @property
    def exposure_ms(self) -> float:
        """Exposure of the frames; NaN where the device does not say."""
        ...

    def open(self) -> None:
        """Take hold of the device and set it up.

        Raises
        ------
        DeviceUnavailable
            The device is not there, or held by another program.
        InputError
            It has no such setting, or the setting does not take the value.
        """
        ...

    def start(self) -> None:
        """Begin a capture: frames that still wait from before are thrown away."""
        ...

    def take(self) -> Shot:
        """Trigger once, or wait for the trigger line, and give that frame.

        Raises
        ------
        FrameLost
            The frame is damaged, or did not come in time.
        DeviceUnavailable
            The device went away.
        """
        ...

    def close(self) -> None:
        """Let the device go; harmless if not open."""
        ...


BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono16": 16}


def bits_of(pixel_format: str) -> int:
    """Give the depth of a pixel format of GenICam. Raises ValueError where it is none that we take."""
    if pixel_format not in BITS:
        raise ValueError(f"pixel_format {pixel_format!r} is none of {', '.join(BITS)}")
    return BITS[pixel_format]


def check_timeout(timeout_ms: float) -> None:
    """Refuse a wait that is none. Raises ValueError."""
    if timeout_ms <= 0:
        raise ValueError(f"timeout_ms must be above 0, not {timeout_ms}")


def lost_between(before: int | None, now: int | None, wraps_at: int | None) -> int:
    """Count the frames that a device made between two that arrived.

    Parameters
    ----------
    before, now : int or None
        The device's count of the earlier and the later frame.
    wraps_at : int or None
        Last count before it begins again with 1 (GigE Vision: 65535; 0 is not used); None: it does not begin again.

    Returns
    -------
    int
        0 where they follow each other, or where the device does not count.
    """
    if before is None or now is None:
        return 0
    step = now - before
    if step <= 0 and wraps_at is not None:
        step += wraps_at
    return max(step - 1, 0)


def to_full_range(image: Image, bits: int) -> Image:
    """Scale values of `bits` bits in uint16 to the whole range, as our frames have them; 8 and 16 bits stay."""
    if image.dtype == np.uint8 or bits >= 16:
        return image
    return np.left_shift(image.astype(np.uint16, copy=False), 16 - bits)
