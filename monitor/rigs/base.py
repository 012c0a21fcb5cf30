"""Rig: what takes captures. Three verbs: open, capture, close."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from pipelines import Frames, Instant, PatternSet

__all__ = ["Rig"]


@runtime_checkable
class Rig(Protocol):
    """A projector and a camera, real, simulated or replayed.

    A rig is made by its registered factory from the campaign's rig options (plain keywords), touches no device before
    ``open``, and after ``close`` may be opened again. It never knows the truth that a pipeline is to find.

    It may have more, which is used where it is there: ``set_exposure(ms)``; ``temperature_c``; and ``make_stack(shape,
    dtype)``, which gives the array that it captures into: ``numpy.empty``, until somebody who lends room sets another.
    """

    def open(self) -> None:
        """Take hold of the devices.

        Raises
        ------
        DeviceUnavailable
            A device is not there now, and may be later.
        """
        ...

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Project each pattern and take its frame.

        Parameters
        ----------
        patterns : PatternSet
        at : Instant
            Time of the visit. A device stamps its own time on the frames where it has a clock; the simulated
            rig shows its scene as it is at that time.

        Raises
        ------
        CaptureError
            The frames are not whole (dropped, late, none left to replay).
        DeviceUnavailable
            The device went away.
        """
        ...

    def close(self) -> None:
        """Let the devices go; harmless if not open."""
        ...
