"""Stage: what moves the sample sideways. Five verbs: open, home, move to, where, close."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

__all__ = ["ARRIVED_MM", "Stage", "check_arrived"]

ARRIVED_MM = 0.05
"""A stage that says it stands farther than this from where it was sent has met an end stop, or lost its steps."""


@runtime_checkable
class Stage(Protocol):
    """An XY stage.

    Made by its registered factory from plain keywords, it touches no device before ``open``, and after ``close`` may
    be opened again. Positions are mm in its own axes, from its own zero.
    """

    def open(self) -> None:
        """Take hold of the device; nothing moves.

        Raises
        ------
        DeviceUnavailable
            It is not there now, and may be later.
        """
        ...

    def home(self) -> None:
        """Find the zero of both axes by the device's own switches."""
        ...

    def move_to(self, x_mm: float, y_mm: float) -> None:
        """Go there; it stands still when this returns.

        Raises
        ------
        DeviceUnavailable
            The device went away, or does not arrive.
        """
        ...

    def where(self) -> tuple[float, float]:
        """Say where it stands, mm: by its encoders where it has such."""
        ...

    def close(self) -> None:
        """Stop where it is and let the device go; harmless if not open."""
        ...


def check_arrived(what: str, sent: tuple[float, float], where: tuple[float, float]) -> None:
    """Refuse a stage that stands elsewhere than it was sent. Raises DeviceUnavailable."""
    from configs import DeviceUnavailable

    if max(abs(a - b) for a, b in zip(sent, where, strict=True)) > ARRIVED_MM:
        raise DeviceUnavailable(
            f"{what} was sent to {sent[0]:g}, {sent[1]:g} mm and says that it stands at {where[0]:g}, {where[1]:g}: is "
            "that beyond its travel, or something in its way?"
        )
