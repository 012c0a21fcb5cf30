"""The delay of a projector: how long after a pattern is asked for its light stands in the camera's frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from configs import CaptureError
from pipelines import PatternSet

from .devices import DevicesRig

__all__ = ["Delay", "measure_delay"]

ROUNDS = 5
LONGEST_S = 2.0
"""No screen and projector together take longer."""

STANDS = 0.95
"""Share of the step from black to white at which a pattern stands: less would leave a ghost of the one before."""


@dataclass(frozen=True, slots=True)
class Delay:
    """The delay that was seen.

    Parameters
    ----------
    least_ms, most_ms : float
        Of all changes, from black to white and back: when the first frame was triggered that shows the new one whole.
    settle_ms : float
        What to give as the rig's ``settle_ms``: the most, and one frame of the camera more, rounded up to 5 ms.
    contrast : float
        Step of the mean grey value from black to white.
    """

    least_ms: float
    most_ms: float
    settle_ms: float
    contrast: float


def measure_delay(
    rig: DevicesRig,
    patterns: PatternSet,
    now: Callable[[], float] = time.monotonic,
    wait: Callable[[float], None] = time.sleep,
) -> Delay:
    """Show white and black in turn, and see from the frames when each stands.

    Parameters
    ----------
    rig : DevicesRig
        Open.
    patterns : PatternSet
        Its white and its black frame are shown.
    now, wait : callable
        The clock, s.

    Raises
    ------
    CaptureError
        White and black look alike, or one does not stand within two seconds.
    DeviceUnavailable
        A device went away.
    """
    names = [role.name for role in patterns.roles]
    if "white" not in names or "black" not in names:
        raise CaptureError("the delay needs a white and a black frame in the pattern set; its order names none")
    white, black = names.index("white"), names.index("black")
    rig.projector.load(patterns)
    rig.camera.start()

    def brightness() -> float:
        return float(np.mean(rig.camera.take().image[::8, ::8]))

    def settled(frame: int) -> float:
        rig.projector.show(frame)
        wait(LONGEST_S)
        return brightness()

    dark, bright = settled(black), settled(white)
    if bright - dark < 2.0:  # grey values: below this, noise and mains flicker decide
        raise CaptureError(
            f"white looks like black to the camera (mean grey values {bright:.1f} and {dark:.1f}): "
            "is the projector on, its lens cap off, and its screen the one named?"
        )
    delays, frame_s = [], []
    for turn in range(2 * ROUNDS):
        shown, level, start = (black, dark, bright) if turn % 2 == 0 else (white, bright, dark)
        rig.projector.show(shown)
        asked = now()
        while True:
            triggered = now()
            reached = (brightness() - start) / (level - start)
            frame_s.append(now() - triggered)
            if reached >= STANDS:
                delays.append(triggered - asked)
                break
            if triggered - asked > LONGEST_S:
                raise CaptureError(f"a pattern does not stand {LONGEST_S:.0f} s after it was asked for")
    most = max(delays)
    settle_ms = 5.0 * math.ceil((most + float(np.median(frame_s))) * 1000.0 / 5.0)
    return Delay(min(delays) * 1000.0, most * 1000.0, settle_ms, bright - dark)
