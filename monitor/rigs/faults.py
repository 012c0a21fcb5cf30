"""Faults on request: what goes wrong between a projector, a camera and a cable, done to the simulated rig's frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import prod

import numpy as np
import numpy.typing as npt

from configs import CaptureError, DeviceUnavailable

__all__ = ["FAULTS", "MOVED_MM", "faults_of", "harm", "light_of", "raise_fault"]

Stack = npt.NDArray[np.uint8]

MOVED_MM = 0.15
"""How far a sample is pushed in the middle of a capture: a few camera pixels."""

RAISED: dict[str, Exception] = {
    "dropped": CaptureError("simulated rig: a frame was dropped; the capture is not whole"),
    "unplugged": DeviceUnavailable("simulated rig: the camera does not answer; is it plugged in?"),
}
"""Faults that a driver notices itself. `unplugged` is so in the middle of a capture: the frames before are lost too."""


def _repeated(stack: Stack, place: int) -> Stack:
    """A frame shows what the one before it showed: the camera gave a stale buffer."""
    return np.concatenate([stack[:place], stack[place - 1 : place], stack[place + 1 :]])


def _slipped(stack: Stack, place: int) -> Stack:
    """A frame is lost and nobody notices: all later ones come one too early, and the last one twice."""
    return np.concatenate([np.delete(stack, place, axis=0), stack[-1:]])


def _late(stack: Stack, place: int) -> Stack:
    """The camera holds a frame back: each pattern's frame shows the pattern before it."""
    return np.concatenate([stack[1:2], stack[:-1]])


def _swapped(stack: Stack, place: int) -> Stack:
    """Two frames have changed places."""
    order = np.arange(len(stack))
    other = place + 4 if place + 4 < len(stack) else place - 4
    order[[place, other]] = order[[other, place]]
    swapped: Stack = stack[order]
    return swapped


HARMS: dict[str, Callable[[Stack, int], Stack]] = {
    "repeated": _repeated,
    "slipped": _slipped,
    "late": _late,
    "swapped": _swapped,
}
"""Faults of the order that no driver notices, and the frames must betray: (frames, place of the harm) to frames."""

LIGHT = {"dark": 0.01, "saturated": 5.0}
"""Faults of the light: its power against the usual. The lamp glows only, or the exposure is far too long."""

FAULTS = (*RAISED, *HARMS, *LIGHT, "moved")
"""Every fault; `moved` is a sample pushed in the middle of a capture."""


def faults_of(given: object) -> tuple[str, ...]:
    """Read what one visit is asked to suffer: a fault, or a list of them that come together.

    Raises
    ------
    ValueError
        There is no such fault.
    """
    names = tuple(given) if isinstance(given, list | tuple) else (given,)
    for name in names:
        if name not in FAULTS:
            raise ValueError(f"no fault {name!r}; there are {', '.join(FAULTS)}")
    return names


def raise_fault(names: Sequence[str]) -> None:
    """Raise what a driver would; nothing for faults that it does not notice."""
    for name in names:
        if name in RAISED:
            raise type(RAISED[name])(*RAISED[name].args)


def light_of(names: Sequence[str]) -> float:
    """Power of the light against the usual."""
    return prod(LIGHT.get(name, 1.0) for name in names)


def harm(stack: Stack, names: Sequence[str], chance: np.random.Generator) -> Stack:
    """Do to the frames of one capture what the faults do, one after the other; nothing where they harm no order.

    Parameters
    ----------
    stack : ndarray of uint8, shape (frame, row, column)
        White and black first.
    names : sequence of str
    chance : Generator
        Chooses the place of each harm, among the patterns' frames.
    """
    for name in names:
        if name in HARMS:
            stack = np.ascontiguousarray(HARMS[name](stack, int(chance.integers(4, max(5, len(stack) - 8)))))
    return stack
