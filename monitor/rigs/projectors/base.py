"""Projector: what shows the images of a pattern set, one at a time. Four verbs: open, load, show, close."""

from __future__ import annotations

from typing import Literal, Protocol, runtime_checkable

from pipelines import PatternSet

__all__ = ["Again", "Projector"]

Again = Literal["frame", "capture", "never"]
"""What can be taken again where the camera lost a frame: that *frame*, as its pattern stands until the next is asked
for; the whole *capture*, as the projector plays by itself and begins anew when the first is asked for; or nothing."""


@runtime_checkable
class Projector(Protocol):
    """Something that lights the surface with a pattern.

    Made by its registered factory from plain keywords, it touches no device before ``open``, and after ``close`` may
    be opened again.
    """

    again: Again

    def open(self) -> None:
        """Take hold of the device.

        Raises
        ------
        DeviceUnavailable
            It is not there now, and may be later.
        """
        ...

    def load(self, patterns: PatternSet) -> None:
        """Make the images of a pattern set ready; loading the same set again costs nothing.

        Raises
        ------
        InputError
            The device cannot show images of that size.
        """
        ...

    def show(self, frame: int) -> None:
        """Show one image of the loaded set; it is lit when this returns, but for the device's own delay.

        A projector that plays by itself begins with image 0, and shows the others in their turn.

        Raises
        ------
        DeviceUnavailable
            The device went away.
        """
        ...

    def close(self) -> None:
        """Go dark and let the device go; harmless if not open."""
        ...
